"""The files of a rig read by pycolmap, a YAML reader and numpy, and held against each other.

Usage: python validation/rig_peers.py DIOPTER    needs numpy, pyyaml, pycolmap (4 or later)
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pycolmap
import yaml

RIG = """
[rig]
[[rig.path]]
time = 0
look_from = [0.6, 0.5, 1.2]
look_at = [0, 0.1, 0]
[[rig.path]]
time = 0.5
look_from = [0.2, 0.7, 1.3]
look_at = [0, 0.1, 0]
[[rig.path]]
time = 1
look_from = [-0.5, 0.5, 1.2]
look_at = [0, 0.15, 0]
[frames]
count = 3
fps = 4
first = 0.2
[shot]
scene.file = "still-life"
camera = { lens = "double-gauss-50mm" }
exposure.shutter = "1/100"
render = { size = "96x64", spp = 2, truth_channels = "position" }
[write]
files = ["jpg", "position.npy", "depth.npy"]
[[camera]]
name = "eye"
baseline = "8 cm"
[[camera]]
name = "side"
position = [0.2, 0.05, 0]
turn_deg = [-20, 5, 3]
[imu]
rate = "500 Hz"
position = [0.02, -0.01, 0]
"""


def matrix(pose):
    return np.vstack([np.asarray(pose), [0, 0, 0, 1]])


def main(diopter):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        (out / "rig.toml").write_text(RIG)
        subprocess.run([diopter, "rig", out / "rig.toml", "-o", out / "r"], check=True)
        root, names = out / "r", ["eye-left", "eye-right", "side"]
        ours = json.loads((root / "calibration/rig.json").read_text())
        flip = np.diag([1, -1, -1, 1])

        r = pycolmap.Reconstruction()
        r.read_text(str(root / "calibration/colmap"))
        assert (r.num_cameras(), r.num_rigs(), r.num_frames(), r.num_images()) == (3, 1, 3, 9)
        config = pycolmap.read_rig_config(root / "calibration/colmap/rig_config.json")
        assert len(config) == 1 and len(config[0].cameras) == 3

        pose_error, pixel_error, seen = 0, [], 0
        for image in r.images.values():
            camera = next(c for c in ours["cameras"] if c["name"] == image.name.split("/")[0])
            picture = next(p for p in camera["pictures"] if p["file"] == image.name)
            expected = flip @ np.linalg.inv(matrix(picture["world_from_camera"]))
            found = matrix(image.cam_from_world().matrix())
            pose_error = max(pose_error, np.abs(found - expected).max())
            # Truth of every pixel, projected by pycolmap, lies where it was seen.
            position = np.load(root / image.name.replace(".jpg", ".position.npy")).astype(np.float64)
            rows, columns = np.nonzero(np.isfinite(position[..., 0]))
            points = position[rows, columns] @ found[:3, :3].T + found[:3, 3]
            uv = r.cameras[image.camera_id].img_from_cam(points)
            pixel_error.append(np.hypot(uv[:, 0] - columns - 0.5, uv[:, 1] - rows - 0.5))
            seen += len(rows)
        pixels = np.concatenate(pixel_error)
        print(f"pycolmap {pycolmap.__version__}: poses within {pose_error:.1e}, {seen} points: median {np.median(pixels):.4f} px, 99 % {np.quantile(pixels, 0.99):.4f} px")
        assert pose_error < 1e-9 and np.quantile(pixels, 0.99) < 0.1

        chain = yaml.safe_load((root / "calibration/camchain.yaml").read_text())
        mounts = [matrix(c["rig_from_camera"]) for c in ours["cameras"]]
        for k in (1, 2):
            expected = flip @ np.linalg.inv(mounts[k]) @ mounts[k - 1] @ flip
            assert np.abs(np.array(chain[f"cam{k}"]["T_cn_cnm1"]) - expected).max() < 1e-12
        baseline = chain["cam1"]["T_cn_cnm1"][0][3]
        print(f"Kalibr: baseline {baseline} m")
        assert abs(baseline + 0.08) < 1e-15

        t = json.loads((root / "transforms.json").read_text())
        for f in t["frames"]:
            camera = next(c for c in ours["cameras"] if c["name"] == f["camera"])
            picture = next(p for p in camera["pictures"] if p["file"] == f["file_path"])
            assert np.abs(np.array(f["transform_matrix"])[:3] - np.array(picture["world_from_camera"])).max() < 1e-12
        print(f"transforms.json: {len(t['frames'])} frames, {t['camera_model']}")

        truth = np.loadtxt(root / "imu0/truth.csv", delimiter=",")
        state = np.loadtxt(root / "state_groundtruth_estimate0/data.csv", delimiter=",")
        table = np.load(root / "imu0/imu.npy")
        assert table.shape == (len(truth), 29) and np.abs(table[:, 7:13] - truth[:, 1:]).max() < 1e-12
        # Velocity from positions, by central differences of 4 ms.
        dt = (state[2:, 0] - state[:-2, 0]) * 1e-9
        v = (state[2:, 1:4] - state[:-2, 1:4]) / dt[:, None]
        print(f"IMU: {len(truth)} samples, velocity against differences {np.abs(v - state[1:-1, 8:11]).max():.1e} m/s")
        assert np.abs(v - state[1:-1, 8:11]).max() < 1e-3


main(sys.argv[1])
