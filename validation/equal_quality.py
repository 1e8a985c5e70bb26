"""Cost to equal quality beside Mitsuba 3: the scenes of the peers' drivers, in one run.

    python validation/equal_quality.py PEERS FOLDER BENCH [SCENE ...]

PEERS: the folder with the drivers (`gen_scenes.py`, `bench_mitsuba.py`); FOLDER: the scenes that `gen_scenes.py` made; BENCH: the program of
`cargo bench -p diopter --bench peers --no-run`. 16 samples, three seeds in turn, medians; each program against its own reference of 256 samples, whose own
noise is taken off. Ours in red, green and blue and in spectra. relMSE: mean of (x - ref)^2 / (ref^2 + 0.01). Needs numpy and mitsuba
(pip) and an LLVM that Mitsuba can use (DRJIT_LIBLLVM_PATH).
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

SPP, REFERENCE, SEEDS = 16, 256, (1, 2, 3)
peers, folder, bench = (Path(p).resolve() for p in sys.argv[1:4])
scenes = sys.argv[4:] or ["cornell", "spheres", "bumpy"]
picture = Path(tempfile.mkdtemp()) / "picture.npy"


def run(command, cwd):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, cwd=cwd)
    if done.returncode:
        sys.exit(done.stderr[-800:])
    line = next(line for line in done.stdout.splitlines()[::-1] if "{" in line)
    facts = json.loads(line[line.index("{") :])
    return facts["render_cpu_s"], np.load(picture)[..., :3].astype(np.float64)


def diopter(*options):
    return lambda scene, spp, seed: run([bench, "--bench", folder, scene, spp, "--seed", seed, "--out", picture, *options], folder)


def mitsuba(scene, spp, seed):
    options = ["--variant", "llvm_ad_rgb", "--seed", seed, "--scenes", folder, "--out", picture]
    return run([sys.executable, peers / "bench_mitsuba.py", scene, spp, *options], folder.parent)


def error(x, ref):
    return ((x - ref) ** 2 / (ref**2 + 0.01)).mean()


PROGRAMS = {"mitsuba": mitsuba, "diopter": diopter("--rgb"), "diopter, paths alone": diopter("--rgb", "--integrator", "path"), "diopter, spectra": diopter()}
for scene in scenes:
    figures = {}
    for name, render in PROGRAMS.items():
        if name == "diopter, paths alone":
            reference = figures["diopter"]["reference"]
        else:
            _, reference = render(scene, REFERENCE, 77)
        runs = [render(scene, SPP, seed) for seed in SEEDS]
        seconds, errors = np.median([s for s, _ in runs]), np.median([error(x, reference) for _, x in runs])
        # The reference's own noise; that of paths alone is taken against the reference of the program as it comes.
        if name == "diopter, paths alone":
            own = errors - figures["diopter"]["error"] * SPP / REFERENCE
        else:
            own = errors * REFERENCE / (REFERENCE + SPP)
        samples = runs[0][1].shape[0] * runs[0][1].shape[1] * SPP / seconds / 1e6
        mean = np.mean([x.mean() for _, x in runs])
        figures[name] = {"reference": reference, "cost": seconds * own, "error": own}
        beside = seconds * own / figures["mitsuba"]["cost"]
        print(f"{scene}: {name}: {samples:.3f} M samples a core-second, relMSE {own:.5f}, mean {mean:.5f}, cost beside Mitsuba's {beside:.2f}", flush=True)
