"""The quick look beside the traced picture, by the FLIP of NVIDIA (Andersson et al. 2020).

    pip install flip-evaluator pillow numpy
    python quick_look_flip.py DIOPTER [SCENE ...]

Both pictures are developed alike, without noise of the renderer that would count as a difference: many samples.
"""
import subprocess
import sys
import tempfile
from pathlib import Path

import flip_evaluator
import numpy
from PIL import Image

diopter, scenes = sys.argv[1], sys.argv[2:] or ["still-life", "rolling-ball", "color-chart"]
with tempfile.TemporaryDirectory() as folder:
    for scene in scenes:
        pictures = []
        for name, more in [("traced", []), ("quick", ["--quick"])]:
            path = Path(folder) / f"{name}.png"
            subprocess.run([diopter, "shoot", scene, "--size", "300x200", "--spp", "192", "--aperture", "f/2", "--denoise", "on", "--frozen",
                            *more, "-o", path], check=True, stderr=subprocess.DEVNULL)
            pictures.append(numpy.asarray(Image.open(path).convert("RGB"), dtype=numpy.float32) / 255)
        _, mean, _ = flip_evaluator.evaluate(*pictures, "LDR", applyMagma=False)
        print(f"{scene}: FLIP {mean:.4f}")
