"""Noise of an even field behind lenses that disperse, where landings of colours are foretold (sobol) and left to chance (jittered).

    pip install numpy OpenEXR
    python validation/dispersion_noise.py [DIOPTER]                 # from the root of the project, after cargo build --release

For each lens and pixel pitch: relative deviation from pixel to pixel times the root of the samples, of red, green and blue.
"""
import os, subprocess, sys, tempfile

import numpy as np
import OpenEXR

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DIOPTER = os.path.abspath(sys.argv[1]) if len(sys.argv) > 1 else os.path.join(ROOT, 'target/release/diopter')
SIDE, SPP = 48, 64
LENSES = [('double-gauss-50mm', 'f/4'), ('tessar-50mm-f2.8', 'f/4'), ('kit-zoom-18-55mm', 'f/5.6'), ('planar-50mm-f1.4', 'f/4')]


def noise(lens, aperture, pitch_um, sampler, folder):
    path = os.path.join(folder, 'field.exr')
    side = SIDE * pitch_um / 1000
    subprocess.run([DIOPTER, 'expose', 'flat-field', '--body', 'canon-t2i', '--format', f'{side}x{side}', '--size', f'{SIDE}x{SIDE}', '--spp', str(SPP),
                    '--shutter', '1/100', '--lens', lens, '--aperture', aperture, '--focus', '1m', '--sampler', sampler, '-o', path],
                   check=True, capture_output=True)
    mean = np.asarray(OpenEXR.File(path).channels()['RGB'].pixels, float)[2:-2, 2:-2]
    return mean.std((0, 1)) / mean.mean((0, 1)) * SPP ** 0.5


with tempfile.TemporaryDirectory() as folder:
    for lens, aperture in LENSES:
        for pitch_um in (4, 12, 40):
            known, chance = (noise(lens, aperture, pitch_um, s, folder) for s in ('sobol', 'jittered'))
            print(f'{lens:20} {aperture:6} {pitch_um:3} µm   foretold {known.round(3)}   left to chance {chance.round(3)}', flush=True)
