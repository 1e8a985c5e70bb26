"""How data sets and large pictures scale from 1 to 1000 workers: a simulation from measured times.

    python validation/dataset_engines.py --times times.json
    python validation/scale_simulation.py times.json

Measured (two cores): seconds of each item on one thread, its bytes, what gathering it costs, what a task costs on each engine, core seconds of a sample, what a
part of a picture costs to pack, move, unpack and merge. Assumed, not measured: a network of 10 Gbit/s into the machine that gathers (--gbit); a core
of a worker is as fast as one here; nothing dies; what a task costs does not grow with the number of workers.

Ray and Dask: one program submits tasks, at most three for each worker at once, and takes the results one after the other; the scheduler handles one
task after the other. Open Job Description: tasks start a process each, write to a folder that all see, and one process packs at the end.
"""
import argparse, heapq, json, random
from pathlib import Path

WORKERS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000]


def gathered(workers, tasks, schedule_s, collect_s, start_s):
    """Wall seconds of tasks that one program hands out and collects, and how busy scheduler and program were.

    `tasks`: seconds of work of each. An event simulation with two servers in a row (scheduler, collector) and `workers` beside each other.
    """
    idle = [(start_s, w) for w in range(workers)]
    heapq.heapify(idle)
    running: list[tuple[float, int]] = []
    waiting: list[float] = []
    scheduler = collector = 0.0
    submitted = 0
    taken = 0

    def submit(at):
        nonlocal scheduler, submitted
        scheduler = max(scheduler, at) + schedule_s
        waiting.append(scheduler)
        submitted += 1

    def assign():
        nonlocal taken
        while taken < len(waiting) and idle:
            free, worker = heapq.heappop(idle)
            heapq.heappush(running, (max(free, waiting[taken]) + tasks[taken], worker))
            taken += 1

    while submitted < min(3 * workers, len(tasks)):
        submit(0.0)
    assign()
    done = 0
    while done < len(tasks):
        now, worker = heapq.heappop(running)
        heapq.heappush(idle, (now, worker))
        collector = max(collector, now) + collect_s
        done += 1
        if submitted < len(tasks):
            submit(collector)
        assign()
    return collector, len(tasks) * schedule_s / collector, len(tasks) * collect_s / collector


def self_check():
    """Closed forms: one worker, many workers without costs, a scheduler or a collector that is the bottleneck."""
    near = lambda a, b: abs(a - b) <= 1e-9 * b
    assert near(gathered(1, [2.0] * 10, 0, 0, 0)[0], 20)
    assert near(gathered(5, [2.0] * 10, 0, 0, 1)[0], 5)
    assert near(gathered(100, [0.1] * 10, 1.0, 0, 0)[0], 10.1), "the scheduler hands out one a second"
    assert near(gathered(100, [0.1] * 10, 0, 1.0, 0)[0], 10.1), "the program takes one a second"


def show(title, rows):
    print(f"\n{title}\n")
    print("| workers | time | efficiency | what limits |\n|---|---|---|---|")
    for workers, seconds, work, why in rows:
        text = f"{seconds / 3600:.1f} h" if seconds >= 7200 else f"{seconds / 60:.1f} min" if seconds >= 120 else f"{seconds:.1f} s"
        print(f"| {workers} | {text} | {100 * work / (workers * seconds):.0f} % | {why} |")


def data_set(times, engine, count, chunk, factor, bandwidth):
    rng = random.Random(1)
    items = [factor * rng.choice(times["items_s"]) for _ in range(count)]
    tasks = [sum(items[k : k + chunk]) for k in range(0, count, chunk)]
    # Of a task that gives back bytes, what moving them cost here is in the measurement; a network is added.
    schedule = (times["item_bytes_task_ms"][engine] + (chunk - 1) * (times["item_bytes_task_ms"][engine] - times["empty_task_ms"][engine])) / 1000
    collect = chunk * (times["gather_s"] + times["item_bytes"] / bandwidth)
    rows = []
    for workers in WORKERS:
        seconds, scheduler, collector = gathered(workers, tasks, max(schedule, 0), collect, times["start_s"])
        limits = {"the work": sum(items) / (workers * seconds), "the scheduler": scheduler, "gathering": collector}
        rows.append((workers, seconds, sum(items), max(limits, key=lambda k: limits[k])))
    show(f"{count} items of {1000 * sum(items) / count:.0f} ms, {chunk} a task, {engine}", rows)


def farm(times, count, chunk, factor):
    rng = random.Random(1)
    items = [factor * rng.choice(times["items_s"]) for _ in range(count)]
    tasks = [sum(items[k : k + chunk]) + times["empty_task_ms"]["openjd"] / 1000 for k in range(0, count, chunk)]
    rows = []
    for workers in WORKERS:
        made, _, _ = gathered(workers, tasks, 0, 0, 0)
        pack = count * times["gather_s"]
        rows.append((workers, made + pack, sum(items), "packing at the end" if pack > made else "the work"))
    show(f"{count} items of {1000 * sum(items) / count:.0f} ms, {chunk} a task, Open Job Description", rows)


def picture(times, megapixels, spp, bandwidth):
    rows, best = [], None
    work = megapixels * spp * times["core_s_per_megasample"]
    moved = times["part_bytes_per_pixel"] * megapixels * 1e6 / bandwidth
    collect = moved + megapixels * (times["unpack_s_per_megapixel"] + times["merge_s_per_megapixel"])
    for workers in WORKERS:
        # A part for each worker, of two samples at least; one worker needs no merging.
        parts = min(workers, spp // 2)
        part = work / parts + megapixels * times["pack_s_per_megapixel"]
        seconds = work if workers == 1 else gathered(parts, [part] * parts, 0, collect, times["start_s"])[0]
        rows.append((workers, seconds, work, "the work" if part > parts * collect or workers == 1 else "gathering parts"))
    show(f"One picture of {megapixels} megapixels, {spp} samples, a part each", rows)
    gigabytes = times["part_bytes_per_pixel"] * megapixels / 1000
    print(f"\nA part is {gigabytes:.1f} GB; one costs {collect:.0f} s to take in: moving {moved:.0f} s, the rest unpacking and merging. Best near √(work / cost of a part) = {(work / collect) ** 0.5:.0f} parts.")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("times", type=Path)
    parser.add_argument("--gbit", type=float, default=10)
    asked = parser.parse_args()
    self_check()
    times, bandwidth = json.loads(asked.times.read_text()), asked.gbit * 1e9 / 8
    print({key: (round(value, 6) if isinstance(value, float) else value) for key, value in times.items() if key != "items_s"})
    print("items:", len(times["items_s"]), "mean", round(sum(times["items_s"]) / len(times["items_s"]), 4), "s")
    for engine in ("ray", "dask"):
        if engine in times["empty_task_ms"]:
            data_set(times, engine, 100_000, 1, 1, bandwidth)
            data_set(times, engine, 100_000, 16, 1, bandwidth)
            data_set(times, engine, 100_000, 1, 64, bandwidth)
    if "openjd" in times["empty_task_ms"]:
        farm(times, 100_000, 100, 1)
    picture(times, 100, 256, bandwidth)
    picture(times, 100, 2048, bandwidth)


if __name__ == "__main__":
    main()
