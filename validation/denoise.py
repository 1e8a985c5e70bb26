"""relMSE and FLIP of exposures with few samples, denoised and not, against one with many.

    pip install numpy OpenEXR flip-evaluator
    python validation/denoise.py DIOPTER FOLDER NAME...

FOLDER holds NAME-32.exr, NAME-256.exr and NAME-ref.exr (focal planes of `diopter expose`, the reference with another seed). relMSE = mean of
(a - r)² / (r² + (0.01 of white)²) over pixels and bands; FLIP (Andersson et al. 2020) of the bands R, G, B shown by the sRGB function at the same white.
"""

import subprocess
import sys
import time

import numpy as np
import OpenEXR

try:
    import flip_evaluator as flip
except ImportError:
    flip = None


def bands(path):
    with OpenEXR.File(path, separate_channels=True) as f:
        c = f.channels()
        return np.stack([c[k].pixels.astype(float) for k in "RGB"], -1)


def main():
    diopter, folder, names = sys.argv[1], sys.argv[2], sys.argv[3:]
    print(f"{'':16}{'relMSE 32':>12}{'denoised':>12}{'256':>12}{'FLIP 32':>10}{'denoised':>10}{'256':>10}{'s':>7}")
    for name in names:
        path = lambda which: f"{folder}/{name}-{which}.exr"
        started = time.time()
        subprocess.run([diopter, "denoise", path(32), "--by", "builtin", "-o", path("denoised")], check=True, capture_output=True)
        seconds = time.time() - started
        ref = bands(path("ref"))
        # Each run metered for itself, with its own noise: exposure times differ by a percent or two.
        ref *= bands(path(256)).mean() / ref.mean()
        white = np.percentile(ref, 99, axis=(0, 1))
        relmse = lambda p: np.mean((p - ref) ** 2 / (ref**2 + (0.01 * white) ** 2))

        def shown(p):
            v = np.clip(p / white, 0, 1)
            return np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055).astype(np.float32)

        def flips(p):
            if flip is None:
                return float("nan")
            return flip.evaluate(shown(ref), shown(p), "LDR", inputsRGB=True)[1]

        pictures = [bands(path(k)) for k in (32, "denoised", 256)]
        row = [f"{relmse(p):12.5f}" for p in pictures] + [f"{flips(p):10.4f}" for p in pictures]
        print(f"{name:16}" + "".join(row) + f"{seconds:7.1f}")


main()
