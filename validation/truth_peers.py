"""Truth of a rendered picture held against other programs: numpy, OpenCV and OpenEXR.

    pip install numpy pillow opencv-python-headless OpenEXR
    python validation/truth_peers.py [DIOPTER] [FOLDER]

- ST maps: what `distort.exr` does, `undistort.exr` undoes (the exit code is 1 where that is not so within 0.02 px).
- Flow: the next frame of a moving camera with a rolling shutter, through a distorting zoom, warped back by the flow (cv2.remap) is the frame itself, within the noise of the rendering.
"""

import os
import subprocess
import sys
import tempfile

import cv2
import numpy as np
import OpenEXR

from blocks_scene import scene

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DIOPTER = os.path.abspath(sys.argv[1]) if len(sys.argv) > 1 else os.path.join(ROOT, "target/release/diopter")


def run(*arguments):
    done = subprocess.run([DIOPTER, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, arguments))}\n{done.stderr}")
    return done.stdout


def planes(path):
    file = OpenEXR.File(path, separate_channels=True)
    return {name: channel.pixels for name, channel in file.channels().items()}, file.header()


def st_maps(folder):
    """Lenses whose maps do not undo each other within 0.02 px."""
    failed = []
    for lens, flags in [("kit-zoom-18-55mm", ["--focal-length", "18mm", "--film", "22.3x14.9"]), ("distagon-28mm-f2", []), ("fisheye-15mm-f2.8", []), ("double-gauss-50mm", ["--shift", "4mm"]),
                        ("tessar-50mm-f2.8", ["--tilt", "6deg"]), ("zoom-70-200mm-f2.8", ["--focal-length", "100mm"]), ("phone-5.6mm-f3.5", ["--film", "5.76x3.84"])]:
        w, h = 600, 400
        paths = [os.path.join(folder, n) for n in ("distort.exr", "undistort.exr")]
        run("lens", "calibrate", lens, *flags, "--size", f"{w}x{h}", "-o", paths[0], "-o", paths[1])
        (there, _), (back, _) = planes(paths[0]), planes(paths[1])
        to_px = lambda c: (c["R"].astype(np.float64) * w - 0.5, (1 - c["G"].astype(np.float64)) * h - 0.5)
        (sx, sy), (ux, uy) = to_px(there), to_px(back)
        yy, xx = np.mgrid[:h, :w]
        # Straight places inside the straight picture, where all four neighbours of the way back are known.
        good = (there["A"] > 0.5) & (sx > 1) & (sy > 1) & (sx < w - 2) & (sy < h - 2)
        known = cv2.remap((back["A"] > 0.5).astype(np.float32), sx.astype(np.float32), sy.astype(np.float32), cv2.INTER_LINEAR)
        good &= known > 0.999
        at = [bilinear(c, sx[good], sy[good]) for c in (ux, uy)]
        off = np.hypot(at[0] - xx[good], at[1] - yy[good])
        print(f"ST maps {lens} {' '.join(flags)}: {good.sum()} pixels, forward and back within {off.max():.4f} px")
        failed += [lens] if off.max() >= 0.02 else []
        assert good.sum() > 0.2 * w * h
    return failed


def bilinear(c, x, y):
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    f, g = x - i, y - j
    return (c[j, i] * (1 - f) + c[j, i + 1] * f) * (1 - g) + (c[j + 1, i] * (1 - f) + c[j + 1, i + 1] * f) * g


def shot_file(folder, name, at, extra="", path=None, spp=32, channels="position"):
    where = f'[[camera.path]]\n{path}' if path else ""
    text = f"""
[scene]
file = "blocks.gltf"
light = "none"
at = {at}
[camera]
{extra}
{where}
[exposure]
mode = "M"
aperture = "f/8"
iso = 100
shutter = "1/200"
[focus]
distance = "1.2 m"
[render]
size = "600x400"
spp = {spp}
integrator = "path"
denoise = false
truth_channels = "{channels}"
"""
    file = os.path.join(folder, f"{name}.toml")
    # Sections first, then the path: a table of tables may stand anywhere.
    with open(file, "w") as f:
        f.write(text)
    return file


def flow(folder):
    camera = 'lens = "kit-zoom-18-55mm"\nfocal_length = "18 mm"\nformat = "22.3x14.9"'
    path = "time = 0\nlook_from = [-0.10, 0.75, 1.05]\nlook_at = [-0.05, 0.05, 0]\n[[camera.path]]\ntime = \"1 s\"\nlook_from = [0.25, 0.85, 0.95]\nlook_at = [0.30, 0.12, 0.05]"
    shutter = '[shutter]\nkind = "rolling"\nreadout = "25 ms"\n'
    frames = []
    for k in range(2):
        file = shot_file(folder, f"flow{k}", (k + 1) / 24, camera, path, spp=16, channels="position,flow")
        with open(file, "a") as f:
            f.write(shutter)
        out = file.replace(".toml", ".exr")
        run("expose", file, "-o", out)
        frames.append(planes(out)[0])
    here, there = frames
    h, w = here["Z"].shape
    yy, xx = np.mgrid[:h, :w].astype(np.float32)
    mx, my = xx + here["forward.u"], yy + here["forward.v"]
    inside = np.isfinite(mx) & (mx > 1) & (my > 1) & (mx < w - 2) & (my < h - 2)
    mx, my = np.where(inside, mx, 0).astype(np.float32), np.where(inside, my, 0).astype(np.float32)
    warp = lambda c: cv2.remap(np.nan_to_num(c, nan=1e3, posinf=1e3), mx, my, cv2.INTER_CUBIC)
    # The scene stands: what is seen there must be the same point, else it is hidden in one of the frames.
    point = lambda f: np.stack([f[f"P.{a}"] for a in "XYZ"], -1)
    there_point = np.stack([cv2.remap(np.nan_to_num(there[f"P.{a}"], nan=1e3), mx, my, cv2.INTER_LINEAR) for a in "XYZ"], -1)
    off = np.linalg.norm(there_point - point(here), axis=-1)
    seen = inside & np.isfinite(off) & (off < 0.01)
    seen = cv2.erode(seen.astype(np.uint8), np.ones((5, 5))).astype(bool)
    first, second = here["G"], warp(there["G"])
    error = (second - first)[seen]
    # The renderer's noise of both frames, by the difference of two independent halves of the samples.
    noise = np.sqrt(np.mean(here["half_difference.G"][seen] ** 2) + np.mean(there["half_difference.G"][seen] ** 2))
    error = np.sqrt(np.mean(error**2))
    contrast = first[seen].std() / first[seen].mean()
    unwarped = (there["G"] - first)[seen]
    length = np.hypot(here["forward.u"], here["forward.v"])[seen]
    shift = np.median(off[seen])
    print(f"flow: {seen.sum()} pixels move by {length.mean():.1f} px (up to {length.max():.1f}), contrast {contrast:.2f}: the next frame warped back differs by {error:.1f} e- rms "
          f"({error / noise:.2f} of the noise of both renderings), unwarped by {np.sqrt(np.mean(unwarped**2)):.0f}; points of the surface agree within {1000 * shift:.3f} mm in the median")
    assert seen.sum() > 0.3 * h * w and length.mean() > 3 and error < 1.2 * noise and contrast > 0.2


def main():
    folder = sys.argv[2] if len(sys.argv) > 2 else tempfile.mkdtemp()
    os.makedirs(folder, exist_ok=True)
    failed = st_maps(folder)
    scene(folder, smooth=True)
    flow(folder)
    print(f"ST maps beyond 0.02 px: {failed}" if failed else "ok")
    sys.exit(bool(failed))


main()
