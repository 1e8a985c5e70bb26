"""The coffee maker of `pbrt_reference.py` beside Mitsuba 3: time and error at equal samples, in one run.

    python validation/coffee_speed.py FOLDER_OF_THE_SCENE [--diopter target/release/diopter] [--spp 32]

Reads scene-v4.pbrt as far as that scene needs it and gives Mitsuba the same: plastics (lossy between base and coat as ours, `nonlinear`), glass, silver,
three lamps. 400 x 500, depth 17, red, green and blue. Needs numpy, OpenEXR and mitsuba (pip) and an LLVM that Mitsuba can use
(DRJIT_LIBLLVM_PATH). Our seconds are those of the whole program, Mitsuba's those of mi.render: processor seconds both.
"""

import argparse
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

WIDTH, HEIGHT, DEPTH, REFERENCE, SEEDS = 400, 500, 17, 1024, (1, 2, 3)


def numbers(text, name):
    return [float(x) for x in re.search(rf'"\w+ {name}" \[([^\]]*)\]', text).group(1).split()]


def material(text):
    kind = re.search(r'"string type" \[ "(\w+)" \]', text).group(1)
    if kind == "coateddiffuse":
        colour, alpha = {"type": "rgb", "value": numbers(text, "reflectance")}, numbers(text, "uroughness")[0]
        rough = {"type": "roughplastic", "alpha": alpha, "distribution": "ggx"} if alpha > 0.01 else {"type": "plastic"}
        return {"type": "twosided", "b": {**rough, "diffuse_reflectance": colour, "nonlinear": True, "int_ior": 1.5, "ext_ior": 1.0}}
    if kind == "conductor":
        return {"type": "twosided", "b": {"type": "conductor", "material": "Ag"}}
    return {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}


def mitsuba(folder, spp, seed, out):
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    text = (Path(folder) / "scene-v4.pbrt").read_text()
    head, world = text.split("WorldBegin")
    m = np.array([float(x) for x in re.search(r"Transform \[([^\]]*)\]", head).group(1).split()]).reshape(4, 4).T
    place = mi.ScalarTransform4f(np.linalg.inv(m) @ np.diag([-1.0, 1.0, 1.0, 1.0]))
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": "box"}}
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": DEPTH + 1},
        "sensor": {"type": "perspective", "fov": numbers(head, "fov")[0], "fov_axis": "smaller", "to_world": place, "film": film,
                   "sampler": {"type": "multijitter", "sample_count": spp}},
    }
    known, current, lamp = {}, None, False
    directives = re.split(r"\n(?=MakeNamedMaterial|NamedMaterial|Shape|AttributeBegin|AttributeEnd|\s*AreaLightSource|\s*Shape|\s*Material)", world)
    for i, part in enumerate(directives):
        part = part.strip()
        name = re.match(r'\w+ "(\w+)"', part)
        if part.startswith("MakeNamedMaterial"):
            known[name.group(1)] = material(part)
        elif part.startswith("NamedMaterial"):
            current = known[name.group(1)]
        elif part.startswith("AreaLightSource"):
            lamp = numbers(part, "L")
        elif 'Shape "plymesh"' in part:
            file = re.search(r'"string filename" \[ "([^"]*)" \]', part).group(1)
            scene[f"mesh{i}"] = {"type": "ply", "filename": str(Path(folder) / file), "bsdf": current}
        elif 'Shape "trianglemesh"' in part:
            p = np.array(numbers(part, "P")).reshape(4, 3)
            # A rectangle's own frame is -1..1 in x and y, light on the side of +z.
            x, y = (p[1] - p[0]) / 2, (p[3] - p[0]) / 2
            frame = np.eye(4)
            frame[:3] = np.array([x, y, np.cross(x, y), p.mean(0)]).T
            emitter = {"type": "area", "radiance": {"type": "rgb", "value": lamp}}
            scene[f"lamp{i}"] = {"type": "rectangle", "to_world": mi.ScalarTransform4f(frame), "emitter": emitter,
                                 "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}}
    scene = mi.load_dict(scene)
    begun = time.process_time()
    picture = np.array(mi.render(scene, spp=spp, seed=seed))
    Path(out + ".s").write_text(str(time.process_time() - begun))
    np.save(out, picture)


def ours(a, spp, seed):
    import OpenEXR

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [a.diopter, "expose", str(Path(a.folder) / "scene-v4.pbrt"), "--radiance", "--rgb", "--spp", str(spp), "--seed", str(seed)]
    command += ["--size", f"{WIDTH}x{HEIGHT}", "--max-depth", str(DEPTH), "-o", f"{a.tmp}/ours.exr"]
    subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    with OpenEXR.File(f"{a.tmp}/ours.exr") as file:
        picture = np.array(file.channels()["RGB"].pixels)
    return picture, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def theirs(a, spp, seed):
    out = f"{a.tmp}/theirs.npy"
    command = [sys.executable, str(Path(__file__).resolve()), "--one", a.folder, str(spp), str(seed), out]
    subprocess.run(command, check=True, capture_output=True)
    return np.load(out), float(Path(out + ".s").read_text())


def main():
    if sys.argv[1:2] == ["--one"]:
        return mitsuba(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), sys.argv[5])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("--diopter", default="target/release/diopter")
    parser.add_argument("--spp", type=int, default=32)
    a = parser.parse_args()
    median = lambda values: sorted(values)[len(values) // 2]
    with tempfile.TemporaryDirectory() as a.tmp:
        (own, _), (other, _) = ours(a, REFERENCE, 77), theirs(a, REFERENCE, 77)
        share = 1 - a.spp / REFERENCE
        products = []
        for name, run, reference in (("diopter", ours, own), ("Mitsuba", theirs, other)):
            runs = [run(a, a.spp, s) for s in SEEDS]
            seconds = median([t for _, t in runs])
            squares = [(p - reference) ** 2 / (reference**2 + 0.01) for p, _ in runs]
            error = median([float(s.mean()) for s in squares]) * share
            # What single bright pixels do to a mean of squares hides the rest: also without the worst thousandth.
            calm = median([float(np.sort(s.mean(-1).ravel())[: s[..., 0].size * 999 // 1000].mean()) for s in squares]) * share
            products.append((seconds * error, seconds * calm))
            print(f"{name}: {seconds:.2f} s, relMSE {error:.5f}, {calm:.5f} without the worst thousandth", flush=True)
        print(f"ratios of products {products[0][0] / products[1][0]:.2f}, {products[0][1] / products[1][1]:.2f}; means"
              f" {own.mean((0, 1)) / other.mean((0, 1))}")


main()
