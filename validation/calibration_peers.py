"""Holds calibrations that diopter writes against OpenCV and pycolmap.

    python validation/calibration_peers.py [path/to/diopter]

Needs numpy, opencv-python-headless, pycolmap and OpenEXR. Directions come from the ST map that diopter traces; OpenCV and COLMAP project them with the files that diopter wrote, and the result has to be the
pixel itself within the residual of the fit.
"""

import json
import os
import subprocess
import sys
import tempfile

import cv2
import numpy as np
import OpenEXR
import pycolmap

DIOPTER = sys.argv[1] if len(sys.argv) > 1 else "target/release/diopter"
SIZE = (600, 400)
# 32-bit places of an ST map: 1e-7 of 600 pixels.
MAP_PX = 1e-3


def run(*words):
    return json.loads(subprocess.run([DIOPTER, *words, "--json"], check=True, capture_output=True, text=True).stdout)


def directions(path, matrix):
    """Pixels and their directions from an ST map that distorts."""
    channels = OpenEXR.File(path, separate_channels=True).channels()
    s, t, alpha = (channels[name].pixels.astype(float) for name in "RGA")
    h, w = s.shape
    v, u = np.nonzero(alpha > 0.5)
    x = (s[v, u] * w - 0.5 - matrix[0, 2]) / matrix[0, 0]
    y = ((1.0 - t[v, u]) * h - 0.5 - matrix[1, 2]) / matrix[1, 1]
    return np.stack([u, v], 1).astype(float), np.stack([x, y, np.ones_like(x)], 1)


def check(lens, model, *flags):
    folder = tempfile.mkdtemp()
    names = {n: os.path.join(folder, n) for n in ("camera.yaml", "cameras.txt", "distort.exr", "calibration.json")}
    # COLMAP has not all models.
    wanted = [n for n in names if n != "cameras.txt" or model in ("opencv5", "opencv8", "opencv-fisheye")]
    outputs = [w for n in wanted for w in ("-o", names[n])]
    told = run("lens", "calibrate", lens, "--model", model, "--size", f"{SIZE[0]}x{SIZE[1]}", *flags, *outputs)
    worst = told["models"][0]["fit"]["max_px"]
    fs = cv2.FileStorage(names["camera.yaml"], cv2.FILE_STORAGE_READ)
    matrix, k = fs.getNode("camera_matrix").mat(), fs.getNode("distortion_coefficients").mat()
    assert int(fs.getNode("image_width").real()) == SIZE[0]
    pixels, rays = directions(names["distort.exr"], matrix)
    # The fit ends at 80° for models that divide by z; the maximum is over a grid of it.
    inside = np.degrees(np.arctan(np.hypot(rays[:, 0], rays[:, 1]))) < min(79.0, told["models"][0]["fit"]["fitted_angle_deg"])
    pixels, rays = pixels[inside], rays[inside]
    zero = np.zeros(3)
    project = cv2.fisheye.projectPoints if model == "opencv-fisheye" else cv2.projectPoints
    at, _ = project(rays[:, None, :], zero, zero, matrix, k)
    off = np.linalg.norm(at[:, 0] - pixels, axis=1).max()
    assert off < 1.5 * worst + MAP_PX, f"{lens} {model}: OpenCV is {off} px away, the fit says {worst}"
    print(f"{lens} {model}: OpenCV within {off:.4f} px (fit {worst:.4f})")
    if "cameras.txt" in wanted:
        name, size, parameters = read_camera(names["cameras.txt"])
        camera = pycolmap.Camera(model=name, width=size[0], height=size[1], params=parameters)
        colmap = np.array(camera.img_from_cam(rays)) - 0.5
        off = np.abs(colmap - at[:, 0]).max()
        assert off < 1e-6, f"{lens} {model}: COLMAP is {off} px from OpenCV"
        print(f"{lens} {model}: COLMAP agrees with OpenCV within {off:.1e} px")


def read_camera(path):
    line = next(line for line in open(path) if not line.startswith("#"))
    _, name, w, h, *parameters = line.split()
    return name, (int(w), int(h)), [float(p) for p in parameters]


def poses():
    """The same point of the world through the files of COLMAP and nerfstudio."""
    folder = tempfile.mkdtemp()
    names = [os.path.join(folder, n) for n in ("cameras.txt", "images.txt", "transforms.json")]
    outputs = [w for n in names for w in ("-o", n)]
    look = ["--look-from", "1.5,1,2", "--look-at", "0,0.4,0"]
    subprocess.run([DIOPTER, "shoot", "cornell", "--lens", "pinhole", "--shutter", "1/60", "--size", "300x200", *look, *outputs], check=True)
    open(os.path.join(folder, "points3D.txt"), "w").close()
    model = pycolmap.Reconstruction()
    model.read_text(folder)
    image = next(iter(model.images.values()))
    world = np.array([0.1, 0.5, -0.2])
    pose = image.cam_from_world() if callable(image.cam_from_world) else image.cam_from_world
    colmap = np.array(model.cameras[image.camera_id].img_from_cam((pose * world)[None]))[0]
    t = json.load(open(names[2]))
    x, y, z, _ = np.linalg.inv(np.array(t["frames"][0]["transform_matrix"])) @ np.append(world, 1.0)
    nerf = np.array([t["fl_x"] * x / -z + t["cx"], t["cy"] - t["fl_y"] * y / -z])
    assert np.abs(colmap - nerf).max() < 1e-3, (colmap, nerf)
    print(f"poses: COLMAP and nerfstudio see the point at {colmap} and {nerf}")
    # What the camera is aimed at is in the middle.
    aimed = np.array(model.cameras[image.camera_id].img_from_cam((pose * np.array([0, 0.4, 0]))[None]))[0]
    assert np.abs(aimed - [150, 100]).max() < 1e-2, aimed


if __name__ == "__main__":
    for model in ("opencv5", "opencv8", "opencv12"):
        check("double-gauss-50mm", model)
        check("kit-zoom-18-55mm", model, "--focal-length", "18mm", "--film", "APS-C", "--focus", "2m")
    check("double-gauss-50mm", "opencv-fisheye")
    poses()
    print("ok")
