"""Truth of a rendered picture held against other programs: numpy, OpenCV and OpenEXR.

    pip install numpy pillow opencv-python-headless OpenEXR
    python validation/truth_peers.py [DIOPTER] [st|rays|flow|stereo|masks ...]

- ST maps: what `distort.exr` does, `undistort.exr` undoes (the exit code is 1 where that is not so within 0.02 px).
- Ray tables: the ray of a pixel, sent through `lens trace` by its angle and its place in the pupil, lands where the pixel is, within 1e-6 of the focal length.
- Flow: the next frame of a moving camera with a rolling shutter, through a distorting zoom, warped back by the flow (cv2.remap) is the frame itself, within the noise of the rendering.
- Depth: a stereo pair through a real lens, points followed by cv2.calcOpticalFlowPyrLK and triangulated by cv2.triangulatePoints with the calibration that `shoot -o calibration.json` wrote, against the truth channel.
- Masks and boxes: faces of the scene rasterised by OpenCV's model of the camera, against `id`, `class` and the coverage of Cryptomatte.
"""

import json
import math
import os
import subprocess
import sys
import tempfile

import cv2
import numpy as np
import OpenEXR

from blocks_scene import faces, owners, scene

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DIOPTER = os.path.abspath(sys.argv[1]) if len(sys.argv) > 1 else os.path.join(ROOT, "target/release/diopter")


SIZE = (2400, 1600)  # of the ST maps


def run(*arguments):
    done = subprocess.run([DIOPTER, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, arguments))}\n{done.stderr}")
    return done.stdout


def planes(path):
    file = OpenEXR.File(path, separate_channels=True)
    return {name: channel.pixels for name, channel in file.channels().items()}, file.header()


def st_maps(folder):
    """Lenses whose maps do not undo each other within 0.02 px: every embedded lens, open, before a film of 3:2 in its image circle; and some shifted, tilted, stopped down."""
    full = math.hypot(36, 24)
    lenses = [("double-gauss-50mm", ["--shift", "4mm"]), ("tessar-50mm-f2.8", ["--tilt", "6deg"]), ("planar-50mm-f1.4", ["--aperture", "f/2.8"]), ("phone-5.6mm-f3.5", ["--film", "5.76x3.84"])]
    for lens in json.loads(run("lens", "list", "--json")):
        circle = (lens["image_circle_mm"] or full) / math.sqrt(13)
        lenses.append((lens["name"], ["--film", f"{3 * circle:.4f}x{2 * circle:.4f}"]))
    failed = []
    w, h = SIZE
    for lens, flags in lenses:
        paths = [os.path.join(folder, n) for n in ("distort.exr", "undistort.exr")]
        run("lens", "calibrate", lens, *flags, "--size", f"{w}x{h}", "-o", paths[0], "-o", paths[1])
        (there, _), (back, _) = planes(paths[0]), planes(paths[1])
        to_px = lambda c: (c["R"].astype(np.float64) * w - 0.5, (1 - c["G"].astype(np.float64)) * h - 0.5)
        (sx, sy), (ux, uy) = to_px(there), to_px(back)
        yy, xx = np.mgrid[:h, :w]
        # Straight places inside the straight picture, where all four neighbours of the way back are known (cv2.remap rounds places to 1/32 of a pixel).
        good = (there["A"] > 0.5) & (sx > 1) & (sy > 1) & (sx < w - 2) & (sy < h - 2)
        good[good] = bilinear((back["A"] > 0.5).astype(float), sx[good], sy[good]) > 1 - 1e-12
        at = [bilinear(c, sx[good], sy[good]) for c in (ux, uy)]
        off = np.hypot(at[0] - xx[good], at[1] - yy[good])
        print(f"ST maps {lens} {' '.join(flags)}: {good.mean() * 100:.0f} % of the picture, forward and back within {off.max():.4f} px, {(off > 0.02).sum()} pixels beyond 0.02", flush=True)
        failed += [lens] if off.max() >= 0.02 else []
        assert good.sum() > 0.2 * w * h
    return failed


