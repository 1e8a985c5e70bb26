"""Peak signal-to-noise of our demosaic methods beside those of colour-demosaicing and LibRaw, on the same synthetic mosaics.

    pip install numpy tifffile OpenEXR scikit-image colour-demosaicing rawpy
    python validation/demosaic.py [DIOPTER] [PICTURE.png ...]

Pictures: those that scikit-image carries (codes taken as light, as the literature does with the Kodak set), halved once so that their own demosaic does
not show; a zone plate in three colours; any given. Borders of 10 pixels are left out. CPSNR over all channels, dB.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import colour_demosaicing as cd
import numpy as np
import OpenEXR
import rawpy
import skimage
import tifffile

DIOPTER = sys.argv[1] if len(sys.argv) > 1 else "target/release/diopter"
GREY_GAIN = 0.18 * 78 / 10
BORDER = 10
PATTERNS = {"RGGB": [0, 1, 1, 2], "x-trans": [int(c) for c in "110112112110201021112110110112021201"]}
OURS = ["gbtf", "rcd", "malvar-he-cutler", "bilinear", "linear"]
XYZ_TO_SRGB = [3.2404542, -1.5371385, -0.4985314, -0.9692660, 1.8760108, 0.0415560, 0.0556434, -0.2040259, 1.0572252]


def write_dng(path, mosaic, pattern, side):
    """A minimal DNG of 16-bit numbers, black 1024, white 61440, whose colours are sRGB's."""
    dn = np.round(1024 + np.clip(mosaic, 0, 1) * (61440 - 1024)).astype(np.uint16)
    rational = lambda v: [x for m in v for x in (int(round(m * 10**7)), 10**7)]
    tags = [
        (50706, "B", 4, [1, 4, 0, 0], True),
        (50708, "s", 0, "synthetic", True),
        (33421, "H", 2, [side, side], True),
        (33422, "B", side * side, pattern, True),
        (50714, "H", 1, 1024, True),
        (50717, "H", 1, 61440, True),
        (50721, "2i", 9, rational(XYZ_TO_SRGB), True),
        (50728, "2I", 3, [1, 1, 1, 1, 1, 1], True),
        (50778, "H", 1, 21, True),
    ]
    tifffile.imwrite(path, dn, photometric="CFA", extratags=tags, metadata=None)


def ours(dng, method, folder):
    out = os.path.join(folder, "out.exr")
    command = [DIOPTER, "develop", dng, "-o", out, "--preset", "plain", "--demosaic", method]
    subprocess.run(command, check=True, capture_output=True)
    with OpenEXR.File(out) as f:
        return f.channels()["RGB"].pixels.astype(float) / GREY_GAIN


def libraw(dng, algorithm):
    with rawpy.imread(dng) as raw:
        p = raw.postprocess(demosaic_algorithm=algorithm, gamma=(1, 1), no_auto_bright=True, output_bps=16, use_camera_wb=True,
                            output_color=rawpy.ColorSpace.raw, user_flip=0, adjust_maximum_thr=0, highlight_mode=rawpy.HighlightMode.Clip)
    return p / 65535.0


def psnr(a, b):
    c = slice(BORDER, -BORDER)
    return 10 * np.log10(1 / np.mean((np.clip(a, 0, 1)[c, c] - b[c, c]) ** 2))


def zone_plate(n=512):
    y, x = np.mgrid[:n, :n] - n / 2
    r2 = x * x + y * y
    # Up to 0.35 cycles a pixel, green; red and blue a little turned in phase and weaker, as colours of things are.
    wave = lambda s: 0.5 + 0.4 * np.cos(np.pi * 0.7 / n * r2 * s)
    return np.stack([0.9 * wave(1), wave(1), 0.2 + 0.7 * wave(1)], -1)


def pictures():
    for name in ["astronaut", "coffee", "chelsea", "rocket"]:
        p = getattr(skimage.data, name)().astype(float) / 255
        h, w = p.shape[0] // 12 * 12, p.shape[1] // 12 * 12
        p = p[:h, :w]
        yield name, p
        yield name + "/2", (p.reshape(h // 2, 2, w // 2, 2, 3).mean((1, 3)))
    yield "zone plate", zone_plate(516)
    for path in sys.argv[2:]:
        p = skimage.io.imread(path)[..., :3].astype(float)
        p /= 255 if p.max() < 256 else 65535
        yield Path(path).stem, p[: p.shape[0] // 12 * 12, : p.shape[1] // 12 * 12]


def main():
    table, names = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for name, p in pictures():
            names.append(name)
            for pattern, cells in PATTERNS.items():
                side = int(len(cells) ** 0.5)
                h, w = p.shape[:2]
                index = np.array(cells).reshape(side, side)[np.arange(h)[:, None] % side, np.arange(w) % side]
                mosaic = np.take_along_axis(p, index[..., None], 2)[..., 0]
                dng = os.path.join(folder, "m.dng")
                write_dng(dng, mosaic, cells, side)
                for method in OURS if side == 2 else ["linear", "bilinear"]:
                    table.setdefault(f"ours {pattern} {method}", []).append(psnr(ours(dng, method, folder), p))
                if side == 2:
                    table.setdefault("Menon 2007", []).append(psnr(cd.demosaicing_CFA_Bayer_Menon2007(mosaic, "RGGB"), p))
                    table.setdefault("Malvar 2004", []).append(psnr(cd.demosaicing_CFA_Bayer_Malvar2004(mosaic, "RGGB"), p))
                    table.setdefault("bilinear", []).append(psnr(cd.demosaicing_CFA_Bayer_bilinear(mosaic, "RGGB"), p))
                for algorithm in ["AHD", "DHT", "DCB", "PPG", "VNG"] if side == 2 else []:
                    got = libraw(dng, getattr(rawpy.DemosaicAlgorithm, algorithm))
                    if got.shape == p.shape:
                        table.setdefault(f"LibRaw {pattern} {algorithm}", []).append(psnr(got, p))
    print(f"{'':34}" + "".join(f"{n:>13}" for n in names) + f"{'mean':>9}")
    for row, values in table.items():
        print(f"{row:34}" + "".join(f"{v:13.2f}" for v in values) + f"{np.mean(values):9.2f}")


main()
