"""Mirrors off the axis, ray by ray beside ray-optics: the same rays of a distant point through the same file, seen from the base ray.

    pip install rayoptics diopter
    python validation/off_axis_rays.py FILE.zmx FILE.seq ...

Our rays start in the space of the object (along the base ray), theirs in the file's: the same parallel beam, moved to the base ray of theirs, which is found as the ray through the middle of
the stop. Where rays land on the film is compared from where the base ray lands, and the angles between them: neither depends on where a program puts its origin. For files whose middle field
is not on the file's axis give it: FILE.zmx@16.
"""

import logging
import sys
import warnings

import numpy as np

import diopter

warnings.simplefilter("ignore")
logging.disable(logging.CRITICAL)
from rayoptics.environment import open_model  # noqa: E402
from rayoptics.raytr import raytrace  # noqa: E402


def theirs(path: str, field_deg: float, offsets: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Landing (mm) and direction of parallel rays, `offsets` [ray][x, y] across the base ray; `reach`: half the width in which that is looked for, mm."""
    model = open_model(path)
    model = model[0] if isinstance(model, tuple) else model
    model.update_model()
    lens = model["seq_model"]
    # Rays are given before the first surface, not at an object at infinity.
    lens.gaps[0].thi = 0.0
    lens.update_model()
    nm = model["optical_spec"]["wvls"].central_wvl
    angle = np.radians(field_deg)
    along = np.array([0.0, np.sin(angle), np.cos(angle)])
    up = np.array([0.0, np.cos(angle), -np.sin(angle)])

    def ray(at: np.ndarray):
        return raytrace.trace(lens, np.array([0.0, 0.0, 0.0]) + at[0] * np.array([1.0, 0, 0]) + at[1] * up, along, nm)[0]

    def miss(y: float) -> float:
        try:
            return ray(np.array([0.0, y]))[lens.stop_surface][0][1]
        except Exception:
            return np.nan

    # The base ray, in the plane of symmetry.
    ys = np.linspace(-reach, reach, 4001)
    found = np.array([miss(y) for y in ys])
    crossing = [i for i in range(len(ys) - 1) if found[i] * found[i + 1] <= 0]
    low, high = min(((ys[i], ys[i + 1]) for i in crossing), key=lambda ends: abs(ends[0]))
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if miss(low) * miss(middle) > 0 else (low, middle)
    out = [ray(np.array([x, low + y]))[-1] for x, y in offsets]
    return np.array([o[0][:2] for o in out]), np.array([o[1] for o in out])


def ours(path: str, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    starts = np.column_stack([offsets, np.full(len(offsets), -50.0)])
    # Mirrors alone: any wavelength does.
    rays = diopter.Lens(path).trace(starts, np.tile([0.0, 0.0, 1.0], (len(offsets), 1)))
    return rays.positions[:, :2], rays.directions


# Programs turn the other way about x, and look at the film from the other side, than one another: the same mirrors, seen in a mirror.
FLIPS = [(before, film) for before in ((1, 1), (1, -1), (-1, 1), (-1, -1)) for film in ((1, 1), (1, -1), (-1, 1), (-1, -1))]


def compare(offsets, mine, their, flip) -> tuple[float, float, float]:
    """Largest distance of landings (mm) from where the base ray lands, the film's distance along its normal that brings theirs to ours, largest difference of angles to the base ray (rad)."""
    before, film = flip
    rows = [int(np.argmin(np.hypot(*(offsets - offset * before).T))) for offset in offsets]
    (a, da), (b, db) = mine, (their[0][rows] * film, their[1][rows])
    slopes = db[:, :2] / np.abs(db[:, 2:]) * film
    land, slope = b - b[0], slopes - slopes[0]
    apart = (a - a[0]) - land
    moved = (apart * slope).sum() / (slope**2).sum()
    angles = np.arccos(np.clip(da @ da[0], -1, 1)) - np.arccos(np.clip(db @ db[0], -1, 1))
    return float(np.abs(apart - moved * slope).max()), float(moved), float(np.abs(angles).max())


def main() -> None:
    for argument in sys.argv[1:]:
        path, _, field = argument.partition("@")
        base = diopter.Lens(path)
        reach = 0.45 * base.info()["entrance_pupil_diameter_mm"]
        grid = np.linspace(-1, 1, 9)
        offsets = np.array([(0.0, 0.0)] + [(x, y) for x in grid for y in grid if 0 < np.hypot(x, y) <= 1]) * reach
        a, da = ours(path, offsets)
        b, db = theirs(path, float(field or 0), offsets, 800.0)
        best = min((compare(offsets, (a, da), (b, db), flip) for flip in FLIPS), key=lambda found: found[0])
        print(
            f"{path}: {len(offsets)} rays over {2 * reach:.2f} mm land within {best[0]:.1e} mm of theirs (spread {np.ptp(a, axis=0).max():.4f} mm, "
            f"film {best[1]:+.4f} mm from theirs), angles within {best[2]:.1e} rad",
            flush=True,
        )


if __name__ == "__main__":
    main()
