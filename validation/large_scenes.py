"""A million Gaussian splats and millions of strands of hair: samples a second, time to read, memory.

    pip install numpy
    python validation/large_scenes.py DIOPTER [--splats 1000000] [--strands 10000000]

Splats lie on a bumpy shell and in a haze around it, harmonics of the first degree, as a binary .ply. They are photographed twice through a thin lens, with 2 and with 34 samples a pixel: the
difference in processor time is that of the samples alone. Strands are cubic B-splines of four points in a Mitsuba scene with its `hair`; `scene info` reads them and builds their hierarchy.
Memory is the most that the last run held.
"""

import argparse
import re
import resource
import subprocess
import tempfile
from pathlib import Path

import numpy as np

SIZE = (240, 160)


def run(command):
    """Processor seconds and peak memory (MB) of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(["/usr/bin/time", "-f", "peak %M", *command], capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, int(re.search(r"peak (\d+)", done.stderr).group(1)) / 1024


def measure(program, scene, flags):
    def of(samples):
        command = [program, "expose", str(scene), "--size", f"{SIZE[0]}x{SIZE[1]}", "--spp", str(samples), "--aperture", "4", "--iso", "100", "--shutter", "1/60"]
        return run([*command, *flags, "-o", str(scene.with_suffix(".exr"))])

    (few, _), (many, memory) = of(2), of(34)
    return 32 * SIZE[0] * SIZE[1] / (many - few) * 1e-6, few, memory


def splats(file, count):
    random = np.random.default_rng(1)
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    bumps = 1 + 0.15 * np.sin(7 * direction[:, 0]) * np.cos(9 * direction[:, 1])
    radius = np.where(np.arange(count) % 10 == 0, bumps * random.uniform(1, 1.6, count), bumps)
    fields = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"] + [f"f_rest_{i}" for i in range(9)]
    fields += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    rows = np.zeros((count, len(fields)), "<f4")
    rows[:, :3] = direction * radius[:, None]
    rows[:, 3:6] = direction
    rows[:, 6:15] = random.normal(0, 0.05, (count, 9))
    rows[:, 15] = random.uniform(-1, 4, count)
    rows[:, 16:19] = random.uniform(-6.5, -5, (count, 3))
    rows[:, 19:23] = random.normal(size=(count, 4))
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n" + "".join(f"property float {f}\n" for f in fields) + "end_header\n"
    file.write_bytes(head.encode() + rows.tobytes())


def strands(folder, count):
    random = np.random.default_rng(2)
    with (folder / "strands.txt").open("w") as out:
        for part in range(0, count, 100_000):
            n = min(100_000, count - part)
            root = random.uniform(-1, 1, (n, 2))
            lean = random.normal(0, 0.05, (n, 3, 2)).cumsum(axis=1)
            block = np.empty((n, 4, 4), "f4")
            block[:, :, 3] = 0.0004
            block[:, :, 1] = np.array([0, 0.1, 0.2, 0.3])
            block[:, 0, [0, 2]] = root
            block[:, 1:, [0, 2]] = root[:, None] + lean
            text = np.char.mod("%.5f", block.reshape(n, 16))
            lines = ["{} {} {} {}\n{} {} {} {}\n{} {} {} {}\n{} {} {} {}\n\n".format(*row) for row in text]
            out.write("".join(lines))
    scene = folder / "hair.xml"
    scene.write_text(
        '<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">'
        '<lookat origin="0,1.6,2.4" target="0,0.1,0" up="0,1,0"/></transform></sensor><emitter type="constant"/>'
        '<shape type="bsplinecurve"><string name="filename" value="strands.txt"/><bsdf type="hair"/></shape></scene>'
    )
    return scene


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("diopter")
    parser.add_argument("--splats", type=int, default=1_000_000)
    parser.add_argument("--strands", type=int, default=10_000_000)
    arguments = parser.parse_args()
    print("| scene | samples a core-second | read and 2 samples a pixel | memory |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments.splats:
            file = folder / "splats.ply"
            splats(file, arguments.splats)
            rate, read, memory = measure(arguments.diopter, file, ["--look-from", "0,0,3.2", "--look-at", "0,0,0"])
            print(f"| {arguments.splats} splats | {rate:.3f} M | {read:.1f} s | {memory:.0f} MB |", flush=True)
            file.unlink()
        if arguments.strands:
            scene = strands(folder, arguments.strands)
            read, memory = run([arguments.diopter, "scene", "info", str(scene)])
            print(f"| {arguments.strands} strands of four points | - | {read:.1f} s | {memory:.0f} MB |", flush=True)


if __name__ == "__main__":
    main()
