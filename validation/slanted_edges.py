"""Slanted edges of our photographs, measured by quickMTF (C. Asplund's SFR, as packaged by L. Rui) beside `diopter measure mtf`.

    pip install numpy scipy matplotlib tifffile imagecodecs && pip install --no-deps quickmtf     # 2023.3.3
    python validation/slanted_edges.py [DIOPTER]                 # from the root of the project, after cargo build --release

Both get the same file (16 bits, linear) and the same region of it. quickMTF means to undo its numerical derivative, but cuts the correction off at 1, so
that it corrects nothing; and it says nothing of the width of its bins. Both are undone here: division by sinc(4 f / (d o)) and sinc(f / o), with d = 4 for
differences of neighbours and o = 4 bins a pixel. The window of the line spread function is a Hann window of the width that quickMTF chooses.
"""
import json, os, subprocess, sys, tempfile

import numpy as np
import tifffile

import matplotlib
matplotlib.use('Agg')
from quickMTF.SFR_MTF import sfr_mtfcal

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DIOPTER = os.path.abspath(sys.argv[1]) if len(sys.argv) > 1 else os.path.join(ROOT, 'target/release/diopter')
OVERSAMPLING = 4
LEAST_REACH = 16   # pixels beside the edge: nearer to the end of its region quickMTF cuts the window
SHOTS = [
    ('double-gauss-50mm', 'f/2.8', '1m'),
    ('double-gauss-50mm', 'f/8', '1m'),
    ('double-gauss-50mm', 'f/2.8', '0.97m'),   # out of focus
    ('tessar-50mm-f2.8', 'f/4', '1m'),
]


class Windowed(sfr_mtfcal):
    """quickMTF, which keeps the half width of its Hann window, bins."""

    def filter_window(self, *arguments, **named):
        window, width, bins = super().filter_window(*arguments, **named)
        self.half = width / 2
        return window, width, bins


def theirs(picture):
    """Frequencies, response and half width of the window in pixels; None where quickMTF takes the region for no slanted edge."""
    measured = Windowed()
    mtf, _ = measured.calc_sfr(picture, oversampling=OVERSAMPLING, difference_scheme='backward')
    if mtf is False:
        return None
    f, m = mtf[:, 0], mtf[:, 1]
    return f, m / np.sinc(f / OVERSAMPLING) / np.sinc(4 * f / (4 * OVERSAMPLING)), measured.half / OVERSAMPLING


def ours(path, *more):
    """Edges, as `diopter measure mtf` has them."""
    said = subprocess.run([DIOPTER, 'measure', 'mtf', path, '--encoding', 'linear', '--window', 'hann', '--json', *more],
                          check=True, capture_output=True, text=True)
    return json.loads(said.stdout)['edges']


worst, means = 0.0, []
grid = np.linspace(0, 0.5, 51)
with tempfile.TemporaryDirectory() as folder:
    path = os.path.join(folder, 'edges.tif')
    for lens, aperture, focus in SHOTS:
        subprocess.run([DIOPTER, 'shoot', 'slanted-edges', '--body', 'ideal', '--format', '11.25x7.05', '--lens', lens, '--aperture', aperture, '--focus', focus,
                        '--size', '600x376', '--spp', '512', '--tone', 'linear', '--set', 'output.encoding=linear', '-o', path],
                       check=True, capture_output=True)
        edges = ours(path)
        picture = tifffile.imread(path).astype(float)
        luminance = picture @ np.array([0.2126, 0.7152, 0.0722]) if picture.ndim == 3 else picture
        off = []
        for edge in edges:
            r = edge['region']
            if min(-edge['esf'][0][0], edge['esf'][-1][0]) < LEAST_REACH:
                continue
            found = theirs(luminance[r['y']:r['y'] + r['height'], r['x']:r['x'] + r['width']])
            if found is None:
                continue
            f, m, half = found
            edge = ours(path, '--region', ','.join(str(r[k]) for k in ('x', 'y', 'width', 'height')), '--reach', str(max(half, 6.0)))[0]
            own = np.interp(f, edge['frequencies'], edge['mtf'])
            off.append(np.interp(grid, f, m - own))
        if not off:
            sys.exit(f'{lens} {aperture} focus {focus}: quickMTF takes none of {len(edges)} edges for one')
        mean = np.median(off, axis=0)
        largest = max(np.abs(o).max() for o in off)
        worst = max(worst, np.abs(mean).max())
        means.append(mean)
        print(f'{lens:20} {aperture:6} focus {focus:6} {len(off):2} of {len(edges):2} edges   median difference up to Nyquist: largest {np.abs(mean).max():.4f}, '
              f'rms {np.sqrt((mean ** 2).mean()):.4f}; one edge: {largest:.4f}')
print(f'largest median difference {worst:.4f} (asked: 0.02)')
sys.exit(int(worst > 0.02))