def rays(folder):
    """Pixels of the middle column: field and pupil of `lens trace` lie in one plane."""
    worst = 0.0
    w, h = 61, 41
    for lens, film in [("double-gauss-50mm", (36, 24)), ("distagon-28mm-f2", (36, 24)), ("fisheye-15mm-f2.8", (36, 24)), ("phone-5.6mm-f3.5", (5.76, 3.84)), ("tessar-50mm-f2.8", (36, 24)), ("rf-16mm-f2.8", (36, 24)),
                       ("petzval-100mm", (36, 24)), ("hologon-15mm-f8", (36, 24)), ("planar-za-50mm-f1.4", (36, 24)), ("telephoto-250mm", (36, 24))]:
        path = os.path.join(folder, "rays.exr")
        run("lens", "calibrate", lens, "--focus", "inf", "--film", f"{film[0]}x{film[1]}", "--size", f"{w}x{h}", "--format", "ray-table", "-o", path)
        table, _ = planes(path)
        info = json.loads(run("lens", "info", lens, "--focus", "inf", "--json"))
        pupil_z, radius, focal = info["entrance_pupil_z_mm"], info["entrance_pupil_diameter_mm"] / 2, info["effective_focal_length_mm"]
        off, count = 0.0, 0
        for row in range(2, h, 6):
            column = w // 2
            value = lambda name: float(table[name][row, column])
            direction, origin = [np.array([value(f"{n}.{a}") for a in "XYZ"]) for n in ("direction", "origin")]
            if not np.isfinite(direction).all() or not direction.any():
                continue
            angle = np.degrees(np.arctan2(direction[1], direction[2]))
            # Where it crosses the plane of the entrance pupil, mm upwards.
            wanted = -1e3 * (origin[1] - origin[2] * direction[1] / direction[2])

            def traced(place):
                ray = json.loads(run("lens", "trace", lens, "--focus", "inf", "--field", repr(float(angle)), "--pupil", f"0,{place:.15f}", "--json"))
                _, y, z = ray["surfaces"][0]["point_mm"]
                return y + np.tan(np.radians(angle)) * (pupil_z - z), ray["end"]["film_mm"][1]

            low, high = wanted / radius - 0.05, wanted / radius + 0.05
            (a, fa), (b, fb) = traced(low), traced(high)
            for _ in range(12):
                place = high - (b - wanted) * (high - low) / (b - a)
                low, a, high = high, b, place
                b, landed = traced(place)
                if abs(b - wanted) < 1e-9:
                    break
            there = (row - (h - 1) / 2) / h * film[1]
            off, count = max(off, abs(landed - there) / focal), count + 1
        print(f"ray table {lens}: {count} pixels land within {off:.1e} focal lengths of their places by `lens trace`", flush=True)
        worst = max(worst, off)
        assert count >= 3
    assert worst < 1e-6


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


def straight(points, matrix, distortion):
    """Tangents of the directions of pixels, undistorted to rounding."""
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-12)
    points = np.asarray(points, float).reshape(-1, 1, 2)
    if hasattr(cv2, "undistortPointsIter"):
        return cv2.undistortPointsIter(points, matrix, distortion, None, None, criteria).reshape(-1, 2)
    return cv2.undistortPoints(points, matrix, distortion, criteria=criteria).reshape(-1, 2)


EYES = {"left": (-0.09, 0.85, 1.25), "right": (0.09, 0.85, 1.25)}
STEREO = 'lens = "double-gauss-50mm"\nformat = "36x24"\nlook_from = [{}, {}, {}]\nlook_at = [{}, 0.1, 0]\n'


