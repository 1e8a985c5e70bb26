"""A pbrt-v4 scene against a reference picture: means a channel and a z-test of every pixel by the claimed variance.

    python validation/pbrt_reference.py scene-v4.pbrt reference.exr [--size 512] [--spp 64] [--depth 65] [--diopter target/release/diopter]

Needs numpy and OpenEXR (pip). Both are in linear sRGB; a reference of larger size is averaged down. Pixels at edges and on lamps are
left out of the z-test: the reference was filtered otherwise.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR

BLOCK = 16


def read(path):
    with OpenEXR.File(str(path)) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("reference")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--depth", type=int, default=65)
    parser.add_argument("--diopter", default="target/release/diopter")
    a = parser.parse_args()
    reference = read(a.reference)["RGB"].astype(np.float64)
    rows, columns = reference.shape[:2]
    height, width = a.size, a.size * columns // rows
    k = rows // height
    reference = reference[: height * k, : width * k].reshape(height, k, width, k, 3).mean((1, 3))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.exr"
        size = f"{width}x{height}"
        command = [a.diopter, "expose", a.scene, "--radiance", "--rgb", "--spp", str(a.spp), "--max-depth", str(a.depth)]
        subprocess.run([*command, "--size", size, "-o", str(out)], check=True)
        ours = read(out)
    mean, variance = ours["RGB"].astype(np.float64), ours["variance"].astype(np.float64)
    print("ours / reference:", mean.mean((0, 1)) / reference.mean((0, 1)))
    light = reference.mean(-1)
    slope = sum(np.abs(g) for g in np.gradient(light))
    flat = (slope < 0.03 * light.mean()) & (light < 3 * np.median(light))
    # One pixel's variance is itself an estimate from two halves: blocks of them.
    h, w = height // BLOCK * BLOCK, width // BLOCK * BLOCK
    blocks = variance[:h, :w].reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK, 3).mean((1, 3))
    sigma = np.sqrt(blocks.repeat(BLOCK, 0).repeat(BLOCK, 1))
    z = ((mean - reference)[:h, :w] / sigma)[flat[:h, :w]]
    print(f"{flat.mean():.2f} of the pixels; z: mean {z.mean(0)}, rms {np.sqrt((z**2).mean(0))}, beyond 3: {(np.abs(z) > 3).mean(0)}")


main()
