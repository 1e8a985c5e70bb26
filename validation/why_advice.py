"""What `diopter why` advises, done: the same shot with the change applied, photographed and measured.

    pip install numpy rawpy
    python validation/why_advice.py [DIOPTER]                    # from the root of the project, after cargo build --release

For each shot every line of advice that is a setting (stops, focus, time) is followed. Blur: frequency of half contrast of the edges around the middle
(`measure mtf` on the raw file). Noise: mean over deviation of raw values in the middle of the dark square, where everything is even.
"""
import json, os, re, subprocess, sys, tempfile

import numpy as np
import rawpy

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DIOPTER = os.path.abspath(sys.argv[1]) if len(sys.argv) > 1 else os.path.join(ROOT, 'target/release/diopter')
COMMON = ['slanted-edges', '--body', 'imx249', '--size', '300x188', '--spp', '256']
SHOTS = [
    ['--lens', 'double-gauss-50mm', '--aperture', 'f/2.8', '--focus', '0.95m', '--shutter', '1/500', '--iso', '100'],
    ['--lens', 'double-gauss-50mm', '--aperture', 'f/4', '--focus', '1.08m', '--shutter', '1/500', '--iso', '200'],
    ['--lens', 'tessar-50mm-f2.8', '--aperture', 'f/5.6', '--focus', '0.9m', '--shutter', '1/1000', '--iso', '400'],
    ['--lens', 'thin', '--focal-length', '50mm', '--aperture', 'f/2', '--focus', '0.97m', '--shutter', '1/2000', '--iso', '100'],
]


def run(*words):
    done = subprocess.run([DIOPTER, *words], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f'{" ".join(words)}: {done.stderr}')
    return done.stdout


def measured(words, folder):
    path = os.path.join(folder, 'a.dng')
    run('shoot', *COMMON, *words, '-o', path)
    edges = json.loads(run('measure', 'mtf', path, '--reach', '14', '--json'))['edges']
    raw = rawpy.imread(path)
    values = raw.raw_image.astype(float) - raw.black_level_per_channel[0]
    h, w = values.shape
    near = [e['mtf50'] for e in edges if np.hypot(e['middle'][0] - w / 2, e['middle'][1] - h / 2) < 0.2 * w and e['mtf50']]
    flat = values[h // 2 - 18:h // 2 + 18, w // 2 - 18:w // 2 + 18]
    return np.mean(near), flat.mean() / flat.std(ddof=1)


def changed(words, advice):
    """The shot's flags with the change."""
    words = list(words)
    put = lambda flag, value: words.__setitem__(words.index(flag) + 1, value)
    said = advice['change']
    if m := re.search(r'\((f/[\d.]+)\)', said):
        # The line shows rounded stops: the exact one is by how many stops.
        stops = {'one': 1, 'two': 2}[said.split()[0]] * (1 if 'down' in said else -1)
        put('--aperture', f'f/{float(words[words.index("--aperture") + 1][2:]) * 2 ** (stops / 2)}')
    elif m := re.match(r'focus here \((.+?) ?m\)', said):
        put('--focus', f'{m[1]}m')
    elif said.startswith('four times the time'):
        one, over = words[words.index('--shutter') + 1].split('/')
        put('--shutter', f'{4 * float(one) / float(over)}s')
    else:
        return None
    put('--iso', str(advice['iso']))
    return words


worst = [0.0, 0.0]
with tempfile.TemporaryDirectory() as folder:
    for words in SHOTS:
        shot = os.path.join(folder, 'shot.toml')
        run('shoot', *COMMON, *words, '--spp', '1', '-o', os.path.join(folder, 'b.dng'), '--save-shot', shot)
        text = open(shot).read()
        open(shot, 'w').write(re.sub(r'spp = \d+', 'spp = 256', text))
        told = json.loads(run('why', shot, '--at', '0.5,0.5', '--json'))
        sharp, clean = measured(words, folder)
        print(f'{" ".join(words)}\n    MTF50 {told["blur"]["mtf50_per_px"]:.4f} told, {sharp:.4f} measured; signal to noise {told["noise"]["signal_to_noise"]:.1f} told, {clean:.1f} measured')
        for advice in told['advice']:
            new = changed(words, advice)
            if new is None:
                continue
            then, noisy = measured(new, folder)
            blur, noise = sharp / then, clean / noisy
            off = [blur / advice['blur'] - 1, noise / advice['noise'] - 1]
            worst = [max(a, abs(b)) for a, b in zip(worst, off)]
            print(f'    {advice["change"]:46} blur x{advice["blur"]:.3f} told, x{blur:.3f} done ({100 * off[0]:+.1f} %)   noise x{advice["noise"]:.3f} told, x{noise:.3f} done ({100 * off[1]:+.1f} %)')
print(f'largest difference: blur {100 * worst[0]:.1f} %, noise {100 * worst[1]:.1f} %')
sys.exit(worst[0] > 0.08 or worst[1] > 0.1)
