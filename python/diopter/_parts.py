"""What engines that schedule work share: finding them, and one large picture in parts (ranges of samples, which merge)."""

from __future__ import annotations

import functools
import importlib
import os
import pickle
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Iterator, Mapping, TypeVar

from ._errors import DiopterError
from ._images import FocalPlane
from ._pipeline import _bar, expose, merge
from ._program import command

if TYPE_CHECKING:
    from ._camera import Camera
    from ._pipeline import Progress
    from ._scene import Scene


def engine(module: str, extra: str) -> Any:
    """The module of an engine, which is installed with an extra of this package."""
    try:
        return importlib.import_module(module)
    except ImportError as e:
        hint = f"pip install 'diopter[{extra}]'"
        raise DiopterError(f"{module} is not installed: {e}", module, "no module", module, hint) from None


def sample_ranges(spp: int | None, parts: int) -> list[tuple[int, int]]:
    """Ranges of samples that cover all of a picture once, of about the same length. They begin at even numbers: even and odd samples are two independent
    halves, from which the variance is estimated."""
    if spp is None or spp < 1:
        raise DiopterError(f"spp {spp}: expected a number of samples a pixel", "spp", str(spp), "a number of samples a pixel")
    if not 1 <= parts <= (spp + 1) // 2:
        expected = f"1 to {(spp + 1) // 2}: two samples a part at least"
        raise DiopterError(f"parts {parts}: expected {expected}", "parts", str(parts), expected)
    pairs = (spp + 1) // 2
    ends = [min(2 * (pairs * k // parts), spp) for k in range(parts + 1)]
    return list(zip(ends, ends[1:]))


def packed(scene: Scene | None) -> bytes | None:
    """A scene as it travels: once to each worker or machine, not with each task."""
    return None if scene is None else pickle.dumps(scene)


@functools.lru_cache(maxsize=1)
def _unpacked(scene: bytes) -> Scene:
    # Kept from task to task, with what was built of it for its rays.
    kept: Scene = pickle.loads(scene)
    return kept


def expose_part(
    scene: bytes | None,
    camera: Camera | None,
    samples: tuple[int, int],
    record: str,
    threads: int | None,
    settings: Mapping[str, Any],
) -> FocalPlane:
    """One of them: what a worker does."""
    part: dict[str, Any] = {**settings, "samples": samples}
    return expose(None if scene is None else _unpacked(scene), camera, record=record, threads=threads, **part)



_Handle = TypeVar("_Handle")


def joined(
    handles: Iterator[_Handle],
    result: Callable[[_Handle], FocalPlane],
    parts: int,
    to: str | os.PathLike[str] | None,
    progress: Progress,
) -> FocalPlane:
    """The picture of so many parts that an engine gives in any order; they are merged in the order of their samples. With ``to`` they wait in a folder
    beside it, and no more than one of them is in memory."""
    if to is None:
        return merge([plane for _, plane in sorted(_as_they_come(handles, result, parts, progress), key=lambda part: part[0])])
    path = Path(to)
    if path.suffix != ".exr" or not path.parent.is_dir():
        expected = "a name that ends in .exr, in a folder that is there"
        raise DiopterError(f"to {path}: expected {expected}", "to", str(path), expected)
    with tempfile.TemporaryDirectory(prefix=".diopter-", dir=path.parent) as room:
        names = {}
        for first, plane in _as_they_come(handles, result, parts, progress):
            names[first] = Path(room, f"{first}.exr")
            plane.save(names[first])
            del plane
        command("merge", *(names[first] for first in sorted(names)), "-o", path)
    return FocalPlane.load(path)


def _as_they_come(
    handles: Iterator[_Handle], result: Callable[[_Handle], FocalPlane], parts: int, progress: Progress
) -> Iterator[tuple[int, FocalPlane]]:
    """First samples and parts."""
    with _bar(progress, "parts") as bar:
        for done, handle in enumerate(handles, 1):
            plane = result(handle)
            del handle
            yield int(plane.metadata["first_sample"]), plane
            if bar is not None:
                bar(done / parts)
