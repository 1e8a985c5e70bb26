"""A turntable photographed through a real lens, reconstructed by COLMAP (pycolmap) with our poses and model, and without our poses.

    pip install numpy pillow pycolmap
    python validation/turntable_colmap.py [DIOPTER] [FOLDER]

A table with boxes under a random pattern (glTF, made here; it shines by itself, so that no lamp moves with the camera) is photographed from two rings around it, with the noise of the sensor. The
camera's model (OPENCV, fitted by diopter to the traced lens at the focus of the pictures) and poses are those that `shoot -o NAME.json` and `lens calibrate -o cameras.txt` write.

1. COLMAP finds and matches features and triangulates them with our poses and model, which stay as they are: mean reprojection error, and the distances of its points from the surfaces of the scene.
2. COLMAP reconstructs the same features without poses (the model stays): it registers all pictures, and after one similarity its cameras stand where ours do.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pycolmap

from blocks_scene import distances, faces, scene

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DIOPTER = os.path.abspath(sys.argv[1]) if len(sys.argv) > 1 else os.path.join(ROOT, "target/release/diopter")
LENS, APERTURE, FOCUS, SIZE = "double-gauss-50mm", "f/11", "2.6m", (1200, 800)
RINGS = [(14, 25.0), (7, 48.0)]  # pictures, elevation in degrees
RADIUS = 2.6
OUTLIER_PX = 2.0  # half of what COLMAP takes for its own
FEATURES = 4000  # a picture: matching takes the square of it
MODEL = "opencv4"


def run(*arguments):
    done = subprocess.run([DIOPTER, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, arguments))}\n{done.stderr}")
    return done.stdout


def photographs(folder, gltf):
    """Pictures, and camera from world in OpenCV's axes by name."""
    images = os.path.join(folder, "images")
    os.makedirs(images, exist_ok=True)
    shots = []
    for k, (count, elevation) in enumerate(RINGS):
        for i in range(count):
            a, e = 2 * np.pi * (i + 0.5 * k) / count, np.radians(elevation)
            shots.append(np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)]) * RADIUS)

    def shoot(job):
        k, at = job
        name = f"{k:03}.png"
        side = os.path.join(folder, f"{k:03}.json")
        if not os.path.exists(os.path.join(images, name)):
            run("shoot", gltf, "--lens", LENS, "--aperture", APERTURE, "--focus", FOCUS, "--look-from=" + ",".join(f"{x:.6f}" for x in at), "--look-at=0,0.08,0",
                "--size", "%dx%d" % SIZE, "--spp", 8, "--seed", k + 1, "--mode", "A", "--iso", 200, "--light", "none", "--integrator", "path", "--denoise", "off",
                "-o", os.path.join(images, name), "-o", side)
        frame = json.load(open(side))["frames"][0]
        pose = next(p for p in frame["poses"] if p["when"] == "middle")["camera_from_world_opencv"]
        return name, pose

    with ThreadPoolExecutor(1) as pool:
        return images, dict(pool.map(shoot, enumerate(shots)))


def camera(folder):
    path = os.path.join(folder, "cameras.txt")
    run("lens", "calibrate", LENS, "--aperture", APERTURE, "--focus", FOCUS, "--size", "%dx%d" % SIZE, "--model", MODEL, "-o", path)
    line = next(line for line in open(path) if not line.startswith("#"))
    _, name, w, h, *parameters = line.split()
    assert (int(w), int(h)) == SIZE
    return name, [float(p) for p in parameters]


def mapping():
    """COLMAP's own settings, but for outliers and for the camera, which stays as it is."""
    options = pycolmap.IncrementalPipelineOptions()
    options.mapper.filter_max_reproj_error = options.triangulation.complete_max_reproj_error = options.triangulation.merge_max_reproj_error = OUTLIER_PX
    options.ba_refine_focal_length = options.ba_refine_principal_point = options.ba_refine_extra_params = False
    return options


def report(what, model, quads, size, points=None):
    kept = [p for p in model.points3D.values() if p.track.length() >= 3]
    points = np.array([p.xyz for p in kept]) if points is None else points(np.array([p.xyz for p in kept]))
    away = distances(points, quads) / size
    error = model.compute_mean_reprojection_error()
    quantiles = np.quantile(away, [0.5, 0.9, 0.99])
    within = np.mean(away < 1e-3)
    print(f"{what}: {model.num_reg_images()} pictures, {model.num_points3D()} points ({len(kept)} seen by three or more), mean reprojection error {error:.3f} px; "
          f"from the surfaces of the truth over the size of the scene: rms of 99 % {np.sqrt(np.mean(np.sort(away)[: int(0.99 * len(away))] ** 2)):.2e}, "
          f"median {quantiles[0]:.1e}, 90 % {quantiles[1]:.1e}, 99 % {quantiles[2]:.1e}; {100 * within:.1f} % within 1e-3")
    return error, quantiles, within


