"""A chessboard photographed through five lenses, with noise, calibrated by OpenCV and held against the calibration that diopter writes.

    pip install numpy scipy OpenEXR opencv-python-headless
    python validation/board_calibration.py [DIOPTER] [LENS ...] [--pictures FOLDER] [--wavelength NM] [--chief]

For each lens: `lens calibrate` says K and distortion by traced rays, over the whole picture and, by its ray table, at the places where corners were seen (a model that does not quite follow a
lens depends on where it is fitted). Then a board of shining squares is photographed from many sides (raw, noise of ISO 400, developed), its corners are
found by OpenCV, and `cv2.calibrateCameraExtended` (fisheyes: `cv2.fisheye.calibrate`) fits the same model. Shown are both, the difference in the standard deviations that OpenCV states, and
three reprojection errors: OpenCV's own; that of our model at our poses, fitted to nothing (what is predicted of the picture); and the former predicted from the latter, which is smaller by the
numbers that a fit takes up. Each pose is written by `shoot -o calibration.json`.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile

import cv2
import numpy as np
import OpenEXR
from scipy.optimize import least_squares

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
asked = argparse.ArgumentParser()
asked.add_argument("diopter", nargs="?", default=os.path.join(ROOT, "target/release/diopter"))
asked.add_argument("lenses", nargs="*")
asked.add_argument("--pictures", help="folder where pictures are kept, and not taken again")
asked.add_argument("--wavelength", type=float, default=535.0, help="of our calibration, nm: where the green of the picture has its weight")
asked.add_argument("--chief", action="store_true", help="our calibration by chief rays: centroids, without")
ASKED = asked.parse_args()
DIOPTER, PICTURES = os.path.abspath(ASKED.diopter), ASKED.pictures and os.path.abspath(ASKED.pictures)
RAY = ["--wavelength", ASKED.wavelength, *([] if ASKED.chief else ["--centroid"])]
SIZE = (900, 600)
COLUMNS, ROWS = 11, 8  # squares; corners are one fewer
FAR = 6  # times the distances and squares below: so far away that the place of the entrance pupil, which moves with the angle, hardly matters
SQUARE = 0.48  # m
# Flags of lens, film, distance of the board (m), how much larger the board is, model, f-number, largest tilt of the board (degrees).
LENSES = {
    "double-gauss-50mm": ([], "36x24", 12.0, 1, "opencv5", "f/8", 35),
    "distagon-28mm-f2": ([], "36x24", 14.0, 2, "opencv5", "f/8", 35),
    "kit-zoom-18-55mm": (["--focal-length", "18mm"], "22.3x14.9", 13.6, 2, "opencv5", "f/8", 35),
    "fisheye-15mm-f2.8": ([], "36x24", 14.4, 3.5, "opencv-fisheye", "f/8", 30),
    "phone-5.6mm-f3.5": ([], "5.76x3.84", 6.4, 0.75, "opencv5", "f/8", 35),
}
POSES = 14
FISHEYE = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2  # OpenCV 4 and 5
NAMES = {"opencv5": ["k1", "k2", "p1", "p2", "k3"], "opencv8": ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"], "opencv-fisheye": ["k1", "k2", "k3", "k4"]}


def run(*arguments):
    done = subprocess.run([DIOPTER, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, arguments))}\n{done.stderr}")
    return done.stdout


def board(path, square):
    """The chessboard in the plane z = 0, upright, its first inner corner at the upper left: an OBJ of shining squares with a white margin."""
    materials = "newmtl white\nKd 0 0 0\nKe 300 300 300\nnewmtl black\nKd 0.02 0.02 0.02\nKe 12 12 12\n"
    with open(path.replace(".obj", ".mtl"), "w") as f:
        f.write(materials)
    vertices, faces = [], {"white": [], "black": []}
    for row in range(-1, ROWS + 1):
        for column in range(-1, COLUMNS + 1):
            inside = 0 <= row < ROWS and 0 <= column < COLUMNS
            x, y = (column - COLUMNS / 2) * square, (ROWS / 2 - row) * square
            first = len(vertices) + 1
            vertices += [(x, y - square), (x + square, y - square), (x + square, y), (x, y)]
            faces["black" if inside and (row + column) % 2 == 0 else "white"].append(range(first, first + 4))
    with open(path, "w") as f:
        f.write(f"mtllib {os.path.basename(path).replace('.obj', '.mtl')}\n")
        f.writelines(f"v {x:.6f} {y:.6f} 0\n" for x, y in vertices)
        for name, list_of in faces.items():
            f.write(f"usemtl {name}\n")
            f.writelines("f " + " ".join(map(str, face)) + "\n" for face in list_of)
    inner = [((c + 1 - COLUMNS / 2) * square, (ROWS / 2 - r - 1) * square, 0) for r in range(ROWS - 1) for c in range(COLUMNS - 1)]
    return np.array(inner, np.float32)


def poses(distance, square, tilt, random, inner, ours, fisheye):
    """Places of the camera, aims and what is up: from many sides, the whole board in the picture, in all parts of it."""
    reach = np.array([SIZE[0] / ours[0][0, 0], SIZE[1] / ours[0][1, 1]]) * 0.5
    found = 0
    while found < POSES:
        across, up = np.radians(random.uniform(-tilt, tilt, 2))
        d = distance * random.uniform(0.9, 1.15)
        at = np.array([np.sin(across), np.sin(up) * np.cos(across), np.cos(up) * np.cos(across)]) * d
        aim = np.array([*(random.uniform(-0.8, 0.8, 2) * reach * d), 0.0])
        look_from, above = at + aim, np.array([random.uniform(-0.6, 0.6), 1.0, 0.0])
        back = (look_from - aim) / np.linalg.norm(look_from - aim)
        right = np.cross(above, back)
        right /= np.linalg.norm(right)
        rotation = np.stack([right, -np.cross(back, right), -back])
        pose = np.vstack([np.column_stack([rotation, -rotation @ look_from]), [0, 0, 0, 1]])
        # With the squares around the corners.
        there = project(inner * [(COLUMNS + 1) / (COLUMNS - 2), (ROWS + 1) / (ROWS - 2), 1], pose, *ours, fisheye)
        if (rotation[2] @ (inner - look_from).T).min() > 0 and (there > 4).all() and (there < np.array(SIZE) - 5).all():
            found += 1
            yield look_from, aim, above


def corners_of(path):
    grey = np.ascontiguousarray(cv2.imread(path)[:, :, 1])  # green
    found, corners = cv2.findChessboardCornersSB(grey, (COLUMNS - 1, ROWS - 1), flags=cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY)
    if not found:
        return None
    corners = corners.reshape(-1, 2).astype(np.float64)
    return corners if len(corners) == (COLUMNS - 1) * (ROWS - 1) else None


def model_of(lens, flags, film, model, folder):
    """K and distortion that `lens calibrate` fits to traced rays."""
    path = os.path.join(folder, "model.json")
    run("lens", "calibrate", lens, *flags, "--film", film, "--size", "%dx%d" % SIZE, "--model", model, *RAY, "-o", path)
    m = json.load(open(path))["model"]
    assert m["name"] == model, m
    matrix = np.array([[m["fx"], 0, m["cx"]], [0, m["fy"], m["cy"]], [0, 0, 1]])
    return matrix, np.array([m["coefficients"][n] for n in NAMES[model]])


def ours_at_corners(lens, flags, film, distance, corners, start, fisheye, folder):
    """The model fitted to traced rays at the places of the corners that were seen."""
    path = os.path.join(folder, "rays.exr")
    run("lens", "calibrate", lens, *flags, "--film", film, "--size", "%dx%d" % SIZE, *RAY, "--format", "ray-table", "-o", path)
    table = OpenEXR.File(path, separate_channels=True).channels()
    plane = lambda n: np.stack([table[f"{n}.{a}"].pixels for a in "XYZ"], -1).astype(np.float64)
    origin, direction = plane("origin"), plane("direction")
    points = origin + direction * ((distance - origin[..., 2]) / direction[..., 2])[..., None]
    points = points / points[..., 2:]
    i, j = np.clip(np.floor(corners).astype(int), 0, np.array(SIZE) - 2).T
    f, g = (corners - np.stack([i, j], -1)).T[:, :, None]
    seen = (points[j, i] * (1 - f) + points[j, i + 1] * f) * (1 - g) + (points[j + 1, i] * (1 - f) + points[j + 1, i + 1] * f) * g
    matrix = lambda p: np.array([[p[0], 0, p[2]], [0, p[1], p[3]], [0, 0, 1]])
    off = lambda p: (project(seen, np.eye(4), matrix(p), p[4:], fisheye) - corners).ravel()
    k, d = start
    found = least_squares(off, np.concatenate([[k[0, 0], k[1, 1], k[0, 2], k[1, 2]], np.ravel(d)]), x_scale="jac").x
    return matrix(found), found[4:]


def fisheye_deviations(objects, rotations, translations, matrix, distortion, rms):
    """Standard deviations of K and distortion by the normal equations, which cv2.fisheye.calibrate does not state: what calibrateCamera does."""
    own, cross, reduced, count = np.zeros((8, 8)), [], [], 0
    for o, r, t in zip(objects, rotations, translations):
        _, jacobian = cv2.fisheye.projectPoints(o.reshape(-1, 1, 3).astype(np.float64), r, t, matrix, distortion)
        a, b = jacobian[:, :8], jacobian[:, 8:14]
        own += a.T @ a
        reduced.append(a.T @ b @ np.linalg.inv(b.T @ b) @ b.T @ a)
        count += len(jacobian)
    variance = rms**2 * len(objects[0]) * len(objects) / (count - 8 - 6 * len(objects))
    return np.sqrt(variance * np.diag(np.linalg.inv(own - sum(reduced)))).reshape(-1, 1)


def project(points, pose, matrix, distortion, fisheye):
    rotation, translation = pose[:3, :3], pose[:3, 3]
    vector = cv2.Rodrigues(rotation)[0]
    shape = points.reshape(-1, 1, 3).astype(np.float64)
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    if fisheye:
        return project(shape, vector, np.ascontiguousarray(translation).reshape(3, 1), matrix, distortion)[0].reshape(-1, 2)
    return project(shape, vector, translation, matrix, distortion)[0].reshape(-1, 2)


def main():
    wanted = ASKED.lenses or list(LENSES)
    random = np.random.default_rng(7)
    worst = 0.0
    for lens in wanted:
        flags, film, distance, larger, model, aperture, tilt = LENSES[lens]
        distance, square = distance * FAR, SQUARE * larger * FAR
        fisheye = model == "opencv-fisheye"
        stop = ["--aperture", aperture] if aperture else []
        with tempfile.TemporaryDirectory() as folder:
            kept = os.path.join(PICTURES or folder, lens)
            os.makedirs(kept, exist_ok=True)
            scene = os.path.join(folder, "board.obj")
            inner = board(scene, square)
            ours = model_of(lens, [*flags, *stop, "--focus", f"{distance}m"], film, model, folder)
            objects, images, placed = [], [], []
            for k, (look_from, look_at, up) in enumerate(poses(distance, square, tilt, random, inner, ours, fisheye)):
                picture, side = os.path.join(kept, f"{k}.png"), os.path.join(kept, f"{k}.json")
                vector = lambda v: ",".join(f"{x:.6f}" for x in v)
                if not os.path.exists(picture):
                    run("shoot", scene, "--lens", lens, *flags, "--format", film, *stop, "--focus", f"{distance}m", "--look-from=" + vector(look_from), "--look-at=" + vector(look_at),
                        "--up=" + vector(up), "--size", "%dx%d" % SIZE, "--spp", 24, "--seed", k + 1, "--mode", "A", "--iso", 400, "--light", "none",
                        "--integrator", "path", "--preset", "plain", "--denoise", "off", "-o", picture, "-o", side)
                seen = corners_of(picture)
                if seen is None:
                    continue
                calibration = json.load(open(side))
                camera = next(p for p in calibration["frames"][0]["poses"] if p["when"] == "middle")["world_from_camera_opengl"]
                pose = np.diag([1, -1, -1, 1]) @ np.linalg.inv(np.array(camera))
                predicted = project(inner, pose, *ours, fisheye)
                # The finder may begin at either end: a board of 11 x 8 squares has no other likeness.
                if np.linalg.norm(seen - predicted) > np.linalg.norm(seen[::-1] - predicted):
                    seen = seen[::-1].copy()
                objects.append(inner)
                images.append(seen.astype(np.float32))
                placed.append((seen, pose))
            if len(images) < 6:
                print(f"{lens}: the board was found in {len(images)} of {POSES} pictures: not enough")
                continue
            # Over the whole picture five coefficients leave 0.4 px of the phone lens, whose distortion turns back towards the corners: what is predicted of the corners is by the model there.
            here = ours_at_corners(lens, [*flags, *stop, "--focus", f"{distance}m"], film, distance, np.concatenate(images).astype(float), ours, fisheye, folder)
            errors = np.concatenate([seen - project(inner, pose, *here, fisheye) for seen, pose in placed])
            predicted_rms = np.sqrt((errors**2).sum(axis=1).mean())
            count = errors.size
            if fisheye:
                matrix, distortion = ours[0].copy(), np.zeros((4, 1))
                shape = [o.reshape(1, -1, 3).astype(np.float64) for o in objects], [i.reshape(1, -1, 2).astype(np.float64) for i in images]
                rms, matrix, distortion, *_ = cv2.fisheye.calibrate(*shape, SIZE, matrix, distortion,
                    flags=sum(getattr(FISHEYE, f"CALIB_{name}") for name in ("RECOMPUTE_EXTRINSIC", "FIX_SKEW", "USE_INTRINSIC_GUESS")))
                rotations, translations = _
                deviations = fisheye_deviations(objects, rotations, translations, matrix, distortion, rms)
            else:
                flags_of = cv2.CALIB_RATIONAL_MODEL if model == "opencv8" else 0
                rms, matrix, distortion, _, _, deviations, _, _ = cv2.calibrateCameraExtended(objects, images, SIZE, None, None, flags=flags_of)
                distortion = np.ravel(distortion)[: len(NAMES[model])]
            unknowns = 6 * len(images) + 4 + len(NAMES[model])
            expected = predicted_rms * np.sqrt(1 - unknowns / count)
            print(f"{lens} {' '.join(flags)}: {len(images)} pictures, {model}")
            names = ["fx", "fy", "cx", "cy"] + NAMES[model]
            flat = lambda k, d: np.concatenate([[k[0, 0], k[1, 1], k[0, 2], k[1, 2]], np.ravel(d)])
            a, b = flat(*here), flat(matrix, distortion)
            for j, name in enumerate(names):
                line = f"   {name:<3} ours {a[j]:>12.5f}   OpenCV {b[j]:>12.5f}"
                away = (b[j] - a[j]) / deviations[j, 0]
                line += f" ± {deviations[j, 0]:.5f}   {away:+.2f} deviations"
                worst = max(worst, abs(away))
                print(line)
            # What the coefficients together mean: where the two models put the same directions.
            theirs = [project(o, np.vstack([np.hstack([cv2.Rodrigues(r)[0], t.reshape(3, 1)]), [0, 0, 0, 1]]), *m, fisheye)
                      for m in (here, (matrix, np.ravel(distortion))) for o, r, t in [(inner, np.zeros(3), np.array([0.0, 0.0, distance]))]]
            print(f"   reprojection rms: OpenCV {rms:.4f} px; predicted {expected:.4f} (ratio {rms / expected:.3f}); ours unfitted {predicted_rms:.4f}, mean error "
                  f"{errors.mean(axis=0)[0]:+.4f}, {errors.mean(axis=0)[1]:+.4f} px; models apart {np.abs(theirs[0] - theirs[1]).max():.3f} px at most on the board")
    print(f"largest difference: {worst:.2f} standard deviations")


main()
