"""Denoising beside Open Image Denoise, all in one run: error, light kept, processor seconds a megapixel.

    pip install numpy OpenEXR pyoidn
    python validation/denoise_peers.py DIOPTER FOLDER NAME...

FOLDER holds NAME-32.exr and NAME-ref.exr: focal planes of `diopter expose` with a few samples and with many, of another seed, both exposed for the same
time or metered each. Made with, for example:

    diopter expose still-life --size 360x240 --spp 32 -o still-life-32.exr
    diopter expose still-life --size 360x240 --spp 1024 --seed 77 -o still-life-ref.exr

Rows: the samples themselves; the built-in filter; Open Image Denoise through diopter; the same library through its Python package, with clean features
and without (albedo and normals of the same file, bands scaled by their means).

relMSE = mean of (a - r)² / (r² + (0.01 of white)²) over pixels and bands, white the 99th percentile of a band; what the reference's own variance (its
half difference) makes of it is taken off. Light: sum over the sum before. Processor seconds are those of the whole command, with reading and writing the
files, for diopter, and of one call with a warm device for the package. "claimed": error that the half difference says is left, over the error.
"""

import json
import resource
import subprocess
import sys
import time

import numpy as np
import OpenEXR

try:
    import pyoidn
except ImportError:
    pyoidn = None


def channels(path):
    with OpenEXR.File(path, separate_channels=True) as f:
        part = f.channels()
        return {name: np.array(c.pixels, dtype=np.float32) for name, c in part.items()}, f.header()


def stacked(planes, prefix, names):
    return np.ascontiguousarray(np.stack([planes[prefix + n] for n in names], -1))


def exposure_s(header):
    """Exposure time from the facts that diopter writes into the header; None if they are not there."""
    facts = json.loads(header.get("diopter", "{}"))
    return facts.get("facts", facts).get("exposure_s")


def processor_s():
    use = resource.getrusage(resource.RUSAGE_CHILDREN)
    return use.ru_utime + use.ru_stime


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    diopter, folder, names = sys.argv[1], sys.argv[2], sys.argv[3:]
    for name in names:
        planes, header = channels(f"{folder}/{name}-32.exr")
        reference, reference_header = channels(f"{folder}/{name}-ref.exr")
        samples = stacked(planes, "", "RGB")
        times = exposure_s(header), exposure_s(reference_header)
        scale = times[0] / times[1] if all(times) else samples.mean() / stacked(reference, "", "RGB").mean()
        truth = stacked(reference, "", "RGB").astype(float) * scale
        noise = stacked(reference, "half_difference.", "RGB").astype(float) * scale
        weight = 1 / (truth**2 + (0.01 * np.percentile(truth, 99, axis=(0, 1))) ** 2)
        relmse = lambda p: np.mean(((p - truth) ** 2 - noise**2) * weight)
        megapixels = samples.shape[0] * samples.shape[1] * 1e-6
        print(f"{name}: {samples.shape[1]} x {samples.shape[0]}")
        print(f"  {'':28}{'relMSE':>10}{'light':>10}{'s/MP':>8}{'claimed':>9}")

        def row(what, picture, half, seconds):
            light = picture.sum(dtype=float) / samples.sum(dtype=float)
            error = relmse(picture.astype(float))
            cost = "" if seconds is None else f"{seconds / megapixels:8.2f}"
            claimed = "" if half is None else f"{np.mean(half.astype(float) ** 2 * weight) / error:9.2f}"
            print(f"  {what:28}{error:10.5f}{light:10.5f}{cost:>8}{claimed:>9}")

        row("32 samples", samples, stacked(planes, "half_difference.", "RGB"), None)
        for by in ["builtin", "oidn"]:
            out = f"{folder}/{name}-{by}.exr"
            before = processor_s()
            done = subprocess.run([diopter, "denoise", f"{folder}/{name}-32.exr", "--by", by, "-o", out], capture_output=True, text=True)
            seconds = processor_s() - before
            if done.returncode != 0:
                print(f"  {by}: {done.stderr.strip()}")
                continue
            result, _ = channels(out)
            row(f"diopter, {by}", stacked(result, "", "RGB"), stacked(result, "half_difference.", "RGB"), seconds)
        if pyoidn is None:
            print("  pyoidn is not installed")
            continue
        finite = lambda p, low: np.ascontiguousarray(np.clip(np.nan_to_num(p, nan=0, posinf=0, neginf=0), low, 1))
        albedo = finite(stacked(planes, "albedo.", "RGB"), 0)
        normal = finite(stacked(planes, "normal.", "XYZ"), -1)
        means = samples.mean((0, 1))
        scaled = np.ascontiguousarray(samples / means)
        for clean in [True, False]:
            call = lambda: pyoidn.denoise(scaled, albedo, normal, hdr=True, clean_aux=clean)
            call()
            started = time.process_time()
            picture = call() * means
            row(f"pyoidn, {'clean' if clean else 'plain'} features", picture, None, time.process_time() - started)


main()
