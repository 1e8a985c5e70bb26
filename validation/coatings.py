"""Reflection and transmission of film stacks by Steven Byrnes' `tmm`: the table that `crates/lens/src/coating/tests.rs` is held against.

    pip install tmm
    python validation/coatings.py > crates/lens/src/coating/data/tmm.csv
"""

import sys
from contextlib import redirect_stdout
from importlib.metadata import version
from math import inf, radians

from numpy import angle
from tmm import coh_tmm

GLASS, DENSE = 1.5187, 1.8052
MGF2, SIO2, AL2O3, ZRO2, TA2O5, TIO2 = 1.3785, 1.4599, 1.6298, 2.1549, 2.1573, 2.4358
AL, AG, CR = 1.0152 + 6.6273j, 0.0596 + 3.5974j, 3.1812 + 3.3291j

# name, vacuum wavelength in nm, first medium, films (index, thickness in nm), last medium, angles in degrees
ANGLES = (0.0, 30.0, 60.0, 85.0)
STACKS = [
    ("bare glass", 550.0, 1.0, [], GLASS, ANGLES),
    ("single layer", 486.1, 1.0, [(MGF2, 99.7)], GLASS, ANGLES),
    ("V coat from the glass", 587.6, DENSE, [(ZRO2, 21.0), (MGF2, 127.0)], 1.0, (0.0, 15.0, 30.0, 33.0)),
    ("three layers", 656.3, 1.0, [(MGF2, 99.7), (ZRO2, 127.6), (AL2O3, 84.4)], GLASS, ANGLES),
    ("six layers", 435.8, 1.0, [(MGF2, 101.7), (TA2O5, 34.6), (SIO2, 11.5), (TA2O5, 80.9), (SIO2, 22.1), (TA2O5, 19.5)], DENSE, ANGLES),
    ("high reflector of 17 layers", 550.0, 1.0, [(TIO2, 56.4), (SIO2, 94.2)] * 8 + [(TIO2, 56.4)], GLASS, ANGLES),
    ("protected aluminium", 550.0, 1.0, [(AL2O3, 30.0)], AL, ANGLES),
    ("half mirror of silver", 550.0, 1.0, [(AG, 25.0), (SIO2, 100.0)], GLASS, ANGLES),
    ("black chromium", 550.0, GLASS, [(CR, 8.0), (SIO2 + 0.01j, 90.0), (CR, 100000.0)], GLASS, ANGLES),
    ("frustrated total reflection", 632.8, GLASS, [(1.0, 150.0)], DENSE, (0.0, 41.0, 45.0, 60.0)),
]

print(f"# Film stacks by tmm {version('tmm')} (validation/coatings.py). Films: n:k:thickness in nm, as light meets them. Phases in rad.")
print("# name,nm,first medium,films,last medium n:k,angle deg,polarisation,R,T,phase of r,phase of t")
for name, nm, first, films, last, angles in STACKS:
    text = " ".join(f"{complex(n).real!r}:{complex(n).imag!r}:{d!r}" for n, d in films)
    for degrees in angles:
        for polarisation in "sp":
            with redirect_stdout(sys.stderr):  # it warns of opaque films there
                found = coh_tmm(polarisation, [first, *(n for n, _ in films), last], [inf, *(d for _, d in films), inf], radians(degrees), nm)
            end = f"{complex(last).real!r}:{complex(last).imag!r}"
            figures = ",".join(f"{v:.14e}" for v in (found["R"], found["T"], angle(found["r"]), angle(found["t"])))
            print(f"{name},{nm!r},{first!r},{text},{end},{degrees!r},{polarisation},{figures}")
