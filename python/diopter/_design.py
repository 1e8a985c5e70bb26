"""Images of points, wavefronts, and what a lens becomes: built within tolerances, optimised, fitted to measurements."""

from __future__ import annotations

import os
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Iterator, NamedTuple

from . import _diopter
from ._errors import DiopterError
from ._program import command

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ._camera import Lens

    Float32 = npt.NDArray[np.float32]
    Float64 = npt.NDArray[np.float64]


class Zernikes(NamedTuple):
    """Zernike coefficients of a wavefront."""

    #: Of each term from the first, waves.
    coefficients: Float64
    #: Root mean square of what the terms leave, waves.
    residual_rms: float
    #: Radial degree n and azimuthal frequency m (negative: sine) of each term.
    degrees: list[tuple[int, int]]
    #: What aberrations are called; empty where they have no name.
    names: list[str]


class Wavefront(NamedTuple):
    """Path differences of a field point to the sphere about the chief ray's film point through the exit pupil; positive: the wavefront is ahead."""

    #: Waves, ``[row][column]``, the upper edge of the pupil on top; NaN where no light passes.
    map: Float32
    #: Where rays cross the stop, over the radius of the axial beam there, ``[ray][x, y]``.
    pupil: Float64
    #: Path difference of each ray, waves.
    opd: Float64
    peak_to_valley: float
    rms: float
    #: Without tilt, which moves the image and does not blur it; None of fewer than three rays.
    rms_without_tilt: float | None

    def zernikes(self, terms: int = 37, *, order: str = "noll") -> Zernikes:
        """Coefficients by least squares over the rays within the unit disk.

        Args:
            terms: How many, up to 231 of Noll's, 37 of the fringe set.
            order: ``"noll"`` (every term has the root mean square 1) or ``"fringe"`` (every term is 1 at the edge).
        """
        if order not in ("noll", "fringe"):
            raise DiopterError(f'order "{order}": expected "noll" or "fringe"', "order", f'"{order}"', '"noll" or "fringe"')
        coefficients, rest, names = _diopter.zernike_fit(self.pupil, self.opd, terms, order == "fringe")
        return Zernikes(coefficients, rest, [(n, m) for n, m, _ in names], [name for _, _, name in names])


class Psf(NamedTuple):
    """The image of a point: fractions of its light in pixels."""

    #: ``[row][column]``, the upper edge on top; of a diffraction image some of the light lies beyond it.
    values: Float64
    pixel_mm: float
    #: Middles of columns and rows, mm from :attr:`origin_mm`.
    x_mm: Float64
    y_mm: Float64
    #: Where the chief ray meets the plane, mm.
    origin_mm: tuple[float, float]
    #: Middle of the light, mm from there.
    centroid_mm: tuple[float, float]
    #: Largest irradiance over that without aberration; None of a geometric image.
    strehl: float | None
    #: Whether diffraction was left out: asked for, or because the wavefront is too steep for it to matter.
    geometric: bool
    #: Fraction of the light within circles about the centroid, of the radii that were asked for.
    encircled_energy: Float64


class Quantity(NamedTuple):
    """What is measured of a lens that is built."""

    name: str
    unit: str
    #: Of the lens without errors.
    design: float
    #: Standard deviation over builds that the sensitivities predict.
    root_sum_square: float


class Perturbation(NamedTuple):
    """One way in which a build may differ."""

    name: str
    unit: str
    #: How far either way.
    half_range: float


class Tolerances(NamedTuple):
    """Many builds of a lens within its tolerances."""

    quantities: list[Quantity]
    perturbations: list[Perturbation]
    #: Quantities with each perturbation alone at its upper end, ``[perturbation][quantity]``.
    plus: Float64
    #: And at its lower end.
    minus: Float64
    #: ``[build][quantity]``; NaN where it could not be measured.
    builds: Float64
    #: Whether each build keeps all limits.
    good: npt.NDArray[np.bool_]
    #: Fraction of the builds that do, and the interval that holds the true one 95 times of 100.
    yield_fraction: float
    yield_interval: tuple[float, float]
    #: Fraction that keeps each limit by itself, by what it asks.
    limits: dict[str, float]

    def column(self, name: str) -> Float64:
        """A quantity of all builds, by its name."""
        names = [q.name for q in self.quantities]
        if name not in names:
            raise DiopterError(f'quantity "{name}": expected one of {"; ".join(names)}', "quantity", f'"{name}"', "; ".join(names))
        return self.builds[:, names.index(name)]


class Optimised(NamedTuple):
    """A lens made better."""

    lens: Lens
    #: Merit of the start (None where rays are lost) and of the result.
    merits: tuple[float | None, float]
    #: Operands: name, unit, value before and after.
    operands: list[tuple[str, str, float, float]]
    #: Variables: name, value before and after.
    variables: list[tuple[str, float, float]]
    iterations: int
    #: Why it ended.
    stop: str
    #: Glasses that could be chosen: number of the surface before it, glass before and after.
    glasses: list[tuple[int, str, str]]


class FittedNumber(NamedTuple):
    """A number that was free."""

    name: str
    unit: str
    start: float
    value: float
    #: None where it is not known: on a bound, or not told apart from others.
    standard_error: float | None


