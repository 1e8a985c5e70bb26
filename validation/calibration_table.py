"""Fits every camera model to every embedded lens and writes the table into docs/calibration.md.

    python validation/calibration_table.py [path/to/diopter] [docs/calibration.md]

Only the standard library. Each lens is set to f/8 (or as wide as it opens), focused at infinity, before a film of 3:2 whose diagonal is its image circle (36 x 24 mm where none is stated), 6000 x 4000 pixels;
zooms at their shortest and longest. The figures are the root mean square of `lens calibrate --model all`, in pixels.
"""

import json
import math
import subprocess
import sys

DIOPTER = sys.argv[1] if len(sys.argv) > 1 else "target/release/diopter"
PAGE = sys.argv[2] if len(sys.argv) > 2 else "docs/calibration.md"
SIZE = "6000x4000"
FULL_FRAME_MM = math.hypot(36, 24)
BEGIN, END = "<!-- table: calibration fits, written by validation/calibration_table.py -->", "<!-- end of table -->"
MODELS = [
    "pinhole",
    "radial",
    "opencv5",
    "opencv8",
    "opencv12",
    "opencv-fisheye",
    "thin-prism-fisheye",
    "f-theta",
    "double-sphere",
    "division",
]


def run(*words):
    done = subprocess.run([DIOPTER, *words, "--json"], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(words)}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def positions(lens):
    """Words that set a zoom, and what the table calls it."""
    focal = lens["focal_length_mm"]
    if len(focal) < 2:
        return [([], "")]
    ends = sorted({focal.index(min(focal)), focal.index(max(focal))}, key=lambda i: focal[i])
    return [(["--zoom-position", str(i + 1)], f" at {focal[i]:.0f} mm") for i in ends]


def calibrated(lens, words):
    circle = lens["image_circle_mm"] or FULL_FRAME_MM
    # A billionth less than the circle for what rounding leaves.
    film = f"{circle * 3 / math.sqrt(13):.4f}x{circle * 2 / math.sqrt(13):.4f}"
    ask = ["lens", "calibrate", lens["name"], "--size", SIZE, "--film", film, "--model", "all", *words]
    try:
        return run(*ask, "--aperture", "f/8")
    except RuntimeError as first:
        try:
            return run(*ask)
        except RuntimeError:
            raise first from None


def number(rms):
    if rms is None:
        return "–"
    return f"{rms:.3f}" if rms < 0.9995 else f"{rms:.2f}" if rms < 99.5 else f"{rms:.0f}"


def main():
    rows = []
    for lens in run("lens", "list"):
        for words, suffix in positions(lens):
            found = calibrated(lens, words)
            fits = {m["model"]["name"]: m.get("fit") for m in found["models"]}
            seen = max((f["fitted_angle_deg"] for f in fits.values() if f), default=float("nan"))
            cells = [fits[name]["rms_px"] if fits.get(name) else None for name in MODELS]
            best = min((c for c in cells if c is not None), default=None)
            shown = [f"**{number(c)}**" if c is not None and c <= 1.05 * best else number(c) for c in cells]
            rows.append(f"| `{lens['name']}`{suffix} | {found['film_mm'][0]:.1f} × {found['film_mm'][1]:.1f} | {seen:.1f} | " + " | ".join(shown) + " |")
            print(rows[-1], flush=True)
    head = ["| lens | film, mm | fitted to, ° | " + " | ".join(f"`{m}`" for m in MODELS) + " |", "|---|---|" + "---:|" * (len(MODELS) + 1)]
    page = open(PAGE, encoding="utf-8").read()
    before, rest = page.split(BEGIN)
    after = rest.split(END)[1]
    with open(PAGE, "w", encoding="utf-8") as to:
        to.write(before + BEGIN + "\n\n" + "\n".join(head + rows) + "\n\n" + END + after)


if __name__ == "__main__":
    main()
