"""A lens on the bench: a million rays as arrays, spots, contrast, distortion, vignetting.

    python lens_bench.py [lens]
"""

from __future__ import annotations

import sys
import time

import numpy as np

import diopter as dp


def main(name: str = "tessar-50mm-f2.8", rays: int = 1_000_000) -> dict[str, float]:
    lens = dp.Lens(name)
    bench = lens.bench(aperture="f/5.6", focus="inf")
    info = bench.info()
    print(f"{lens.name}: {info['effective_focal_length_mm']:.2f} mm, f/{info['f_number']:.2f}, T {info['t_number']:.2f}")

    # A bundle from infinity, 10° off the axis, over the entrance pupil; single precision is the fast path.
    rng = np.random.default_rng(1)
    radius, angle = 0.5 * info["entrance_pupil_diameter_mm"] * np.sqrt(rng.random(rays)), 2 * np.pi * rng.random(rays)
    direction = np.array([0.0, np.sin(np.radians(10)), np.cos(np.radians(10))])
    pupil = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(rays, info["entrance_pupil_z_mm"])], axis=1)
    positions = (pupil - 100 * direction).astype(np.float32)
    directions = np.broadcast_to(direction, positions.shape).astype(np.float32)
    began = time.perf_counter()
    traced = bench.trace(positions, directions, np.float32(550.0))
    seconds = time.perf_counter() - began
    points = traced.positions[traced.passed, :2]
    print(f"{rays / seconds / 1e6:.1f} million rays a second, {100 * traced.passed.mean():.1f} % passed")
    print(f"spot: {1000 * points.std(axis=0).max():.1f} µm RMS at {points[:, 1].mean():.3f} mm")

    for field in (0.0, 10.0, 20.0):
        mtf = bench.mtf([10, 30], field)
        print(f"{field:4.0f}°  10/mm {mtf.tangential[0]:.2f} {mtf.sagittal[0]:.2f}   30/mm {mtf.tangential[1]:.2f} {mtf.sagittal[1]:.2f}")
    light = bench.vignetting([0.0, 10.0, 20.0])
    print("light over height:", np.round(light.with_losses_sr / light.with_losses_sr[0], 3))
    print("distortion, %:", np.round(bench.distortion([5.0, 10.0, 20.0]).distortion_percent, 3))
    return info


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(sys.argv[1])
    else:
        main()
