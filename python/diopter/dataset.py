"""Data sets: many shots that differ as a specification says, with what is true of each.

An item is a pure function of the specification and of its number. What schedules the items (this process, several, Ray, Dask, a render farm) moves numbers
one way and archives the other; the data set has the same bytes whoever makes it. The specification is explained in ``docs/datasets.md``::

    dataset = dp.Dataset("pairs.toml")
    dataset.parameters(7)                       # what differs in an item
    dataset[7]["mean.npy"]                      # made now: numpy arrays, JSON as dictionaries, other files as bytes
    dataset.make("pairs", workers=8)            # shards that webdataset, datasets and Ray read, metadata.parquet, card.md

:mod:`diopter.ray` and :mod:`diopter.dask` make the same on clusters.
"""

from __future__ import annotations

import functools
import io
import json
import os
import tarfile
import warnings
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Iterable, Iterator, Mapping, NamedTuple, Sequence, TypeVar

import numpy as np

from . import _diopter
from ._errors import DiopterError, DiopterWarning
from ._pipeline import _bar
from ._units import plain

if TYPE_CHECKING:
    from ._pipeline import Progress

    #: Number of an item, its archive, what was found odd.
    Made = tuple[int, bytes, list[str]]

__all__ = ["Dataset", "Shard", "Task", "gather"]


class Shard(NamedTuple):
    """A shard of a data set."""

    #: Name of its file.
    name: str
    #: Numbers of its items.
    items: list[int]


class Task(NamedTuple):
    """Some items to make: what a worker is sent. Small, and the same for every attempt."""

    #: The specification (TOML).
    text: str
    #: What its paths are relative to, as the worker sees it.
    folder: str
    items: tuple[int, ...]
    #: Threads that the worker takes; None: one a core.
    threads: int | None = 1

    def run(self) -> list[Made]:
        """Makes the items: number, archive, and what was found odd. Worker processes keep the scene from one task to the next."""
        native = _native(self.text, "specification", self.folder)
        return [(item, *native.archive(item, self.threads)) for item in self.items]


@functools.lru_cache(maxsize=1)
def _native(text: str, place: str, folder: str) -> _diopter.Dataset:
    return _diopter.Dataset(text, place, folder)


def _run(task: Task) -> list[Made]:
    return task.run()


class Dataset:
    """A checked specification: a sequence of items that are made when they are asked for.

    ``torch.utils.data.DataLoader`` takes it as it is, with any number of workers; for training, make it once (:meth:`make`) and read the shards.

    Args:
        specification: A file (``.toml``), or the same as a dictionary.
        folder: What paths of a dictionary are relative to; the current folder without.

    Raises:
        DiopterError: With the entry that is wrong, what is there, what belongs there, and a hint.
    """

    __slots__ = ("_folder", "_native", "_place", "_text")

    def __init__(
        self, specification: str | os.PathLike[str] | Mapping[str, Any], folder: str | os.PathLike[str] | None = None
    ) -> None:
        if isinstance(specification, Mapping):
            self._text = _diopter.specification(json.dumps(plain(specification)))
            self._place = "specification"
            self._folder = os.path.abspath(folder or "")
        else:
            path = Path(specification)
            try:
                # As it is: other ends of lines would be another specification.
                self._text = path.read_bytes().decode("utf-8")
            except (OSError, ValueError) as e:
                raise DiopterError(f"{path}: {e}", str(path), str(e)) from None
            self._place = str(path)
            self._folder = os.path.abspath(folder or path.parent)
        self._native = _diopter.Dataset(self._text, self._place, self._folder)

    def __reduce__(self) -> tuple[Any, ...]:
        return (_of_text, (self._text, self._place, self._folder))

    def __repr__(self) -> str:
        return f"<diopter.Dataset {self.name!r}: {len(self)} items of {', '.join(self.files)}>"

    @property
    def name(self) -> str:
        """Its name."""
        return self._native.name

    @property
    def specification(self) -> str:
        """The specification as TOML."""
        return self._text

    @property
    def folder(self) -> Path:
        """What its paths are relative to."""
        return Path(self._folder)

    @property
    def files(self) -> list[str]:
        """Files of an item, by what stands behind its number: ``dng``, ``json``, ``mean.npy`` ..."""
        return self._native.endings

    @property
    def shards(self) -> list[Shard]:
        """All shards and their items."""
        return [Shard(name, items) for name, items in self._native.shards()]

    def __len__(self) -> int:
        return self._native.items

    def _number(self, item: int) -> int:
        if not -len(self) <= item < len(self):
            raise IndexError(f"item {item}: the data set has {len(self)}")
        return item % len(self)

    def parameters(self, item: int) -> dict[str, Any]:
        """``key``, ``item``, ``split`` and ``parameters`` (what differs) of an item, without making it."""
        found: dict[str, Any] = json.loads(self._native.parameters(self._number(item)))
        return found

    def archive(self, item: int, *, threads: int | None = None) -> bytes:
        """Makes an item: its files as a tar archive, as they stand in a shard."""
        archive, odd = self._native.archive(self._number(item), threads)
        for text in odd:
            warnings.warn(text, DiopterWarning, stacklevel=2)
        return archive

    def __getitem__(self, item: int) -> dict[str, Any]:
        """Makes an item: its files by their endings. ``.npy`` are arrays, ``json`` and ``calibration.json`` are dictionaries, all others are bytes."""
        made: dict[str, Any] = {}
        with tarfile.open(fileobj=io.BytesIO(self.archive(item))) as archive:
            for member in archive:
                file = archive.extractfile(member)
                assert file is not None
                ending, data = member.name.split(".", 1)[1], file.read()
                if ending.endswith("json"):
                    made[ending] = json.loads(data)
                else:
                    made[ending] = np.load(io.BytesIO(data)) if ending.endswith(".npy") else data
        return made

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self[item] for item in range(len(self)))

    def make(
        self,
        folder: str | os.PathLike[str],
        *,
        workers: int = 1,
        threads: int | None = None,
        chunk: int = 1,
        progress: Progress = False,
    ) -> list[Path]:
        """Makes the data set, or goes on with one that was stopped; the bytes do not depend on workers, threads and chunks.

        Args:
            folder: New or empty, or begun with the same specification.
            workers: Processes of this machine. Each reads the scene for itself.
            threads: Of each process; without, one of several processes takes one, and a single one takes one a core.
            chunk: Items that a process is sent at once.
            progress: True for a bar, or a function that is called with the fraction that is done.

        Returns:
            What was written.
        """
        if workers < 1:
            raise DiopterError(f"workers {workers}: expected 1 or more", "workers", str(workers), "1 or more")
        if workers == 1:
            return gather(self, folder, _one_by_one, threads=threads, chunk=chunk, progress=progress)
        # Processes that begin anew: those that are forked would share locks of threads that are not there.
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:

            def first_done(pending: list[Future[list[Made]]]) -> Future[list[Made]]:
                return next(iter(wait(pending, return_when=FIRST_COMPLETED).done))

            def run(tasks: Iterator[Task]) -> Iterator[list[Made]]:
                # Two for each process: none waits for the next task, and few results wait here.
                for future in in_flight(tasks, 2 * workers, lambda task: pool.submit(_run, task), first_done):
                    yield future.result()

            try:
                return gather(self, folder, run, threads=1 if threads is None else threads, chunk=chunk, progress=progress)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise


