"""Curves, hair and grids of media out of Mitsuba's own scene files, by diopter and by Mitsuba 3, in red, green and blue.

    pip install mitsuba
    python validation/mitsuba_scenes.py DIOPTER [--spp 256] [--pictures FOLDER]

Each scene is written here, read by both and photographed by its own pinhole, 96 × 72 pixels: mean of the picture, and root mean square of 12 × 12 blocks of 8 × 6 pixels over the mean.
"""

import argparse
import struct
import subprocess
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

SIZE = (96, 72)


def vol(file, numbers):
    """A .vol file of an array [z][y][x][channel]."""
    z, y, x, channels = numbers.shape
    head = b"VOL\x03" + struct.pack("<5i6f", 1, x, y, z, channels, 0, 0, 0, 1, 1, 1)
    file.write_bytes(head + numbers.astype("<f4").tobytes())


def scenes(folder):
    random = np.random.default_rng(1)
    strands = []
    for _ in range(150):
        x, z = random.uniform(-1, 1), random.uniform(-0.5, 0.5)
        points = [(x + 0.3 * np.sin(2 * t + 9 * x), -1.2 + t, z + 0.2 * np.cos(3 * t), 0.03 + 0.01 * np.sin(5 * t)) for t in np.linspace(0, 2.4, 9)]
        strands.append("\n".join(" ".join(f"{v:.6f}" for v in p) for p in points))
    (folder / "strands.txt").write_text("\n\n".join(strands) + "\n")
    cells = np.linspace(0, 1, 9)
    z, y, x = np.meshgrid(cells, cells, cells, indexing="ij")
    smoke = np.maximum(0, 1 - 2.2 * np.sqrt((x - 0.5) ** 2 + (y - 0.4) ** 2 + (z - 0.5) ** 2)) * 6
    vol(folder / "smoke.vol", smoke[..., None])
    vol(folder / "hue.vol", np.stack([0.3 + 0.6 * x, 0.8 - 0.5 * y, 0.4 + 0.3 * z], axis=-1))
    sensor = (
        '<sensor type="perspective"><float name="fov" value="35"/><transform name="to_world"><lookat origin="0.4,0.3,5" target="0,0,0" up="0,1,0"/></transform>'
        f'<film type="hdrfilm"><integer name="width" value="{SIZE[0]}"/><integer name="height" value="{SIZE[1]}"/><rfilter type="box"/></film></sensor>'
    )
    light = (
        '<emitter type="constant"><rgb name="radiance" value="0.4, 0.5, 0.7"/></emitter>'
        '<emitter type="directional"><vector name="direction" value="-1, -1.5, -0.7"/><rgb name="irradiance" value="2.5, 2.2, 1.8"/></emitter>'
    )
    floor = (
        '<shape type="rectangle"><transform name="to_world"><scale value="4"/><rotate x="1" angle="-90"/><translate y="-1.25"/></transform>'
        '<bsdf type="diffuse"><rgb name="reflectance" value="0.4, 0.3, 0.25"/></bsdf></shape>'
    )
    curves = lambda kind, bsdf: f'<shape type="{kind}"><string name="filename" value="strands.txt"/>{bsdf}</shape>'
    hair = '<bsdf type="hair"><float name="eumelanin" value="0.3"/><float name="pheomelanin" value="0.2"/></bsdf>'
    blue = '<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.25, 0.7"/></bsdf></bsdf>'
    grid = lambda name, file: (
        f'<volume name="{name}" type="gridvolume"><string name="filename" value="{file}"/>'
        '<transform name="to_world"><translate x="-0.5" y="-0.5" z="-0.5"/><scale value="2"/></transform></volume>'
    )
    cloud = lambda albedo: (
        f'<medium type="heterogeneous" id="m"><float name="scale" value="1.5"/>{grid("sigma_t", "smoke.vol")}{albedo}'
        '<phase type="hg"><float name="g" value="0.4"/></phase></medium>'
        '<shape type="cube"><bsdf type="null"/><ref name="interior" id="m"/></shape>'
    )
    return {
        "linear curves": ("path", light + floor + curves("linearcurve", blue)),
        "B-spline curves": ("path", light + floor + curves("bsplinecurve", blue)),
        "hair on B-splines": ("path", light + floor + curves("bsplinecurve", hair)),
        "pplastic": ("path", light + floor + '<shape type="sphere"><bsdf type="pplastic"><float name="alpha" value="0.15"/><string name="distribution" value="ggx"/></bsdf></shape>'),
        "grid of extinction": ("volpath", light + floor + cloud('<rgb name="albedo" value="0.9, 0.7, 0.5"/>')),
        "grids of extinction and albedo": ("volpath", light + floor + cloud(grid("albedo", "hue.vol"))),
    }, sensor


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("diopter")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    mi.set_variant("scalar_rgb")
    print("| scene | mean of ours over Mitsuba's | red, green, blue | blocks, rms |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        all_scenes, sensor = scenes(folder)
        for name, (integrator, body) in all_scenes.items():
            file = folder / "scene.xml"
            text = f'<scene version="3.0.0"><integrator type="{integrator}"><integer name="max_depth" value="24"/></integrator>{sensor}{body}</scene>'
            file.write_text(text)
            theirs = np.array(mi.render(mi.load_file(str(file)), spp=arguments.spp))[..., :3]
            out = folder / "ours.exr"
            command = [arguments.diopter, "expose", str(file), "--radiance", "--rgb", "--spp", str(arguments.spp), "--max-depth", "23"]
            subprocess.run([*command, "--size", f"{SIZE[0]}x{SIZE[1]}", "-o", str(out)], check=True, capture_output=True)
            read = mi.Bitmap(str(out))
            names = [read.struct_()[i].name for i in range(read.channel_count())]
            ours = np.array(read)[..., [names.index(c) for c in "RGB"]]
            ratios = ours.mean((0, 1)) / theirs.mean((0, 1))
            block = lambda p: p.reshape(12, 6, 12, 8, 3).mean((1, 3))
            apart = np.sqrt(((block(ours) - block(theirs)) ** 2).mean()) / theirs.mean()
            print(f"| {name} | {ours.mean() / theirs.mean():.4f} | {ratios[0]:.4f}, {ratios[1]:.4f}, {ratios[2]:.4f} | {100 * apart:.2f} % |", flush=True)
            if arguments.pictures:
                both = np.concatenate([ours, theirs], axis=1)
                mi.util.write_bitmap(str(arguments.pictures / f"{name.replace(' ', '-')}.png"), mi.Bitmap(both.astype(np.float32)))


if __name__ == "__main__":
    main()
