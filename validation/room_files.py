"""Rooms out of Mitsuba's scene files (also of its versions 0.5 and 0.6): cost to equal quality and means beside Mitsuba 3.

    pip install mitsuba numpy openexr
    python validation/room_files.py DIOPTER SCENE.xml [SCENE.xml ...] [--size 128x72] [--spp 64] [--reference 512] [--depth 16]

Both read the same file, written beside the scene and taken away again: shapes, pictures and surroundings whose files are missing are left out, plugins that neither Mitsuba 3 nor diopter has are
put in place by diffuse ones or rough plastics, sun and sky by a map with a sun 4 degrees wide. Red, green and blue, one thread; medians of three seeds, each against a reference of its own program whose noise is not taken off.
relMSE: mean of (x - ref)^2 / (ref^2 + 0.01). Seconds: ours of the whole program, theirs of rendering. Mitsuba wants an LLVM of version 16 or later (DRJIT_LIBLLVM_PATH).
"""

import argparse
import re
import resource
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import OpenEXR

THEIRS = """
import sys, time, numpy as np, mitsuba as mi
mi.set_variant("llvm_ad_rgb")
scene, n, seed, out = mi.load_file(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
mi.set_log_level(mi.LogLevel.Error)
begun, total, done = time.process_time(), 0, 0
while done < n:
    step = min(n - done, 256)
    total = total + np.array(mi.render(scene, spp=step, seed=1000 * seed + done)) * step
    done += step
print("render", time.process_time() - begun)
np.save(out, total / n)
"""


def child(parent, tag, name, value):
    node = ET.SubElement(parent, tag)
    node.set("name", name)
    node.set("value", value)


def sky(file):
    """A blue sky over grey ground, and a sun."""
    height, width = 256, 512
    down, around = (np.arange(height) + 0.5) / height * np.pi, (np.arange(width) + 0.5) / width * 2 * np.pi
    up = np.cos(down)[:, None] * np.ones(width)
    picture = np.where(up[..., None] > 0, np.array([60, 80, 120]) * (1 - 0.5 * up[..., None]), np.array([20, 18, 15]))
    sun = np.array([0.3, 0.6, 0.7]) / np.linalg.norm([0.3, 0.6, 0.7])
    towards = np.stack([np.sin(down)[:, None] * np.sin(around), up, -np.sin(down)[:, None] * np.cos(around)], -1)
    picture[towards @ sun > np.cos(np.radians(2))] = [3e5, 2.7e5, 2.3e5]
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": np.ascontiguousarray(picture.astype(np.float32))}).write(str(file))


def common(scene, sky_file):
    """The scene as both read it: its tree."""
    folder = scene.parent
    tree = ET.parse(scene)
    root = tree.getroot()
    named = lambda node: node.find("string[@name='filename']")
    is_missing = lambda node: named(node) is not None and not (folder / named(node).get("value")).exists()
    for node in list(root):
        if node.tag in ("default", "integrator") or node.tag in ("shape", "emitter") and is_missing(node):
            root.remove(node)
        elif node.tag == "emitter" and node.get("type") in ("sunsky", "sun", "sky"):
            node.attrib = {"type": "envmap"}
            [node.remove(c) for c in list(node)]
            child(node, "string", "filename", sky_file.name)
            sky(sky_file)
    for parent in list(root.iter()):
        for node in list(parent):
            if node.tag == "texture":
                [node.remove(c) for c in list(node) if c.get("name") in ("filterType", "maxAnisotropy", "gamma")]
                if is_missing(node):
                    at = list(parent).index(node)
                    parent.remove(node)
                    grey = ET.Element("rgb", {"name": node.get("name", "reflectance"), "value": "0.5, 0.5, 0.5"})
                    parent.insert(at, grey)
    for bsdf in root.iter("bsdf"):
        kept = {"roughdiffuse": ("diffuse", "reflectance"), "phong": ("roughplastic", "diffuseReflectance"), "ward": ("roughplastic", "diffuseReflectance")}
        if bsdf.get("type") in kept:
            kind, name = kept[bsdf.get("type")]
            bsdf.set("type", kind)
            [bsdf.remove(c) for c in list(bsdf) if c.get("name") != name]
        for c in list(bsdf):
            if c.get("name") == "extEta":
                bsdf.remove(c)
            if c.get("name") == "distribution":
                c.set("value", "ggx")
    for node in root.iter():
        value = node.get("value") or ""
        if node.tag in ("rgb", "srgb") and value.startswith("#"):
            code = [int(value[i : i + 2], 16) / 255 for i in (1, 3, 5)]
            node.tag = "rgb"
            node.set("value", ", ".join(f"{c / 12.92 if c < 0.04045 else ((c + 0.055) / 1.055) ** 2.4:.5f}" for c in code))
        if node.tag == "spectrum" and value and ":" not in value:
            numbers = value.replace(",", " ").split()
            node.tag = "rgb"
            node.set("value", ", ".join(numbers if len(numbers) == 3 else numbers[:1] * 3))
    return tree


