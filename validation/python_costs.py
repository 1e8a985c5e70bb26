"""What the way over Python costs: `dp.expose` beside the program, read-outs a second, memory over many calls.

    pip install .
    python validation/python_costs.py [--calls 10000] [--items 10000] [--pairs 5]

Processor seconds, which other work on the machine changes less than wall seconds.
"""
import argparse, gc, os, resource, statistics, subprocess, sys, tempfile, time

import numpy as np

import diopter as dp

SHOT = dict(size=(480, 320), spp=48, shutter="1/60 s", seed=1)


def own():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def children():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def resident_mb():
    with open("/proc/self/statm") as f:
        return int(f.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def exposing(pairs):
    """`dp.expose` and `FocalPlane.save` in a process that lives, beside `diopter expose`, one after the other."""
    scene, camera = dp.Scene.builtin("still-life"), dp.Camera(lens="double-gauss-50mm", body="nikon-d850", focus="0.8 m", aperture="f/4")
    with tempfile.TemporaryDirectory() as room:
        flags = "--lens double-gauss-50mm --body nikon-d850 --focus 0.8m --aperture f/4 --size 480x320 --spp 48 --shutter 1/60 --seed 1".split()
        program = [os.path.join(os.path.dirname(sys.executable), "diopter"), "expose", "still-life", *flags, "-o", f"{room}/a.exr"]
        here, there = [], []
        for _ in range(pairs):
            begun = own()
            plane = dp.expose(scene, camera, **SHOT)
            plane.save(f"{room}/b.exr")
            here.append(own() - begun)
            begun = children()
            subprocess.run(program, check=True, capture_output=True)
            there.append(children() - begun)
        start = children()
        subprocess.run([program[0], "--version"], check=True, capture_output=True)
        start = children() - start
        equal = np.array_equal(dp.FocalPlane.load(f"{room}/a.exr").mean, plane.mean)
    ratios = [a / (b - start) - 1 for a, b in zip(here, there)]
    print(
        f"expose and save: {statistics.median(here):.2f} processor s in Python, {statistics.median(there):.2f} by the program (of which {start:.2f} its start); "
        f"the call over the work of the program: {100 * statistics.median(ratios):+.2f} % (pairs {', '.join(f'{100 * r:+.1f}' for r in ratios)}); same bits: {equal}"
    )
    # What the border itself costs: the smallest exposure that can be asked for.
    tiny = dict(SHOT, size=(2, 2), spp=1)
    dp.expose(scene, camera, **tiny)
    begun = time.perf_counter()
    for _ in range(50):
        dp.expose(scene, camera, **tiny)
    print(f"an exposure of 2 × 2 pixels and one sample, focus and checks included: {20 * (time.perf_counter() - begun):.2f} ms")


def reading(calls):
    plane = dp.FocalPlane.from_irradiance(np.full((500, 500, 3), 10.0, dtype=np.float32), "nikon-d850", shutter=0.01)
    for seed in range(20):
        dp.read_out(plane, iso=800, seed=seed).mosaic
    gc.collect()
    memory, begun, used = [resident_mb()], time.perf_counter(), own()
    for k in range(calls):
        dp.read_out(plane, iso=800, seed=k).mosaic[0, 0]
        if (k + 1) % max(calls // 4, 1) == 0:
            memory.append(resident_mb())
    wall, used = time.perf_counter() - begun, own() - used
    print(
        f"{calls} read-outs of 0.25 megapixels: {calls / wall:.1f} a second, {1000 * used / calls:.1f} ms of processor each ({2000 * calls / used / 1000:.0f} a second on two free cores); "
        f"resident {', '.join(f'{m:.1f}' for m in memory)} MB"
    )


def items(count, integrator):
    dataset = dp.Dataset(
        {
            "name": "memory",
            "items": count,
            "shot": {"scene": {"file": "cornell"}, "focus": {"distance": "1 m"}, "exposure": {"shutter": "1/30"}, "render": {"size": "16x16", "spp": 1, "integrator": integrator}},
            "vary": [{"name": "iso", "choice": [100, 400, 1600]}, {"name": "aperture", "range": ["f/2", "f/8"]}],
            "write": {"files": ["dng", "expected.npy", "mean.npy", "depth.npy"]},
        }
    )
    for k in range(min(50, count)):
        dataset.archive(k)
    gc.collect()
    memory, begun = [resident_mb()], time.perf_counter()
    for k in range(count):
        dataset.archive(k)
        if (k + 1) % max(count // 4, 1) == 0:
            memory.append(resident_mb())
    print(f"{count} items of 16 × 16, {integrator}: {1000 * (time.perf_counter() - begun) / count:.1f} ms each; resident {', '.join(f'{m:.1f}' for m in memory)} MB")


parser = argparse.ArgumentParser()
parser.add_argument("--calls", type=int, default=10000)
parser.add_argument("--items", type=int, default=10000)
parser.add_argument("--pairs", type=int, default=5)
asked = parser.parse_args()
if asked.pairs:
    exposing(asked.pairs)
if asked.calls:
    reading(asked.calls)
if asked.items:
    items(asked.items, "path")
    # Photon maps and light paths come and go.
    items(asked.items // 10, "auto")
