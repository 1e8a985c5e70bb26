"""One data set and one picture made by every engine are the same bytes, also where workers die; and the readers of training read what was made.

Makes a data set of 200 items (64 × 64) in one process, by two processes, by Ray and Dask with a worker that is killed in the middle, and by `openjd run` with a task
that fails; compares all files. Takes one picture in parts by Ray and Dask, with a worker killed too, and compares it with the same parts of one process.
Reads the shards with webdataset, Hugging Face's datasets and torch's DataLoader of 4 workers, and compares the arrays. Measures what a task costs on each
engine. What is not installed is left out, and said.

    pip install .[ray,dask] openjd-cli webdataset datasets torch psutil
    python validation/dataset_engines.py [ITEMS] [--times times.json]       # times.json is what scale_simulation.py takes
"""
import argparse, importlib.util, io, json, os, pickle, signal, stat, subprocess, sys, tempfile, time
from pathlib import Path

import numpy as np

import diopter as dp
from diopter._parts import sample_ranges

SPEC = """
name = "engines"
items = %d
seed = 11
[shot]
scene.file = "cornell"
exposure.shutter = "1/30"
render = { size = "64x64", spp = 2 }
camera = { lens = "thin", body = "nikon-d850" }
[[vary]]
name = "iso"
choice = [100, 400, 1600]
[[vary]]
name = "aperture"
range = ["f/2", "f/8"]
scale = "log"
[[vary]]
name = "scene"
choice = ["cornell", "rolling-ball"]
weights = [3, 1]
[write]
files = ["dng", "expected.npy", "mean.npy", "depth.npy"]
shard_items = 64
[split]
fractions = { train = 0.8, test = 0.2 }
"""
# The picture in parts.
PICTURE = dict(size=(300, 200), shutter="1/60 s", seed=4)
SPP, PARTS = 16, 8
EMPTY = 500

times: dict = {"empty_task_ms": {}, "item_bytes_task_ms": {}}


def here(name):
    return importlib.util.find_spec(name) is not None


def files(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(Path(folder).rglob("*")) if p.is_file()}


class Killer:
    """A progress function that kills a worker once, when a quarter is done."""

    def __init__(self, workers):
        self.workers, self.killed = workers, None

    def __call__(self, part):
        if self.killed is None and 0.25 <= part < 1:
            found = self.workers()
            self.killed = found[0]
            os.kill(self.killed, signal.SIGKILL)
            print(f"  killed {self.killed} of the workers {found} at {100 * part:.0f} %", flush=True)


def some_bytes(count):
    return bytes(count)


def empty_tasks(name, run):
    """What a task costs that does nothing, and one that gives back as much as an item."""
    size = int(times["item_bytes"])
    run(os.getpid, [()] * 20)
    for key, function, arguments in (("empty_task_ms", os.getpid, [()] * EMPTY), ("item_bytes_task_ms", some_bytes, [(size,)] * EMPTY)):
        begun = time.perf_counter()
        run(function, arguments)
        times[key][name] = 1000 * (time.perf_counter() - begun) / EMPTY
    print(f"  an empty task: {times['empty_task_ms'][name]:.2f} ms; one that gives back {size} bytes: {times['item_bytes_task_ms'][name]:.2f} ms")


def picture(scene, camera):
    """The picture in parts by this process, and as a whole."""
    megapixels = PICTURE["size"][0] * PICTURE["size"][1] / 1e6
    dp.expose(scene, camera, spp=2, threads=1, **PICTURE)
    begun = time.process_time()
    parts = [dp.expose(scene, camera, spp=SPP, samples=part, threads=1, **PICTURE) for part in sample_ranges(SPP, PARTS)]
    times["core_s_per_megasample"] = (time.process_time() - begun) / (SPP * megapixels)
    begun = time.process_time()
    merged = dp.merge(parts)
    times["merge_s_per_megapixel"] = (time.process_time() - begun) / PARTS / megapixels
    begun = time.process_time()
    packed = pickle.dumps(parts[0])
    times["pack_s_per_megapixel"] = (time.process_time() - begun) / megapixels
    begun = time.process_time()
    pickle.loads(packed)
    times["unpack_s_per_megapixel"] = (time.process_time() - begun) / megapixels
    times["part_bytes_per_pixel"] = len(packed) / (1e6 * megapixels)
    print(
        f"picture: {times['core_s_per_megasample']:.2f} core s a million samples; a part is {times['part_bytes_per_pixel']:.1f} bytes a pixel; a megapixel of it takes "
        f"{times['pack_s_per_megapixel']:.3f} s to pack, {times['unpack_s_per_megapixel']:.3f} s to unpack, {times['merge_s_per_megapixel']:.3f} s to merge"
    )
    whole = dp.expose(scene, camera, spp=SPP, **PICTURE)
    off = np.abs(merged.mean - whole.mean).max() / whole.mean.max()
    print(f"picture: {PARTS} parts merged are off the undivided exposure by {off:.1e} of the largest value at most")
    assert off < 1e-6
    return pickle.dumps(merged)


