"""Small meshes beside Mitsuba 3: time and error at equal samples, in one run.

    python validation/mesh_speed.py bunny.obj suzanne.obj ... [--diopter target/release/diopter]

Each mesh stands on a floor below a lamp and an even sky, 256 x 256, 32 samples, depth 8, both programs in red, green and blue; the lamp reflects
nothing, as lamps of Mitsuba do unless they say otherwise. Needs numpy, OpenEXR and mitsuba (pip) and an LLVM that Mitsuba can use
(DRJIT_LIBLLVM_PATH). Our seconds are those of the whole program, Mitsuba's those of mi.render.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

SPP, REFERENCE, SEEDS = 32, 1024, (1, 2, 3)
LAMP = ([[-3, 4, 1], [-1.5, 4, 1], [-1.5, 4, 2.5], [-3, 4, 2.5]], [[0, 1, 2], [0, 2, 3]])
FLOOR = ([[-20, 0, -20], [20, 0, -20], [20, 0, 20], [-20, 0, 20]], [[0, 2, 1], [0, 3, 2]])

PBRT = """Integrator "path" "integer maxdepth" 8
Film "rgb" "integer xresolution" 256 "integer yresolution" 256
Scale -1 1 1
LookAt 2 2 5  0 0.9 0  0 1 0
Camera "perspective" "float fov" 35
WorldBegin
LightSource "infinite" "rgb L" [0.4 0.5 0.7]
AttributeBegin Material "diffuse" "rgb reflectance" [0 0 0] AreaLightSource "diffuse" "rgb L" [12 10 8] Shape "plymesh" "string filename" "lamp.ply" AttributeEnd
Material "diffuse" "rgb reflectance" [0.5 0.5 0.5] Shape "plymesh" "string filename" "floor.ply"
Material "diffuse" "rgb reflectance" [0.7 0.35 0.2] Shape "plymesh" "string filename" "mesh.ply"
"""


def write_ply(path, corners, faces):
    corners, faces = np.asarray(corners, "<f4"), np.asarray(faces, "<i4")
    rows = np.zeros(len(faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
    rows["n"], rows["i"] = 3, faces
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(corners)}\n"
    header += "property float x\nproperty float y\nproperty float z\n"
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    Path(path).write_bytes(header.encode() + corners.tobytes() + rows.tobytes())


def read_obj(path):
    corners, faces = [], []
    for line in open(path):
        words = line.split()
        if words[:1] == ["v"]:
            corners.append([float(x) for x in words[1:4]])
        elif words[:1] == ["f"]:
            i = [int(w.split("/")[0]) - 1 for w in words[1:]]
            faces += [[i[0], i[k], i[k + 1]] for k in range(1, len(i) - 1)]
    corners = np.array(corners)
    low, high = corners.min(0), corners.max(0)
    corners = (corners - (low + high) / 2) / (high - low).max() * 2
    corners[:, 1] -= corners[:, 1].min()
    return corners, faces


def mitsuba(spp, seed):
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    transform = mi.ScalarTransform4f
    rgb = lambda *v: {"type": "rgb", "value": list(v)}
    matte = lambda *v: {"type": "twosided", "b": {"type": "diffuse", "reflectance": rgb(*v)}}
    ply = lambda name, **more: {"type": "ply", "filename": name, "face_normals": True, **more}
    film = {"type": "hdrfilm", "width": 256, "height": 256, "rfilter": {"type": "box"}}
    place = transform().look_at(origin=[2, 2, 5], target=[0, 0.9, 0], up=[0, 1, 0])
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 9},
        "sensor": {"type": "perspective", "fov": 35, "to_world": place, "film": film,
                   "sampler": {"type": "multijitter", "sample_count": spp}},
        "sky": {"type": "constant", "radiance": rgb(0.4, 0.5, 0.7)},
        "lamp": ply("lamp.ply", emitter={"type": "area", "radiance": rgb(12, 10, 8)}),
        "floor": ply("floor.ply", bsdf=matte(0.5, 0.5, 0.5)),
        "mesh": ply("mesh.ply", bsdf=matte(0.7, 0.35, 0.2)),
    })
    begun = time.process_time()
    picture = np.array(mi.render(scene, spp=spp, seed=seed))
    Path("seconds").write_text(str(time.process_time() - begun))
    np.save("mitsuba.npy", picture)


def ours(program, spp, seed):
    import OpenEXR

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [program, "expose", "scene.pbrt", "--radiance", "--rgb", "--spp", str(spp), "--seed", str(seed)]
    subprocess.run([*command, "--max-depth", "8", "-o", "ours.exr"], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    with OpenEXR.File("ours.exr") as file:
        picture = np.array(file.channels()["RGB"].pixels)
    return picture, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def theirs(spp, seed):
    command = [sys.executable, str(Path(__file__).resolve()), "--one", str(spp), str(seed)]
    subprocess.run(command, check=True, capture_output=True)
    return np.load("mitsuba.npy"), float(Path("seconds").read_text())


def error(picture, reference):
    return float(((picture - reference) ** 2 / (reference**2 + 0.01)).mean()) * (1 - SPP / REFERENCE)


def main():
    if sys.argv[1:2] == ["--one"]:
        return mitsuba(int(sys.argv[2]), int(sys.argv[3]))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", nargs="+")
    parser.add_argument("--diopter", default="target/release/diopter")
    a = parser.parse_args()
    program = str(Path(a.diopter).resolve())
    meshes = [Path(m).resolve() for m in a.mesh]
    median = lambda values: sorted(values)[len(values) // 2]
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        Path("scene.pbrt").write_text(PBRT)
        write_ply("lamp.ply", *LAMP)
        write_ply("floor.ply", *FLOOR)
        for mesh in meshes:
            write_ply("mesh.ply", *read_obj(mesh))
            (own, _), (other, _) = ours(program, REFERENCE, 77), theirs(REFERENCE, 77)
            a_runs, b_runs = [ours(program, SPP, s) for s in SEEDS], [theirs(SPP, s) for s in SEEDS]
            times = [median([t for _, t in runs]) for runs in (a_runs, b_runs)]
            errors = [median([error(p, r) for p, _ in runs]) for runs, r in ((a_runs, own), (b_runs, other))]
            print(f"{mesh.stem}: diopter {times[0]:.2f} s {errors[0]:.5f}, Mitsuba {times[1]:.2f} s {errors[1]:.5f}, ratio of products"
                  f" {times[0] * errors[0] / (times[1] * errors[1]):.2f}, means {own.mean((0, 1)) / other.mean((0, 1))}", flush=True)


main()
