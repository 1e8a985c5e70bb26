"""A small data set of raw images and their truth, as numpy files: noisy mosaics, what they should have been, depth. No torch is needed.

    python raw_and_truth.py [folder] [number]

A `torch.utils.data.Dataset` over it is one line an item: `numpy.load(folder / f"{i:05}.npz")`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import diopter as dp


def main(folder: Path = Path("raw-and-truth"), count: int = 8, size: tuple[int, int] = (96, 64), spp: int = 16) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    scene = dp.Scene.builtin("still-life")
    for item in range(count):
        # Everything of an item follows from its number: items can be made in any order, by any process.
        rng = np.random.default_rng(item)
        angle, height = rng.uniform(-0.6, 0.6), rng.uniform(0.15, 0.5)
        camera = dp.Camera(
            lens="thin",
            body="nikon-d850",
            focal_length=f"{rng.uniform(35, 85):.1f} mm",
            aperture=f"f/{rng.choice([2, 2.8, 4, 5.6])}",
            position=(0.9 * np.sin(angle), height, 0.9 * np.cos(angle)),
            look_at=(0.0, 0.08, 0.0),
        )
        iso = float(rng.choice([200, 800, 3200]))
        plane = dp.expose(scene, camera, size=size, spp=spp, seed=item, iso=iso)
        raw = dp.read_out(plane, iso=iso, seed=item)
        truth = dp.expected(plane, iso=iso)
        path = folder / f"{item:05}.npz"
        np.savez_compressed(
            path, mosaic=raw.mosaic, expected=truth.dn, variance=truth.variance_e2, clipped=truth.clipped,
            electrons=plane.mean, depth=plane.depth, normal=plane.normal, object=plane.object,
        )
        written.append(path)
        print(f"{path}: ISO {iso:.0f}, {plane.metadata['exposure_s']:.4f} s, f/{plane.metadata['f_number']:.1f}")
    return written


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "raw-and-truth"), int(sys.argv[2]) if len(sys.argv) > 2 else 8)
