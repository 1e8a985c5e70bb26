"""relMSE of lamps out of focus through a real lens, with and without light traced from them, and at what cost.

    pip install numpy OpenEXR
    python validation/lamps_out_of_focus.py DIOPTER [--scene still-life] [--spp 32] [--reference 2048] [DIOPTER'S OPTIONS...]

Exposes a scene by `--integrator path` and `auto` with two seeds each, and by `auto` with many samples of a third seed. Disks are where the reference is
more than eight times as bright as its median (`--bright`). relMSE = mean of (a - r)² / (r² + (0.01 of white)²) over pixels and bands, white the 99th
percentile; its product with the processor time says how much sooner the same error is reached. Means of `path` must be that of the reference within
its noise.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile

import numpy as np
import OpenEXR


def bands(path):
    with OpenEXR.File(path, separate_channels=True) as f:
        c = f.channels()
        return np.stack([c[k].pixels.astype(float) for k in "RGB"], -1)


def main():
    p = argparse.ArgumentParser()
    p.add_argument("diopter")
    p.add_argument("--scene", default="still-life")
    p.add_argument("--spp", type=int, default=32)
    p.add_argument("--reference", type=int, default=2048)
    p.add_argument("--bright", type=float, default=8.0)
    a, options = p.parse_known_args()
    # The same exposure for all: nothing is metered.
    common = ["--lens", "double-gauss-50mm", "--aperture", "2", "--shutter", "1/60", "--size", "360x240", *options]
    with tempfile.TemporaryDirectory() as folder:

        def expose(integrator, spp, seed):
            out = os.path.join(folder, "plane.exr")
            command = [a.diopter, "expose", a.scene, *common, "--integrator", integrator, "--spp", str(spp), "--seed", str(seed), "-o", out]
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                sys.exit(done.stderr)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            return bands(out), after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

        reference, _ = expose("auto", a.reference, 99)
        grey = reference.mean(-1)
        disks = grey > a.bright * np.median(grey)
        white = np.percentile(reference, 99, axis=(0, 1))
        print(f"{a.scene}: disks are {100 * disks.mean():.1f} % of the picture")
        print(f"{'':8}{'s':>8}{'relMSE disks':>14}{'elsewhere':>12}{'× s':>10}{'mean of disks':>15}")
        product = {}
        for integrator in ("path", "auto"):
            errors, seconds, means = [], [], []
            for seed in (1, 2):
                plane, time = expose(integrator, a.spp, seed)
                error = (plane - reference) ** 2 / (reference**2 + (0.01 * white) ** 2)
                errors.append((error[disks].mean(), error[~disks].mean()))
                seconds.append(time)
                means.append(plane[disks].mean() / reference[disks].mean())
            (at_disks, elsewhere), s = np.mean(errors, axis=0), np.mean(seconds)
            product[integrator] = at_disks * s
            print(f"{integrator:8}{s:8.1f}{at_disks:14.5f}{elsewhere:12.5f}{at_disks * s:10.3f}{np.mean(means):15.4f}")
        print(f"at equal time auto has {product['auto'] / product['path']:.3f} of the error of path")


main()