def photographed(folder, eye, channels, spp):
    """A picture with truth channels, its header, K, distortion and pose (camera from world, OpenCV's axes)."""
    x, y, z = EYES[eye]
    file = shot_file(folder, eye, 0, STEREO.format(x, y, z, x), spp=spp, channels=channels)
    out, side = file.replace(".toml", ".exr"), file.replace(".toml", ".json")
    run("expose", file, "-o", out)
    run("shoot", file, "-o", side, "--size", "600x400")
    calibration = json.load(open(side))
    model = next(m for m in [calibration["model"], *calibration.get("models", [])] if m["name"] == "opencv5")
    matrix = np.array([[model["fx"], 0, model["cx"]], [0, model["fy"], model["cy"]], [0, 0, 1]])
    distortion = np.array([model["coefficients"][n] for n in ("k1", "k2", "p1", "p2", "k3")])
    pose = next(p for p in calibration["frames"][0]["poses"] if p["when"] == "middle")["world_from_camera_opengl"]
    return (*planes(out), matrix, distortion, np.diag([1, -1, -1, 1]) @ np.linalg.inv(np.array(pose)))


def stereo(folder):
    scene(folder)
    (left, _, ml, dl, pl), (right, _, mr, dr, pr) = (photographed(folder, eye, "depth,position", 128) for eye in EYES)
    grey = [np.clip(255 * (f["G"] / np.percentile(f["G"], 99.8)) ** (1 / 2.2), 0, 255).astype(np.uint8) for f in (left, right)]
    corners = cv2.goodFeaturesToTrack(grey[0], 4000, 0.02, 5).reshape(-1, 2)
    # Where they start to be looked for: where the truth says.
    world = np.stack([left[f"P.{a}"] for a in "XYZ"], -1)
    ij = np.round(corners).astype(int)
    known = np.isfinite(world[ij[:, 1], ij[:, 0]]).all(1)
    corners, ij = corners[known], ij[known]
    guess = cv2.projectPoints(world[ij[:, 1], ij[:, 0]].astype(float), cv2.Rodrigues(pr[:3, :3])[0], pr[:3, 3], mr, dr)[0].reshape(-1, 2).astype(np.float32)
    found, status, error = cv2.calcOpticalFlowPyrLK(*grey, corners.reshape(-1, 1, 2), guess.reshape(-1, 1, 2).copy(), winSize=(9, 9), maxLevel=0, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
                                                    criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4))
    found, ok = found.reshape(-1, 2), status.ravel() == 1
    # Not over an edge of depth, and not hidden on the other side.
    z = left["Z"]
    flat = cv2.morphologyEx(z.astype(np.float32), cv2.MORPH_GRADIENT, np.ones((11, 11)))[ij[:, 1], ij[:, 0]] < 0.06
    ok &= flat & (np.linalg.norm(found - guess, axis=1) < 2)
    a, b = (straight(p[ok], m, d).T for p, m, d in ((corners, ml, dl), (found, mr, dr)))
    x = cv2.triangulatePoints(pl[:3], pr[:3], a, b)
    there = (pl @ (x / x[3]))[2]
    truth = bilinear(z.astype(float), *corners[ok].T)
    relative = there / truth - 1
    error = np.median(np.abs(relative))
    # A tenth of a pixel of disparity at this distance and baseline.
    tenth = 0.1 * np.median(truth) / (ml[0, 0] * 2 * EYES["right"][0])
    print(f"stereo: {ok.sum()} points from {truth.min():.2f} to {truth.max():.2f} m: triangulated over true depth {1 + np.median(relative):.5f} in the median, half of them within {error:.5f}, nine tenths within "
          f"{np.percentile(np.abs(relative), 90):.5f}; a tenth of a pixel is {tenth:.5f}")
    assert ok.sum() > 300 and abs(np.median(relative)) < 2e-4 and error < 2 * tenth


def rasterised(matrix, distortion, pose, fine):
    """Number of the object (from 0; -1 none) that OpenCV's model sees at `fine` x `fine` places of each pixel, as [row][column]."""
    w, h = 600, 400
    at = (np.arange(w * fine) + 0.5) / fine - 0.5, (np.arange(h * fine) + 0.5) / fine - 0.5
    pixels = np.stack(np.meshgrid(*at), -1).reshape(-1, 1, 2)
    tangents = straight(pixels, matrix, distortion)
    origin = -pose[:3, :3].T @ pose[:3, 3]
    directions = np.column_stack([tangents, np.ones(len(tangents))]) @ pose[:3, :3]
    nearest, seen = np.full(len(directions), np.inf), np.full(len(directions), -1)
    for (corner, u, v), owner in zip(faces(), owners()):
        normal = np.cross(u, v)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (corner - origin) @ normal / (directions @ normal)
            p = origin + t[:, None] * directions - corner
            inside = (t > 0) & (p @ u >= 0) & (p @ u <= u @ u) & (p @ v >= 0) & (p @ v <= v @ v) & (t < nearest)
        nearest[inside], seen[inside] = t[inside], owner
    return seen.reshape(h * fine, w * fine)