def seconds_of(command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(done.stderr[-800:])
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def read(file):
    with OpenEXR.File(str(file)) as f:
        channels = f.channels()
        if "RGB" in channels:
            return np.array(channels["RGB"].pixels, np.float64)
        return np.stack([np.array(channels[k].pixels) for k in "RGB"], -1).astype(np.float64)


def errors(x, reference):
    each = np.sort(((x - reference) ** 2 / (reference**2 + 0.01)).mean(-1).ravel())
    return np.array([each.mean(), each[: -max(1, len(each) // 1000)].sum() / len(each)])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("diopter", type=Path)
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--size", default="128x72")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--reference", type=int, default=512)
    parser.add_argument("--depth", type=int, default=16)
    args = parser.parse_args()
    width, height = args.size.split("x")
    for scene in args.scenes:
        both, own, sky_file = (scene.parent / f".room_files{end}" for end in (".xml", "_mitsuba.xml", ".exr"))
        work = Path(tempfile.mkdtemp())
        try:
            tree = common(scene, sky_file)
            film = tree.getroot().find("sensor/film")
            [film.remove(c) for c in list(film)]
            child(film, "integer", "width", width)
            child(film, "integer", "height", height)
            ET.SubElement(film, "rfilter").set("type", "box")
            [sensor.remove(s) for sensor in tree.getroot().iter("sensor") for s in sensor.findall("sampler")]
            tree.write(both)
            integrator = ET.SubElement(tree.getroot(), "integrator")
            integrator.set("type", "path")
            # Theirs counts what is seen directly as 1.
            old = (tree.getroot().get("version") or "3").startswith("0")
            child(integrator, "integer", "maxDepth" if old else "max_depth", str(args.depth + 1))
            tree.write(own)

            def ours(n, seed):
                options = ["--radiance", "--rgb", "--size", args.size, "--spp", n, "--seed", seed, "--max-depth", args.depth]
                s, _ = seconds_of([args.diopter, "--threads", 1, "expose", both, *options, "-o", work / "a.exr"])
                return read(work / "a.exr"), s

            def theirs(n, seed):
                _, text = seconds_of([sys.executable, "-c", THEIRS, own, n, seed, work / "a.npy"])
                return np.load(work / "a.npy")[..., :3].astype(np.float64), float(re.search(r"render ([\d.]+)", text)[1])

            figures = []
            for render in (ours, theirs):
                reference, _ = render(args.reference, 77)
                runs = [render(args.spp, seed) for seed in (1, 2, 3)]
                error = np.median([errors(x, reference) for x, _ in runs], 0)
                figures.append((np.median([s for _, s in runs]), error, reference.mean((0, 1))))
            (a, e, m), (b, f, n) = figures
            print(
                f"{scene.parent.name}: seconds {a:.2f} / {b:.2f}; relMSE {e[0]:.4f} / {f[0]:.4f}, without the worst thousandth {e[1]:.4f} / {f[1]:.4f}; "
                f"means {np.round(m / n, 3)}; time x relMSE {a * e[0] / (b * f[0]):.2f}, {a * e[1] / (b * f[1]):.2f}",
                flush=True,
            )
        finally:
            [file.unlink(missing_ok=True) for file in (both, own, sky_file)]


main()
