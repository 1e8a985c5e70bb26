"""A first photograph: an embedded scene through a real lens, and what lies between.

    python first_photograph.py [folder]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import diopter as dp


def main(folder: Path = Path("."), size: tuple[int, int] = (600, 400), spp: int = 16) -> dp.Picture:
    scene = dp.Scene.builtin("still-life")
    camera = dp.Camera(lens="double-gauss-50mm", body="nikon-d850", focus="auto", aperture="f/2.8")

    # Light on the film: mean electrons of each pixel, without noise.
    plane = dp.expose(scene, camera, size=size, spp=spp, seed=1, progress=True)
    noise = np.sqrt(plane.variance.mean()) / plane.mean.mean()
    print(f"{plane}: {plane.mean.mean():.0f} e⁻ a pixel, {100 * noise:.1f} % noise of the renderer")
    print(f"exposed for {plane.metadata['exposure_s']:.4f} s, focused at {plane.metadata['focus_distance_m']:.3f} m")

    # The sensor: another ISO speed or another seed takes milliseconds.
    raw = dp.read_out(plane, iso=400, seed=3)
    raw.save(folder / "first.dng")

    # The development.
    picture = dp.develop(raw, tone="agx")
    picture.save(folder / "first.jpg")
    return picture


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("."))