def covered(frame, header, layer):
    """Coverage of each name of a Cryptomatte layer, by its manifest."""
    key = next(k.rsplit("/", 1)[0] for k, v in header.items() if k.startswith("cryptomatte/") and k.endswith("/name") and v == layer)
    manifest = json.loads(header[f"{key}/manifest"])
    ranks = [(frame[f"{layer}{k:02}.{a}"], frame[f"{layer}{k:02}.{b}"]) for k in range(3) for a, b in (("R", "G"), ("B", "A"))]
    value = {name: np.array(int(code, 16), np.uint32).view(np.float32) for name, code in manifest.items()}
    return {name: sum(np.where(i == v, c, 0) for i, c in ranks) for name, v in value.items()}


def masks(folder):
    scene(folder)
    frame, header, *camera = photographed(folder, "left", "id,class,crypto-object,crypto-class", 64)
    fine = 5
    many = rasterised(*camera, fine)
    middle = many[fine // 2 :: fine, fine // 2 :: fine]
    ids = frame["id"].astype(int) - 1
    off = ids != middle
    edge = cv2.dilate(middle.astype(np.float32), np.ones((3, 3))) != cv2.erode(middle.astype(np.float32), np.ones((3, 3)))
    share = lambda owner: (many == owner).reshape(400, fine, 600, fine).mean((1, 3))
    objects, classes = covered(frame, header, "CryptoObject"), covered(frame, header, "CryptoClass")
    worst_box = worst_area = 0.0
    for owner in np.unique(owners()):
        box = lambda mask: np.array([f(np.nonzero(mask.any(axis))[0]) for axis in (0, 1) for f in (np.min, np.max)])
        worst_box = max(worst_box, np.abs(box(ids == owner) - box(middle == owner)).max())
        name = "table" if owner == 0 else f"box-{owner - 1}"
        worst_area = max(worst_area, abs(objects[name].sum() / share(owner).sum() - 1))
        rms = np.sqrt(np.mean((objects[name] - share(owner))[edge] ** 2))
        print(f"   {name}: {(middle == owner).sum()} pixels; coverage over that of the projection {objects[name].sum() / share(owner).sum():.5f}, at edges within {rms:.3f} rms")
    boxes = 1 - share(0) - share(-1)
    of_class = classes["box"].sum() / boxes.sum()
    numbers = frame["class"].astype(int)
    print(f"masks: {off.sum()} pixels of {off.size} differ from the projection by OpenCV's model, {(off & ~edge).sum()} of them away from edges; boxes within {worst_box:.0f} px, areas within {worst_area:.5f}; "
          f"class over projection {of_class:.5f}")
    assert (off & ~edge).sum() == 0 and off.sum() < 0.05 * edge.sum() and worst_box <= 1 and worst_area < 0.01 and abs(of_class - 1) < 0.005
    assert all(len(np.unique(numbers[ids == o])) == 1 for o in np.unique(ids)) and len(np.unique(numbers[ids > 0])) == 1


def main():
    wanted = sys.argv[2:] or ["st", "rays", "flow", "stereo", "masks"]
    failed = []
    with tempfile.TemporaryDirectory() as folder:
        if "st" in wanted:
            failed = st_maps(folder)
        if "rays" in wanted:
            rays(folder)
        if "flow" in wanted:
            scene(folder, smooth=True)
            flow(folder)
        if "stereo" in wanted:
            stereo(folder)
        if "masks" in wanted:
            masks(folder)
    print(f"ST maps beyond 0.02 px: {failed}" if failed else "ok")
    sys.exit(bool(failed))


main()
