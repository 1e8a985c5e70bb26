"""Slanted edges of our photographs, measured by quickMTF (C. Asplund's SFR, as packaged by L. Rui) beside `diopter measure mtf`.

    pip install numpy scipy matplotlib tifffile imagecodecs && pip install --no-deps quickmtf     # 2023.3.3
    python validation/slanted_edges.py [DIOPTER]                 # from the root of the project, after cargo build --release

Both get the same file (16 bits, linear) and the same region of it. quickMTF means to undo its numerical derivative, but cuts the correction off at 1, so
that it corrects nothing; and it says nothing of the width of its bins. Both are undone here: division by sinc(4 f / (d o)) and sinc(f / o), with d = 4 for
differences of neighbours and o = 4 bins a pixel.
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
SHOTS = [
    ('double-gauss-50mm', 'f/2.8', '1m'),
    ('double-gauss-50mm', 'f/8', '1m'),
    ('double-gauss-50mm', 'f/2.8', '0.97m'),   # out of focus
    ('tessar-50mm-f2.8', 'f/4', '1m'),
]


def theirs(picture):
    mtf, _ = sfr_mtfcal().calc_sfr(picture, oversampling=OVERSAMPLING, difference_scheme='backward')
    f, m = mtf[:, 0], mtf[:, 1]
    return f, m / np.sinc(f / OVERSAMPLING) / np.sinc(4 * f / (4 * OVERSAMPLING))


worst, means = 0.0, []
with tempfile.TemporaryDirectory() as folder:
    path = os.path.join(folder, 'edges.tif')
    for lens, aperture, focus in SHOTS:
        subprocess.run([DIOPTER, 'shoot', 'slanted-edges', '--body', 'imx249', '--lens', lens, '--aperture', aperture, '--focus', focus,
                        '--size', '600x376', '--spp', '256', '--tone', 'linear', '--set', 'output.encoding=linear', '-o', path],
                       check=True, capture_output=True)
        said = subprocess.run([DIOPTER, 'measure', 'mtf', path, '--encoding', 'linear', '--window', 'hann', '--json'], check=True, capture_output=True, text=True)
        edges = json.loads(said.stdout)['edges']
        picture = tifffile.imread(path).astype(float)
        luminance = picture @ np.array([0.2126, 0.7152, 0.0722]) if picture.ndim == 3 else picture
        off = []
        for edge in edges:
            r = edge['region']
            f, m = theirs(luminance[r['y']:r['y'] + r['height'], r['x']:r['x'] + r['width']])
            own = np.interp(f, edge['frequencies'], edge['mtf'])
            upto = f <= 0.5
            off.append((m - own)[upto])
        grid = np.linspace(0, 0.5, 51)
        mean = np.mean([np.interp(grid, f[upto], o) if len(o) == upto.sum() else np.interp(grid, np.linspace(0, 0.5, len(o)), o) for o in off], axis=0)
        largest = max(np.abs(o).max() for o in off)
        worst = max(worst, np.abs(mean).max())
        means.append(mean)
        print(f'{lens:20} {aperture:6} focus {focus:6} {len(edges):2} edges   mean difference up to Nyquist: largest {np.abs(mean).max():.4f}, '
              f'rms {np.sqrt((mean ** 2).mean()):.4f}; one edge: {largest:.4f}')
print(f'largest mean difference {worst:.4f} (asked: 0.02)')
sys.exit(worst > 0.02)