def with_processes(dataset, folder, scene, camera):
    dataset.make(folder, workers=2, chunk=4)


def with_ray(dataset, folder, scene, camera):
    import psutil, ray
    import diopter.ray

    def workers():
        # Ray names its workers after what they run; its own agents are called ray::, too, and its node ends with them.
        named = [(p.pid, " ".join(p.cmdline()[:1])) for p in psutil.Process().children(recursive=True)]
        return [pid for pid, name in named if name.startswith(("ray::_run", "ray::expose_part"))]

    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    diopter.ray.make(dataset, folder, chunk=2, progress=Killer(workers))
    plane = diopter.ray.expose(scene, camera, parts=PARTS, spp=SPP, progress=Killer(workers), **PICTURE)

    def run(function, arguments):
        remote = ray.remote(lambda *arguments: function(*arguments))  # Ray takes no builtins
        ray.get([remote.remote(*a) for a in arguments])

    empty_tasks("ray", run)
    ray.shutdown()
    return pickle.dumps(plane)


def with_dask(dataset, folder, scene, camera):
    import distributed
    import diopter.dask

    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, distributed.Client(cluster) as client:

        def workers():
            return sorted(client.run(os.getpid).values())

        diopter.dask.make(client, dataset, folder, chunk=2, progress=Killer(workers))
        client.wait_for_workers(2)
        plane = diopter.dask.expose(client, scene, camera, parts=PARTS, spp=SPP, progress=Killer(workers), **PICTURE)
        client.wait_for_workers(2)
        empty_tasks("dask", lambda function, arguments: client.gather([client.submit(function, *a, pure=False) for a in arguments]))
    return pickle.dumps(plane)


def with_openjd(dataset, folder, scene, camera):
    room = Path(folder).parent / "openjd"
    room.mkdir()
    (room / "spec.toml").write_text(dataset.specification)
    dp.command("dataset", "job", room / "spec.toml", "-o", room / "job.yaml", "--items-per-task", "25", "--folder", room / "set")
    # Stands before the program: the task of the items from 50 on fails the first time.
    program = room / "sometimes"
    program.write_text(
        f'#!/bin/sh\nif [ "$4" = --item ] && [ "$5" = 50 ] && [ ! -e {room}/failed ]; then touch {room}/failed; exit 1; fi\n'
        f'exec {sys.executable} -m diopter "$@"\n'
    )
    program.chmod(program.stat().st_mode | stat.S_IEXEC)
    openjd = [sys.executable, "-m", "openjd"]
    command = [*openjd, "run", str(room / "job.yaml"), "-p", f"Program={program}"]
    check = subprocess.run([*openjd, "check", str(room / "job.yaml")], check=True, capture_output=True, text=True)
    print(f"  openjd check: {check.stdout.strip().splitlines()[-1]}")
    first = subprocess.run(command, capture_output=True, text=True)
    print(f"  first run: exit code {first.returncode}; {len(list((room / 'set').rglob('*.tar')))} archives are there")
    assert first.returncode != 0 and (room / "failed").exists()
    begun = time.perf_counter()
    second = subprocess.run(command, capture_output=True, text=True)
    print(f"  second run: exit code {second.returncode}, {time.perf_counter() - begun:.1f} s")
    if second.returncode:
        print(second.stdout[-2000:], second.stderr[-2000:])
    # What a task costs there: a process that makes nothing new, beside the session's own work.
    tasks = len(range(0, len(dataset), 25)) + 1
    begun = time.perf_counter()
    subprocess.run(command, capture_output=True)
    times["empty_task_ms"]["openjd"] = times["item_bytes_task_ms"]["openjd"] = 1000 * (time.perf_counter() - begun) / tasks
    print(f"  a task that finds all done: {times['empty_task_ms']['openjd']:.0f} ms, of {tasks}")
    os.rename(room / "set", folder)


