"""Pairs for denoisers: two read-outs of one exposure (as Noise2Noise wants them, Lehtinen et al. 2018), what they should have been, and how much noise is right.

The sensor's noise is known for every pixel: the mean of (read-out − expected)² over the variance that is told beside it is 1, and half that
of a pair. The light is exposed once; each read-out takes milliseconds.

    python denoising_pairs.py [folder] [number]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import diopter as dp


def main(folder: Path = Path("denoising-pairs"), count: int = 4, size: tuple[int, int] = (192, 128), spp: int = 32) -> dict[float, float]:
    """Writes pairs, and returns what noise there is over what noise there should be, by ISO speed."""
    folder.mkdir(parents=True, exist_ok=True)
    body = dp.Body("nikon-d850")
    camera = dp.Camera(lens="double-gauss-50mm", body=body, focus="auto", aperture="f/2.8")
    plane = dp.expose(dp.Scene.builtin("still-life"), camera, size=size, spp=spp, seed=1)
    gains = {step.iso: step.gain_e_per_dn for step in body.iso_steps}
    found = {}
    for iso in (400.0, 3200.0):
        truth = dp.expected(plane, iso=iso)
        ratios, noise = [], 0.0
        for pair in range(count):
            first, second = (dp.read_out(plane, iso=iso, seed=2 * pair + k) for k in (0, 1))
            np.savez_compressed(
                folder / f"iso{iso:.0f}-{pair:04}.npz",
                noisy=first.mosaic, again=second.mosaic, clean=truth.dn, variance_e2=truth.variance_e2, clipped=truth.clipped,
            )
            # Dark pixels are cut off at 0 and bright ones at white: what is in between has the noise of the model.
            free = ~truth.clipped & (truth.dn > first.black_level + 4)
            right = truth.variance_e2 / gains[iso] ** 2
            squares = (first.mosaic - truth.dn)[free] ** 2
            ratios.append(float(np.mean(squares / right[free])))
            noise = float(np.sqrt(np.mean(squares)))
        found[iso] = float(np.mean(ratios))
        print(f"ISO {iso:.0f}: noise of {noise:.2f} DN, {found[iso]:.3f} of what is told beside it")
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "denoising-pairs"), int(sys.argv[2]) if len(sys.argv) > 2 else 4)
