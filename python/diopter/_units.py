"""Values with units, as people write them, into plain numbers and JSON."""

from __future__ import annotations

import math
import os
import re
from typing import TYPE_CHECKING, Any, Mapping

from ._errors import DiopterError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})(?:\s*/\s*({_NUMBER}))?\s*([a-zA-Zµ]*)\s*")

LENGTH_MM = {"": 1.0, "mm": 1.0, "cm": 10.0, "um": 1e-3, "µm": 1e-3, "m": 1000.0}
DISTANCE_M = {"": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001}
TIME_S = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0}


def number(place: str, value: float | str, units: Mapping[str, float], example: str) -> float:
    """A number in the unit whose factor is 1 of a value that may bring its own unit."""
    if not isinstance(value, str):
        return float(value)
    if value.strip().lower() in ("inf", "infinity"):
        return math.inf
    found = _QUANTITY.fullmatch(value)
    factor = units.get(found[3]) if found else None
    if found is None or factor is None or (found[2] is not None and float(found[2]) == 0.0):
        raise DiopterError(
            f'{place} "{value}": expected a value such as {example}', place, f'"{value}"', f"a value such as {example}"
        )
    return float(found[1]) / float(found[2] or 1.0) * factor


def f_number(place: str, value: float | str) -> float:
    """An f-number: "f/2.8" or 2.8."""
    return _stop(place, value, "fF", '"f/2.8"')


def t_stop(place: str, value: float | str) -> float:
    """A T-stop: "T2.9" or 2.9."""
    return _stop(place, value, "tTfF", '"T2.9"')


def _stop(place: str, value: float | str, letters: str, example: str) -> float:
    if isinstance(value, str):
        value = re.sub(rf"^\s*[{letters}]/?(?=\s*[\d.])", "", value)
    return number(place, value, {"": 1.0}, example)


def plain(value: Any) -> Any:
    """A value as JSON has it: paths and arrays as text and lists, infinity as "inf"."""
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, bool) or value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, float):
        if math.isfinite(value):
            return value
        return "inf" if value > 0 else str(value)
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    raise TypeError(f"{value!r}: expected text, a number, a list or a mapping")


def floats(value: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """A contiguous array of single precision; without a copy where it is one."""
    import numpy as np

    return np.ascontiguousarray(value, dtype=np.float32)


def three(value: float | npt.ArrayLike, name: str) -> list[float]:
    """Three numbers of one (a grey) or of three."""
    import numpy as np

    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0:
        return [float(array)] * 3
    if array.shape != (3,):
        raise DiopterError(
            f"{name} of shape {array.shape}: expected one number or three",
            name,
            f"of shape {array.shape}",
            "one number or three",
        )
    return [float(v) for v in array]