class Fitted(NamedTuple):
    """A lens matched to measurements."""

    lens: Lens
    chi_squared: float
    degrees_of_freedom: int
    numbers: list[FittedNumber]
    #: Of the numbers, ``[number][number]``.
    correlations: Float64
    #: Measured and predicted values of each row, and residuals in units of its standard uncertainty.
    measured: Float64
    predicted: Float64
    residuals: Float64
    rows: list[str]
    warnings: list[str]
    #: Flags of ``diopter shoot`` that set what is no part of a prescription.
    flags: str


@contextmanager
def _files(lens: str, sheet: str | os.PathLike[str]) -> Iterator[tuple[Path, Path]]:
    """A lens and a sheet as files, while they are needed; a sheet of more than one line is a text."""
    text = os.fspath(sheet)
    with tempfile.TemporaryDirectory(prefix="diopter-") as folder:
        prescription = Path(folder, "lens.toml")
        prescription.write_text(lens, encoding="utf-8")
        path = Path(text)
        if "\n" in text:
            path = Path(folder, "sheet.toml")
            path.write_text(text, encoding="utf-8")
        yield prescription, path


def tolerances(lens: str, sheet: str | os.PathLike[str], builds: int, seed: int | None, threads: int | None) -> Tolerances:
    """Of a lens as TOML; see :meth:`Lens.tolerances`."""
    import numpy as np

    with _files(lens, sheet) as (prescription, path):
        told = command("lens", "tolerance", path, "--lens", prescription, "-n", str(builds), *_seed(seed), *_threads(threads))
    quantities = [Quantity(q["name"], q["unit"], _number(q["design"]), _number(q["rss"])) for q in told["quantities"]]
    parts = told["perturbations"]
    shape = (-1, len(quantities))
    low, high = told["yield_interval_95"]
    return Tolerances(
        quantities,
        [Perturbation(p["name"], p["unit"], p["half_range"]) for p in parts],
        np.array([p["plus"] for p in parts], dtype=np.float64).reshape(shape),
        np.array([p["minus"] for p in parts], dtype=np.float64).reshape(shape),
        np.array(told["builds"], dtype=np.float64).reshape(shape),
        np.array(told["good"], dtype=np.bool_),
        told["yield"],
        (low, high),
        {limit["name"]: limit["yield"] for limit in told["limits"]},
    )


def build(lens: str, sheet: str | os.PathLike[str], number: int, seed: int | None) -> str:
    """The prescription of a build; see :meth:`Lens.build`."""
    with _files(lens, sheet) as (prescription, path):
        told = command("lens", "build", path, "--lens", prescription, "--number", str(number), *_seed(seed))
    text: str = told["toml"]
    return text


def optimise(
    lens: str, merit: str | os.PathLike[str], generations: int, iterations: int, seed: int | None, threads: int | None
) -> dict[str, Any]:
    """What the program says of an optimisation."""
    search = ["--global", str(generations), "--iterations", str(iterations)]
    with _files(lens, merit) as (prescription, path):
        told: dict[str, Any] = command("lens", "optimise", path, "--lens", prescription, *search, *_seed(seed), *_threads(threads))
    return told


def fit(lens: str, measured: str | os.PathLike[str], iterations: int, threads: int | None) -> dict[str, Any]:
    """What the program says of a fit."""
    with _files(lens, measured) as (prescription, path):
        told: dict[str, Any] = command(
            "lens", "fit", path, "--lens", prescription, "--iterations", str(iterations), *_threads(threads)
        )
    return told


def optimised(told: dict[str, Any], lens: Lens) -> Optimised:
    """The same as values."""
    operands = [(o["name"], o["unit"], _number(o["values"][0]), _number(o["values"][1])) for o in told["operands"]]
    variables = [(v["name"], v["before"], v["after"]) for v in told["variables"]]
    before, after = told["merits"]
    glasses = [(g["after_surface"], g["before"], g["after"]) for g in told["glasses"]]
    return Optimised(lens, (before, after), operands, variables, told["iterations"], told["stop"], glasses)


def fitted(told: dict[str, Any], lens: Lens) -> Fitted:
    """The same as values."""
    import numpy as np

    numbers = [FittedNumber(n["name"], n["unit"], n["start"], n["value"], n["standard_error"]) for n in told["numbers"]]
    rows = told["rows"]

    def column(name: str) -> Float64:
        return np.array([row[name] for row in rows], dtype=np.float64)

    return Fitted(
        lens,
        told["chi_squared"],
        told["degrees_of_freedom"],
        numbers,
        np.array(told["correlations"], dtype=np.float64).reshape(len(numbers), -1),
        column("measured"),
        column("predicted"),
        column("residual"),
        [row["name"] for row in rows],
        told["warnings"],
        told["flags"],
    )


def _number(value: float | None) -> float:
    # JSON knows no NaN.
    return float("nan") if value is None else float(value)


def _seed(seed: int | None) -> list[str]:
    return [] if seed is None else ["--seed", str(seed)]


def _threads(threads: int | None) -> list[str]:
    return [] if threads is None else ["--threads", str(threads)]