def _of_text(text: str, place: str, folder: str) -> Dataset:
    made = Dataset.__new__(Dataset)
    made._text, made._place, made._folder = text, place, folder
    made._native = _diopter.Dataset(text, place, folder)
    return made


def _one_by_one(tasks: Iterator[Task]) -> Iterator[list[Made]]:
    return map(_run, tasks)


def gather(
    dataset: Dataset,
    folder: str | os.PathLike[str],
    run: Callable[[Iterator[Task]], Iterator[list[Made]]],
    *,
    threads: int | None = None,
    chunk: int = 1,
    at: str | os.PathLike[str] | None = None,
    progress: Progress = False,
) -> list[Path]:
    """Makes a data set by whatever runs tasks; what is done already is left. For engines other than those that are here.

    Args:
        run: Is given tasks, and gives the results of :meth:`Task.run` in any order. Should not take all tasks at once: results come back through it.
        threads: Of each task.
        chunk: Items of a task.
        at: The folder of the specification as workers see it, if that is another.
    """
    if chunk < 1:
        raise DiopterError(f"chunk {chunk}: expected 1 or more", "chunk", str(chunk), "1 or more")
    native = _diopter.DatasetFolder(dataset._native, os.fspath(folder))
    missing = native.missing()
    done, told = len(dataset) - len(missing), set[str]()
    where = dataset._folder if at is None else os.fspath(at)
    parts: Sequence[tuple[int, ...]] = [tuple(missing[k : k + chunk]) for k in range(0, len(missing), chunk)]
    tasks = (Task(dataset._text, where, part, threads) for part in parts)
    with _bar(progress, "items") as bar:
        for result in run(tasks):
            for item, archive, odd in result:
                native.keep(item, archive)
                done += 1
                for text in odd:
                    if text not in told:
                        told.add(text)
                        warnings.warn(text, DiopterWarning, stacklevel=3)
            if bar is not None:
                bar(done / len(dataset))
    return [Path(folder) / name for name in native.finish()]


_Task = TypeVar("_Task")
_Handle = TypeVar("_Handle")


def in_flight(
    tasks: Iterable[_Task], most: int, submit: Callable[[_Task], _Handle], first_done: Callable[[list[_Handle]], _Handle]
) -> Iterator[_Handle]:
    """Keeps so many tasks with an engine, and gives their handles when they are done. ``first_done`` waits for one of a list."""
    pending: list[_Handle] = []
    for task in tasks:
        pending.append(submit(task))
        if len(pending) >= most:
            done = first_done(pending)
            pending.remove(done)
            yield done
    while pending:
        done = first_done(pending)
        pending.remove(done)
        yield done