def main():
    folder = sys.argv[2] if len(sys.argv) > 2 else tempfile.mkdtemp()
    os.makedirs(folder, exist_ok=True)
    quads = faces()
    size = np.linalg.norm(np.ptp(np.concatenate([quads[:, 0], quads[:, 0] + quads[:, 1] + quads[:, 2]]), axis=0))
    gltf = scene(folder)
    images, poses = photographs(folder, gltf)
    name, parameters = camera(folder)
    print(f"{LENS} at {APERTURE}, {len(poses)} pictures of {SIZE[0]} x {SIZE[1]}; {name} {' '.join(f'{p:.6g}' for p in parameters)}; the scene is {size:.2f} m across")

    database = os.path.join(folder, "database.db")
    if os.path.exists(database):
        os.remove(database)
    reader = pycolmap.ImageReaderOptions(camera_model=name, camera_params=",".join(map(repr, parameters)))
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.sift.max_num_features = FEATURES
    pycolmap.logging.minloglevel = 2
    pycolmap.extract_features(database, images, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader, extraction_options=extraction)
    pycolmap.match_exhaustive(database)

    # 1. Our poses and our model stay.
    known = pycolmap.Reconstruction()
    with pycolmap.Database.open(database) as db:
        own = db.read_all_cameras()[0]
        known.add_camera_with_trivial_rig(own)
        for image in db.read_all_images():
            w, x, y, z = poses[image.name]["quaternion_wxyz"]
            pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([x, y, z, w])), np.array(poses[image.name]["translation_m"]))
            fresh = pycolmap.Image(name=image.name, camera_id=own.camera_id, image_id=image.image_id)
            known.add_image_with_trivial_frame(fresh, pose)
    target = os.path.join(folder, "known")
    os.makedirs(target, exist_ok=True)
    options = mapping()
    options.fix_existing_frames = True
    with_poses = pycolmap.triangulate_points(known, database, images, target, options=options)
    moved = max(np.linalg.norm(i.cam_from_world().translation - np.array(poses[i.name]["translation_m"])) for i in with_poses.images.values())
    print(f"poses moved by {moved:.1e} m")
    error, quantiles, within = report("with our poses", with_poses, quads, size)
    assert error <= 0.3, error
    assert within > 0.9, within

    # 2. Without our poses.
    target = os.path.join(folder, "found")
    shutil.rmtree(target, ignore_errors=True)
    os.makedirs(target)
    options = mapping()
    found = max(pycolmap.incremental_mapping(database, images, target, options=options).values(), key=lambda m: m.num_reg_images())
    names = [i.name for i in found.images.values() if i.has_pose]
    centre = lambda name: -rotation(poses[name]).T @ np.array(poses[name]["translation_m"])
    ours = np.array([centre(n) for n in names])
    theirs = np.array([found.find_image_with_name(n).projection_center() for n in names])
    similarity = pycolmap.estimate_sim3d(theirs, ours)
    matrix = similarity.matrix()
    scale = similarity.scale
    moved = theirs @ matrix[:, :3].T + matrix[:, 3]
    off = np.linalg.norm(moved - ours, axis=1) / size
    turns = []
    for n in names:
        r = found.find_image_with_name(n).cam_from_world().rotation.matrix() @ (matrix[:, :3] / scale).T @ rotation(poses[n]).T
        turns.append(np.degrees(np.arccos(np.clip((np.trace(r) - 1) / 2, -1, 1))))
    print(f"without our poses: {len(names)} of {len(poses)} pictures registered; after one similarity (scale {scale:.4f}) cameras stand within {off.max():.1e} of the scene's size (rms "
          f"{np.sqrt(np.mean(off**2)):.1e}) of ours, turned by {max(turns):.4f} degrees at most")
    error, quantiles, within = report("without our poses", found, quads, size, lambda points: points @ matrix[:, :3].T + matrix[:, 3])
    assert len(names) == len(poses) and error <= 0.3 and off.max() < 2e-3 and max(turns) < 0.1 and within > 0.9
    print("ok")


def rotation(pose):
    w, x, y, z = pose["quaternion_wxyz"]
    return pycolmap.Rotation3d(np.array([x, y, z, w])).matrix()


main()
