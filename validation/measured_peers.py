"""Measured materials beside Mitsuba 3's `measured` plugin: values, densities and drawn directions on tables that are generated.

    pip install mitsuba numpy
    MEASURED_PEERS=FOLDER cargo test -p diopter-scene --test it -- --ignored write_for_peers
    python validation/measured_peers.py FOLDER

The test writes tensor files of closed forms (isotropic; φ over a quarter and all the way round; paper) and what the library says of 400 pairs of directions each.
Differences are relative to the value and a hundredth of the largest. All are to be within 0.1 %, values within 0.01 %.
"""

import argparse
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

NM = [450.0, 520.0, 590.0, 660.0]


def of_mitsuba(file, row):
    """f cos θ at four wavelengths, density; direction, weights and density of a draw."""
    context = mi.BSDFContext()
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*(float(v) for v in row[0:3]))
    si.wavelengths = NM
    si.sh_frame = mi.Frame3f([0, 0, 1])
    wo = mi.Vector3f(*(float(v) for v in row[3:6]))
    value = [float(v) for v in file.eval(context, si, wo)]
    pdf = float(file.pdf(context, si, wo))
    sample, weight = file.sample(context, si, 0.5, mi.Point2f(float(row[11]), float(row[12])))
    # What lies below 0 beyond the horizon is no light to us.
    kept = sample.wo.z > 0 and sample.pdf > 0 and max(weight) > 0
    drawn = [*sample.wo, *weight, sample.pdf] if kept else [0.0] * 8
    return value + [pdf] + [float(v) for v in drawn]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--variant", default="scalar_spectral")
    options = parser.parse_args()
    mi.set_variant(options.variant)
    failed = False
    for path in sorted(options.folder.glob("*.bsdf")):
        rows = np.loadtxt(path.with_suffix(".csv"), delimiter=",", skiprows=1)
        file = mi.load_dict({"type": "measured", "filename": str(path)})
        theirs = np.array([of_mitsuba(file, row) for row in rows])
        ours = np.concatenate([rows[:, 6:11], rows[:, 13:21]], 1)
        print(f"{path.stem}: mitsuba {mi.__version__}, {len(rows)} pairs of directions")
        for name, columns in [("f cos θ", slice(0, 4)), ("density", slice(4, 5)), ("drawn direction", slice(5, 8)), ("weight", slice(8, 12)), ("drawn density", slice(12, 13))]:
            a, b = ours[:, columns], theirs[:, columns]
            largest = 1.0 if name == "drawn direction" else np.abs(b).max()
            off = (np.abs(a - b) / (np.abs(b) + 0.01 * largest if name != "drawn direction" else 1.0)).max(1)
            print(f"  {name:16} median {np.median(off):.1e}, 99 % {np.quantile(off, 0.99):.1e}, largest {off.max():.1e}")
            failed |= off.max() > (1e-4 if name == "f cos θ" else 1e-3)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
