"""Materials, spectra and lamps of Mitsuba's scene files beside Mitsuba 3: a ball over a checkered floor, below a lamp and an even sky.

    python validation/mitsuba_materials.py DIOPTER [CASE ...]

Prints the means of whole pictures, ours and theirs, in red, green and blue, and ours over theirs: both have 256 samples, so that they are known within
about 0.5 %. Needs numpy, pillow, OpenEXR and mitsuba (pip) and an LLVM that Mitsuba can use (DRJIT_LIBLLVM_PATH).
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import mitsuba
import numpy as np
import OpenEXR
from PIL import Image

mitsuba.set_variant("llvm_ad_rgb")
program, folder = Path(sys.argv[1]).resolve(), Path(tempfile.mkdtemp())
Image.new("RGB", (4, 4), (128, 128, 128)).save(folder / "grey.png")
Image.new("RGB", (4, 4), (220, 60, 30)).save(folder / "red.png")
(folder / "lamp.spd").write_text("400 1\n500 4\n600 8\n700 12\n")

GREY = '<bsdf type="diffuse"><rgb name="reflectance" value=".5,.5,.5"/></bsdf>'
BLUE = '<bsdf type="diffuse"><rgb name="reflectance" value=".1,.2,.8"/></bsdf>'
GLASS, NULL = '<bsdf type="dielectric"/>', '<bsdf type="null"/>'


def picture(name, file):
    return f'<texture type="bitmap" name="{name}"><string name="filename" value="{file}"/></texture>'


def mask(inner, opacity='<float name="opacity" value="0.5"/>'):
    return f'<bsdf type="mask">{opacity}{inner}</bsdf>'


def blend(a, b, weight='<float name="weight" value="0.3"/>'):
    return f'<bsdf type="blendbsdf">{weight}{a}{b}</bsdf>'


BALLS = {
    "plain": GREY,
    "masked glass": mask(GLASS),
    "mask in mask": mask(mask(f'<bsdf type="twosided">{BLUE}</bsdf>', '<float name="opacity" value="0.4"/>')),
    "null and null": blend(NULL, NULL),
    "blue and null": blend(f'<bsdf type="twosided">{BLUE}</bsdf>', NULL),
    "null and masked blue": blend(NULL, mask(f'<bsdf type="twosided">{BLUE}</bsdf>')),
    "grey and masked blue": blend(f'<bsdf type="twosided">{GREY}</bsdf>', mask(f'<bsdf type="twosided">{BLUE}</bsdf>')),
    "opacity by a picture": mask(f'<bsdf type="twosided">{BLUE}</bsdf>', picture("opacity", "grey.png")),
    "weight by a picture": blend(GREY, BLUE, picture("weight", "grey.png")),
    "weight by a coloured picture": blend(GREY, BLUE, picture("weight", "red.png")),
    "mirror": '<bsdf type="conductor"/>',
    "rough mirror by a picture": f'<bsdf type="roughconductor"><string name="distribution" value="ggx"/>{picture("alpha", "grey.png")}</bsdf>',
    "tinted body": '<bsdf type="principled"><rgb name="base_color" value=".8,.3,.1"/><float name="spec_trans" value="1"/><float name="roughness" value="0.2"/></bsdf>',
    "glowing, without a BSDF": '<emitter type="area"><rgb name="radiance" value="2,1,.5"/></emitter>',
}
LAMPS = {
    "a value": '<spectrum name="radiance" value="5"/>',
    "a list": '<spectrum name="radiance" value="400:1, 500:4, 600:8, 700:12"/>',
    "a file": '<spectrum name="radiance" filename="lamp.spd"/>',
    "d65": '<spectrum name="radiance" type="d65"/>',
}


def scene(ball, lamp='<rgb name="radiance" value="15,13,9"/>', sky=True):
    return f"""<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="65"/></integrator>
<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0,-4,1.5" target="0,0,0.3" up="0,0,1"/></transform>
<film type="hdrfilm"><rfilter type="box"/><integer name="width" value="64"/><integer name="height" value="48"/></film></sensor>
{'<emitter type="constant"><rgb name="radiance" value="0.6,0.8,1.0"/></emitter>' if sky else ''}
<shape type="rectangle"><transform name="to_world"><scale value="0.5"/><rotate y="1" angle="180"/><translate x="-1" z="2.5"/></transform>{GREY}
<emitter type="area">{lamp}</emitter></shape>
<shape type="rectangle"><transform name="to_world"><scale value="3"/></transform><bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
<rgb name="color0" value=".8,.2,.1"/><rgb name="color1" value=".1,.3,.6"/><transform name="to_uv"><scale x="6" y="6"/></transform></texture></bsdf></shape>
<shape type="sphere"><point name="center" x="0" y="0" z="0.7"/><float name="radius" value="0.7"/>{ball}</shape></scene>"""


cases = {name: scene(ball) for name, ball in BALLS.items()} | {f"lamp by {name}": scene(GREY, lamp, False) for name, lamp in LAMPS.items()}
for name in sys.argv[2:] or cases:
    file, out = folder / "scene.xml", folder / "ours.exr"
    file.write_text(cases[name])
    theirs = np.array(mitsuba.render(mitsuba.load_file(str(file)), spp=256))[..., :3].mean((0, 1))
    command = [program, "expose", file, "--radiance", "--rgb", "--size", "64x48", "--spp", "256", "--max-depth", "64", "-o", out]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if done.returncode:
        print(f"{name}: {done.stderr.strip()[-300:]}")
        continue
    with OpenEXR.File(str(out)) as read:
        ours = np.array(read.channels()["RGB"].pixels, np.float64).mean((0, 1))
    print(f"{name}: ours {np.round(ours, 4)}, theirs {np.round(theirs, 4)}, ratio {np.round(ours / theirs, 3)}", flush=True)
