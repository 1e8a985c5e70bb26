"""Data sets and large pictures on Dask (``pip install diopter[dask]``): Dask schedules, repeats what dies with a worker, and moves the results.

Workers have diopter installed, and see the files of the specification where this program sees them; or ``at`` says where they are (such as the folder of
Dask's ``UploadDirectory``)::

    client = distributed.Client("scheduler:8786")
    diopter.dask.make(client, dataset, "out")
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Iterator, Mapping

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
    return engine("distributed", "dask")


def _first_done(pending: list[Any]) -> Any:
    return next(iter(_engine().wait(pending, return_when="FIRST_COMPLETED").done))


def make(
    client: Any,
    dataset: Dataset,
    folder: str | os.PathLike[str],
    *,
    threads: int = 1,
    resources: Mapping[str, float] | None = None,
    retries: int = 3,
    chunk: int = 1,
    most: int | None = None,
    at: str | os.PathLike[str] | None = None,
    progress: Progress = False,
) -> list[Path]:
    """Makes a data set, or goes on with one that was stopped. The bytes are those of :meth:`diopter.Dataset.make`.

    Args:
        client: ``distributed.Client``.
        folder: On this machine: results come here.
        threads: Of each task. Workers that run several tasks at once share their cores among them.
        resources: What a task asks for of workers that were started with ``--resources``: ``{"MEMORY": 4e9}``.
        retries: How often a task that fails is repeated. What dies with its worker is repeated by Dask's own rule (``allowed-failures``).
        chunk: Items of a task; some seconds of work hide what a task costs.
        most: Tasks that Dask has at once; without, three for each thread of its workers.
        at: The folder of the specification as workers see it, if that is another.
        progress: True for a bar, or a function that is called with the fraction that is done.
    """
    _engine()
    slots = sum(client.nthreads().values()) or 1

    def submit(task: Task) -> Any:
        return client.submit(_run, task, pure=False, retries=retries, resources=resources)

    def run(tasks: Iterator[Task]) -> Iterator[list[Made]]:
        for handle in in_flight(tasks, most or 3 * slots, submit, _first_done):
            yield handle.result()

    return gather(dataset, folder, run, threads=threads, chunk=chunk, at=at, progress=progress)


def expose(
    client: Any,
    scene: Scene | None = None,
    camera: Camera | None = None,
    *,
    parts: int,
    spp: int,
    record: str = "electrons",
    threads: int = 1,
    resources: Mapping[str, float] | None = None,
    retries: int = 3,
    most: int | None = None,
    to: str | os.PathLike[str] | None = None,
    progress: Progress = False,
    **settings: Any,
) -> FocalPlane:
    """Exposes one picture in ``parts`` ranges of its samples, and merges them. The scene is sent once to each worker. Other arguments are those of
    :func:`diopter.expose`; the result is that of the same parts anywhere, in whatever order they end.

    Args:
        parts: Ranges of samples. Each is as large as the picture.
        to: An EXR file that the picture is written to: parts then wait beside it on the disk, where without all are in memory.
        most: Parts that Dask has at once; without, two for each thread of its workers.
        progress: True for a bar, or a function that is called with the fraction that is done.
    """
    _engine()
    ranges = sample_ranges(spp, parts)
    held = None if scene is None else client.scatter(packed(scene), broadcast=True)
    slots = sum(client.nthreads().values()) or 1

    def submit(samples: tuple[int, int]) -> Any:
        given = {**settings, "spp": spp}
        return client.submit(
            expose_part, held, camera, samples, record, threads, given, pure=False, retries=retries, resources=resources
        )

    handles = in_flight(ranges, most or 2 * slots, submit, _first_done)
    return joined(handles, lambda handle: handle.result(), len(ranges), to, progress)
