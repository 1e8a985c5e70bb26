"""Data sets and large pictures on Ray (``pip install diopter[ray]``): Ray schedules, repeats what dies with a worker, and moves the results.

The program that calls these functions is connected as any other: ``ray.init()``, or by itself on first use. Workers have diopter installed, and see the files
of the specification where this program sees them; or Ray carries the folder, once to each machine::

    ray.init(runtime_env={"working_dir": "folder-of-the-specification"})
    diopter.ray.make(dataset, "out", at=".")
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Iterator

from ._parts import engine, expose_part, joined, packed, sample_ranges
from .dataset import Dataset, Task, _run, gather, in_flight

if TYPE_CHECKING:
    from pathlib import Path

    from ._camera import Camera
    from ._images import FocalPlane
    from ._pipeline import Progress
    from ._scene import Scene
    from .dataset import Made

__all__ = ["expose", "make"]


def _engine() -> Any:
    return engine("ray", "ray")


def _first_done(pending: list[Any]) -> Any:
    return _engine().wait(pending, num_returns=1)[0][0]


def _options(cpus: float, memory: int | None, retries: int) -> dict[str, Any]:
    options: dict[str, Any] = {"num_cpus": cpus, "max_retries": retries}
    if memory is not None:
        options["memory"] = memory
    return options


def make(
    dataset: Dataset,
    folder: str | os.PathLike[str],
    *,
    cpus: float = 1,
    memory: int | None = None,
    retries: int = 3,
    chunk: int = 1,
    most: int | None = None,
    at: str | os.PathLike[str] | None = None,
    progress: Progress = False,
) -> list[Path]:
    """Makes a data set, or goes on with one that was stopped. The bytes are those of :meth:`diopter.Dataset.make`.

    Args:
        folder: On this machine: results come here.
        cpus: Cores that a task asks for, and threads that it takes.
        memory: Bytes that a task asks for.
        retries: How often a task is repeated when its worker dies. What fails for a reason of its own is not repeated.
        chunk: Items of a task; some seconds of work hide what a task costs.
        most: Tasks that Ray has at once; without, three for each core of the cluster.
        at: The folder of the specification as workers see it, if that is another.
        progress: True for a bar, or a function that is called with the fraction that is done.
    """
    ray = _engine()
    if not ray.is_initialized():
        ray.init()
    remote = ray.remote(**_options(cpus, memory, retries))(_run)
    cores = float(ray.cluster_resources().get("CPU", 1))

    def run(tasks: Iterator[Task]) -> Iterator[list[Made]]:
        for handle in in_flight(tasks, most or max(int(3 * cores), 1), remote.remote, _first_done):
            yield ray.get(handle)

    return gather(dataset, folder, run, threads=max(int(cpus), 1), chunk=chunk, at=at, progress=progress)


def expose(
    scene: Scene | None = None,
    camera: Camera | None = None,
    *,
    parts: int,
    spp: int,
    record: str = "electrons",
    cpus: float = 1,
    memory: int | None = None,
    retries: int = 3,
    most: int | None = None,
    to: str | os.PathLike[str] | None = None,
    progress: Progress = False,
    **settings: Any,
) -> FocalPlane:
    """Exposes one picture in ``parts`` ranges of its samples, and merges them. The scene is sent once to each machine. Other arguments are those of
    :func:`diopter.expose`; the result is that of the same parts anywhere, in whatever order they end.

    Args:
        parts: Ranges of samples. Each is as large as the picture.
        to: An EXR file that the picture is written to: parts then wait beside it on the disk, where without all are in memory.
        most: Parts that Ray has at once; without, two for each core of the cluster.
        progress: True for a bar, or a function that is called with the fraction that is done.
    """
    ray = _engine()
    ranges = sample_ranges(spp, parts)
    if not ray.is_initialized():
        ray.init()
    remote = ray.remote(**_options(cpus, memory, retries))(expose_part)
    held = ray.put(packed(scene))
    threads = max(int(cpus), 1)
    cores = float(ray.cluster_resources().get("CPU", 1))

    def submit(samples: tuple[int, int]) -> Any:
        return remote.remote(held, camera, samples, record, threads, {**settings, "spp": spp})

    handles = in_flight(ranges, most or max(int(2 * cores), 1), submit, _first_done)
    return joined(handles, ray.get, len(ranges), to, progress)
