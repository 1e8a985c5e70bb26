"""Gaussian splats through a pinhole beside two other ways to draw them, on a cloud that is generated.

    pip install numpy OpenEXR
    python validation/splats_peers.py [--diopter target/release/diopter] [--count 2000] [--size 128] [--spp 256] [--keep FOLDER]

"EWA": each Gaussian projected to the picture in affine approximation, sorted by the depth of its centre and composited from front to back, as the
rasteriser of Kerbl et al. 2023 does (Zwicker et al. 2001), without its widening by 0.3 pixels². "Rays": each pixel's Gaussians at the point of their
largest response, sorted by its distance, as Moenne-Loccoz et al. 2024 do. Colours are linearised first and composited as light, as ours are. Pixels are
means of 2 × 2 places. The mean of ours is to be within 1 % of both. (gsplat and the original rasteriser need CUDA and composite display values.)
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

WHITE = 80.0
FOV_DEG = 40.0
EYE = np.array([0.8, 0.6, 6.0])
# Ours from the axes of the file.
AXES = np.diag([1.0, -1.0, -1.0])
LEAST, MOST = 1 / 255, 0.99


def cloud(count):
    rng = np.random.default_rng(7)
    points = rng.normal(size=(count, 3)) * [0.7, 0.5, 0.7]
    scales = rng.uniform(-4.5, -2.4, (count, 3))
    rotations = rng.normal(size=(count, 4))
    opacities = rng.uniform(-2, 4, count)
    dc = rng.uniform(-1.2, 1.5, (count, 3))
    rest = rng.normal(size=(count, 3, 15)) * 0.12
    return points, scales, rotations, opacities, dc, rest


def write(path, splats):
    points, scales, rotations, opacities, dc, rest = splats
    names = [*"xyz", *(f"f_dc_{i}" for i in range(3)), *(f"f_rest_{i}" for i in range(45)), "opacity"]
    names += [f"scale_{i}" for i in range(3)] + [f"rot_{i}" for i in range(4)]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {n}\n" for n in names) + "end_header\n"
    rows = np.concatenate([points, dc, rest.reshape(len(points), 45), opacities[:, None], scales, rotations], 1)
    Path(path).write_bytes(head.encode() + rows.astype("<f4").tobytes())


def rotation(q):
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        1,
    )


def colors(directions, dc, rest):
    """Linear sRGB, white 1, along unit directions of view in the axes of the file."""
    x, y, z = np.moveaxis(directions, -1, 0)
    xx, yy, zz = x * x, y * y, z * z
    basis = np.stack(
        [
            -0.4886025119 * y, 0.4886025119 * z, -0.4886025119 * x,
            1.0925484306 * x * y, -1.0925484306 * y * z, 0.3153915653 * (2 * zz - xx - yy), -1.0925484306 * x * z, 0.5462742153 * (xx - yy),
            -0.5900435899 * y * (3 * xx - yy), 2.8906114426 * x * y * z, -0.4570457995 * y * (4 * zz - xx - yy),
            0.3731763326 * z * (2 * zz - 3 * xx - 3 * yy), -0.4570457995 * x * (4 * zz - xx - yy), 1.4453057213 * z * (xx - yy),
            -0.5900435899 * x * (xx - 3 * yy),
        ],
        -1,
    )  # fmt: skip
    display = np.maximum(0.5 + 0.2820947918 * dc + np.einsum("...k,...ck->...c", basis, rest), 0)
    return np.where(display <= 0.04045, display / 12.92, ((display + 0.055) / 1.055) ** 2.4)


def camera():
    """Axes of the camera (right, up, back) and its place, in the axes of the file."""
    back = EYE / np.linalg.norm(EYE)
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back]) @ AXES, AXES @ EYE


def ewa(splats, side):
    points, scales, rotations, opacities, dc, rest = splats
    axes, eye = camera()
    focal = 0.5 * side / np.tan(np.radians(FOV_DEG / 2))
    to = (points - eye) @ axes.T
    depth = -to[:, 2]
    r = axes @ rotation(rotations)
    sigma = np.einsum("nij,nj,nkj->nik", r, np.exp(2 * scales), r)
    jacobian = np.zeros((len(points), 2, 3))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = focal / depth
    jacobian[:, 0, 2], jacobian[:, 1, 2] = focal * to[:, 0] / depth**2, focal * to[:, 1] / depth**2
    flat = jacobian @ sigma @ jacobian.transpose(0, 2, 1)
    inverse = np.linalg.inv(flat)
    middle = side / 2 + focal * to[:, :2] / depth[:, None] * [1, -1]
    inverse[:, 0, 1] *= -1
    inverse[:, 1, 0] *= -1
    view = (points - eye) / np.linalg.norm(points - eye, axis=1, keepdims=True)
    color, opacity = colors(view, dc, rest), 1 / (1 + np.exp(-opacities))
    picture, left = np.zeros((side, side, 3)), np.ones((side, side))
    for i in np.argsort(depth):
        if opacity[i] <= LEAST or depth[i] <= 0:
            continue
        reach = np.sqrt(2 * np.log(opacity[i] / LEAST) * np.diag(flat[i]))
        low = np.clip(np.floor(middle[i] - reach - 1), 0, side).astype(int)
        high = np.clip(np.ceil(middle[i] + reach + 1), 0, side).astype(int)
        if (low >= high).any():
            continue
        x, y = np.arange(low[0], high[0]) + 0.5 - middle[i, 0], (np.arange(low[1], high[1]) + 0.5 - middle[i, 1])[:, None]
        q = inverse[i]
        alpha = np.minimum(opacity[i] * np.exp(-0.5 * (q[0, 0] * x * x + 2 * q[0, 1] * x * y + q[1, 1] * y * y)), MOST)
        alpha[alpha < LEAST] = 0
        here = np.s_[low[1] : high[1], low[0] : high[0]]
        picture[here] += (left[here] * alpha)[..., None] * color[i]
        left[here] *= 1 - alpha
    return picture


def rays(splats, side):
    points, scales, rotations, opacities, dc, rest = splats
    axes, eye = camera()
    tan = np.tan(np.radians(FOV_DEG / 2))
    to_units = np.exp(-scales)[:, :, None] * rotation(rotations).transpose(0, 2, 1)
    origin = np.einsum("nij,nj->ni", to_units, eye - points)
    opacity = 1 / (1 + np.exp(-opacities))
    picture = np.zeros((side, side, 3))
    at = ((np.arange(side) + 0.5) / side * 2 - 1) * tan
    for row in range(side):
        d = np.stack([at, np.full(side, -at[row]), np.full(side, -1.0)], 1) @ axes
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        direction = np.einsum("nij,pj->pni", to_units, d)
        t = -(origin * direction).sum(-1) / (direction**2).sum(-1)
        distance2 = ((origin + t[..., None] * direction) ** 2).sum(-1)
        alpha = np.minimum(opacity * np.exp(-0.5 * distance2), MOST)
        alpha[(alpha < LEAST) | (t <= 0)] = 0
        pixel, splat = np.nonzero(alpha)
        order = np.lexsort((t[pixel, splat], pixel))
        pixel, splat = pixel[order], splat[order]
        color, alpha = colors(d[pixel], dc[splat], rest[splat]), alpha[pixel, splat]
        starts = np.searchsorted(pixel, np.arange(side + 1))
        for p in range(side):
            own = slice(starts[p], starts[p + 1])
            before = np.concatenate([[1.0], np.cumprod(1 - alpha[own])])[:-1]
            picture[row, p] = (before * alpha[own]) @ color[own]
    return picture


def ours(path, folder, side, spp, diopter):
    import OpenEXR

    out = Path(folder) / "out.exr"
    place = ",".join(map(str, EYE))
    command = [diopter, "expose", str(path), "--radiance", "--rgb", "--lens", "pinhole", "--fov", f"{FOV_DEG}deg", "--spp", str(spp)]
    command += ["--size", f"{side}x{side}", "--look-from", place, "--look-at", "0,0,0", "--light", "none", "-o", str(out)]
    subprocess.run(command, check=True)
    with OpenEXR.File(str(out)) as file:
        return np.array(file.channels()["RGB"].pixels, dtype=np.float64)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--diopter", default="target/release/diopter", help="empty: the other two alone")
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--keep", help="folder for the cloud and the picture")
    a = parser.parse_args()
    splats = cloud(a.count)
    halved = lambda p: p.reshape(a.size, 2, a.size, 2, 3).mean((1, 3)) * WHITE
    pictures = {"EWA": halved(ewa(splats, 2 * a.size)), "rays": halved(rays(splats, 2 * a.size))}
    means = {name: p.mean((0, 1)) for name, p in pictures.items()}
    print("EWA / rays:", means["EWA"] / means["rays"], f"(mean {means['rays']} cd/m²)")
    if not a.diopter:
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(a.keep or temporary)
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "cloud.ply"
        write(path, splats)
        mine = ours(path, folder, a.size, a.spp, a.diopter)
    bad = False
    for name, picture in pictures.items():
        ratio = mine.mean((0, 1)) / means[name]
        # Blocks of 8 x 8 pixels show what is in the wrong place.
        n = a.size // 8
        block = lambda p: p[: 8 * n, : 8 * n].reshape(n, 8, n, 8, 3).mean((1, 3, 4))
        difference = np.sqrt(np.mean((block(mine) - block(picture)) ** 2)) / block(picture).mean()
        bad |= bool((np.abs(ratio - 1) > 0.01).any())
        print(f"ours / {name}: {ratio}, blocks differ by {100 * difference:.2f} % of the mean (rms)")
    sys.exit("the means differ by more than 1 %" if bad else 0)


main()
