"""Fog and caustics: error of `auto` beside that of paths alone at the same processor time.

    python validation/fog.py DIOPTER SCENE [SIZE [SAMPLES]]

DIOPTER: the program; SCENE: such as Bitterli's volumetric-caustic. `auto` takes so many samples (64), `path` as many as take the same time; both against
`auto` with 16 times as many and other seeds, whose own noise (the variance that it claims) is taken off. relMSE: mean of (x - ref)^2 / (ref^2 + 0.01), without the
worst thousandth of the pixels of either (glints of the lamp in the glass) and those whose reference is noisiest. Medians of three seeds, one thread, red, green and blue. Needs numpy and OpenEXR (pip).
"""

import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR

program, scene = (Path(p).resolve() for p in sys.argv[1:3])
size = sys.argv[3] if len(sys.argv) > 3 else "96x96"
samples = int(sys.argv[4]) if len(sys.argv) > 4 else 64
exposure = Path(tempfile.mkdtemp()) / "exposure.exr"


def expose(integrator, spp, seed):
    """Picture, variance and processor seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    settings = ["--radiance", "--rgb", "--size", size, "--max-depth", "16", "--spp", spp, "--seed", seed, "--integrator", integrator]
    subprocess.run([str(c) for c in [program, "--threads", 1, "expose", scene, *settings, "-o", exposure]], check=True, capture_output=True)
    seconds = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    with OpenEXR.File(str(exposure)) as file:
        channels = file.channels()
        return *(np.array(channels[name].pixels, np.float64) for name in ("RGB", "variance")), seconds


reference, noise, _ = expose("auto", 16 * samples, 100)
scale = reference**2 + 0.01
certain = (noise / scale).mean(2).ravel()
certain = certain <= np.quantile(certain, 0.999)
_, _, auto_seconds = expose("auto", samples, 1)
_, _, path_seconds = expose("path", samples, 1)
figures = {}
for integrator, spp in (("path", round(samples * auto_seconds / path_seconds)), ("auto", samples)):
    runs = [expose(integrator, spp, seed) for seed in (1, 2, 3)]
    errors = [np.sort((((x - reference) ** 2 - noise) / scale).mean(2).ravel()[certain]) for x, _, _ in runs]
    error = np.median([e[: len(e) - max(1, len(e) // 1000)].mean() for e in errors])
    seconds = np.median([s for _, _, s in runs])
    figures[integrator] = error
    print(f"{integrator:5} {spp:4} samples {seconds:6.2f} s  relMSE {error:.4f}")
print(f"at equal time: {figures['auto'] / figures['path']:.3f} of the error")