def readers(dataset, folder):
    """Whether other programs read what was made: all items, in order, the arrays to the last bit."""
    train = sorted(Path(folder).glob("train-*.tar"))
    keys = [f"{k:06}" for s in dataset.shards if s.name.startswith("train") for k in s.items]
    right = True

    def tell(name, found, equal):
        nonlocal right
        right &= equal and found == keys
        print(f"{name}: {len(found)} of {len(keys)} items, {'in order' if found == keys else 'NOT IN ORDER'}, {'arrays equal' if equal else 'OTHER ARRAYS'}")

    some = {keys[k]: dataset[int(keys[k])] for k in range(0, len(keys), 37)}
    if here("webdataset"):
        import webdataset

        read = {item["__key__"]: item for item in webdataset.WebDataset([str(p) for p in train], shardshuffle=False).decode()}
        tell("webdataset", list(read), all(np.array_equal(read[k]["mean.npy"], v["mean.npy"]) for k, v in some.items()))
    if here("datasets"):
        import datasets

        stream = datasets.load_dataset("webdataset", data_files={"train": [str(p) for p in train]}, split="train", streaming=True)
        read = {item["__key__"]: item for item in stream}
        array = lambda v: np.load(io.BytesIO(v)) if isinstance(v, bytes) else np.asarray(v)
        tell("datasets", list(read), all(np.array_equal(array(read[k]["mean.npy"]), v["mean.npy"]) for k, v in some.items()))
    if here("torch"):
        from torch.utils.data import DataLoader

        if here("webdataset"):
            # Shards are shared out among the workers of the loader: all items once, in another order.
            pipe = webdataset.WebDataset([str(p) for p in train], shardshuffle=False, empty_check=False).decode()
            read = {item["__key__"]: item for batch in DataLoader(pipe, batch_size=8, num_workers=4, collate_fn=list) for item in batch}
            tell("torch, 4 workers, webdataset", sorted(read), all(np.array_equal(read[k]["mean.npy"], v["mean.npy"]) for k, v in some.items()))
        loader = DataLoader(dataset, batch_size=8, num_workers=4, collate_fn=list)
        read = {item["json"]["key"]: item for batch in loader for item in batch}
        expected = [f"{k:06}" for k in range(len(dataset))]
        equal = all(np.array_equal(read[k]["mean.npy"], v["mean.npy"]) for k, v in some.items()) and list(read) == expected
        right &= equal
        print(f"torch, 4 workers, items made when asked for: {len(read)} of {len(dataset)} items, {'the same' if equal else 'NOT THE SAME'}")
    return right


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("items", nargs="?", type=int, default=200)
    parser.add_argument("--times", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as room:
        spec = Path(room, "spec.toml")
        spec.write_text(SPEC % asked.items)
        dataset = dp.Dataset(spec)
        # Item by item, on one thread: what a worker does, and what gathering costs.
        def timed(tasks):
            for task in tasks:
                began = time.perf_counter()
                made = task.run()
                items_s.append(time.perf_counter() - began)
                yield made

        items_s: list[float] = []
        one = Path(room, "one")
        begun = time.perf_counter()
        dp.dataset.gather(dataset, one, timed, threads=1)
        alone = time.perf_counter() - begun
        expected = files(one)
        times["items_s"] = items_s
        times["gather_s"] = (alone - sum(items_s)) / asked.items
        times["item_bytes"] = float(np.mean([len(dataset.archive(k)) for k in range(0, asked.items, 17)]))
        begun = time.perf_counter()
        subprocess.run([sys.executable, "-c", "import diopter, diopter.dataset"], check=True)
        times["start_s"] = time.perf_counter() - begun
        print(
            f"one process, one thread: {alone:.1f} s, {1000 * alone / asked.items:.1f} ms an item, of which {1000 * times['gather_s']:.2f} ms gathering; "
            f"{sum(map(len, expected.values())) / 1e6:.1f} MB in {len(expected)} files"
        )
        scene, camera = dp.Scene.builtin("still-life"), dp.Camera(lens="double-gauss-50mm", body="nikon-d850", focus="0.8 m", aperture="f/4")
        merged = picture(scene, camera)
        same = True
        engines = [("processes", None, with_processes), ("ray", "ray", with_ray), ("dask", "distributed", with_dask), ("openjd", "openjd", with_openjd)]
        for name, module, make in engines:
            if module and not here(module):
                print(f"{name}: not installed")
                continue
            folder = Path(room, f"by-{name}")
            begun = time.perf_counter()
            print(f"{name}:", flush=True)
            plane = make(dataset, folder, scene, camera)
            taken, found = time.perf_counter() - begun, files(folder)
            odd = [n for n in expected.keys() | found.keys() if expected.get(n) != found.get(n)]
            same &= not odd
            print(f"{name}: {taken:.1f} s in all, data set: {'the same bytes' if not odd else f'OTHER BYTES: {odd}'}", flush=True)
            if plane is not None:
                same &= plane == merged
                print(f"{name}: picture in parts: {'the same bytes' if plane == merged else 'OTHER BYTES'}", flush=True)
        same &= readers(dataset, one)
        if asked.times:
            asked.times.write_text(json.dumps(times))
        print(json.dumps({"items": asked.items, "same": bool(same)}))
        return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
