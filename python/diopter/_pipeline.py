"""From stage to stage: expose, read out, develop; and what a camera does before."""

from __future__ import annotations

import contextlib
import difflib
import json
import os
import sys
import warnings
from typing import TYPE_CHECKING, Any, Callable, Iterator, Mapping, NamedTuple, Sequence, TypedDict

from . import _diopter
from ._camera import Body, Camera
from ._errors import DiopterWarning
from ._images import FocalPlane, Picture, RawImage
from ._scene import Scene
from ._units import plain

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    from typing_extensions import Unpack

    Progress = bool | Callable[[float], object]


class ExposureSettings(TypedDict, total=False):
    """How an exposure is taken. Values take text with units or plain numbers in the units named here."""

    #: Exposure time, s; metered without.
    shutter: float | str
    #: ISO speed, or ``"auto"``.
    iso: float | str
    #: ``M``, ``A``, ``S`` or ``P``; without, M when a time is given and A when not.
    mode: str
    #: ``average``, ``centre-weighted``, ``spot``, ``matrix`` or ``highlight``.
    metering: str
    #: More (+) or less (−) light than the meter asks for, EV.
    compensation: float | str
    #: Neutral density filter: ``"ND8"`` or ``"3 stops"``.
    nd: float | str
    #: Polarising filter: ``"linear:30deg"`` or ``"circular:30deg"``, counter-clockwise from the horizontal.
    polarizer: str
    #: Illuminant taken for white: D65, D50, A ...
    white: str
    #: Temperature of the sensor, °C.
    temperature_c: float
    #: Leave the cap on the lens: a dark frame.
    lens_cap: bool
    #: Columns and rows.
    size: tuple[int, int] | str
    #: Samples a pixel.
    spp: int
    #: First and one after the last sample of this part, of ``spp`` in all; :func:`diopter.merge` joins parts.
    samples: tuple[int, int]
    #: Seed of light transport and noise.
    seed: int
    #: ``sobol``, ``jittered``, ``grid`` or ``independent``.
    sampler: str
    #: Most scattering events of a path.
    max_depth: int
    #: Follow light with its polarisation.
    polarized: bool
    #: Truth channels beyond depth, normal, albedo and id: ``"position,flow"`` or ``"all"``; see :meth:`diopter.FocalPlane.truth`.
    truth_channels: str
    #: Stop after about so long, s.
    time_limit: float | str
    #: Reduce the renderer's own noise.
    denoise: bool
    #: Blur made from one sharp exposure and its depth: a quick look.
    quick: bool
    #: ``studio``, ``sun``, ``overcast``, ``none``, or a lat-long .hdr or .exr.
    light: str | os.PathLike[str]
    #: Scales all light so that the scene meters at this EV (ISO 100).
    ambient_ev: float
    #: Puts a matte floor of this albedo under the scene.
    ground: float
    #: Moment at which the exposure begins, s of the scene's animations.
    at: float | str
    #: Other settings of a shot file, by section: ``{"scene": {"fog": {"visibility": "50 m"}}}``.
    settings: Mapping[str, Mapping[str, Any]]


_SECTIONS = {
    "exposure": ("shutter", "iso", "mode", "metering", "compensation", "nd", "polarizer", "white", "temperature_c", "lens_cap"),
    "render": (
        "size",
        "spp",
        "samples",
        "seed",
        "sampler",
        "max_depth",
        "polarized",
        "truth_channels",
        "time_limit",
        "denoise",
        "quick",
    ),
    "scene": ("light", "ambient_ev", "ground", "at"),
}
_SECTION_OF = {name: section for section, names in _SECTIONS.items() for name in names}


def _settings(camera: Camera, given: Mapping[str, Any]) -> str:
    """The settings of a shot, as JSON."""
    sections = camera._sections()
    for name, value in given.items():
        if name == "settings" or value is None:
            continue
        section = _SECTION_OF.get(name)
        if section is None:
            near = difflib.get_close_matches(name, [*_SECTION_OF, "settings"], 1)
            hint = f' (did you mean "{near[0]}"?)' if near else ""
            raise TypeError(f"{name!r} is no setting of an exposure{hint}; others go into settings={{section: {{name: value}}}}")
        if name == "size" and not isinstance(value, str):
            width, height = value
            value = f"{width}x{height}"
        sections.setdefault(section, {})[name] = plain(value)
    for section, keys in (given.get("settings") or {}).items():
        sections.setdefault(section, {}).update(plain(keys))
    return json.dumps(sections)


def _warn(texts: Sequence[str]) -> None:
    for text in texts:
        warnings.warn(text, DiopterWarning, stacklevel=3)


@contextlib.contextmanager
def _bar(progress: Progress, what: str) -> Iterator[Callable[[float], object] | None]:
    """What is told the fraction that is done: the caller's function, tqdm's bar where it is installed, or a line on standard error."""
    if callable(progress):
        yield progress
        return
    if not progress:
        yield None
        return
    try:
        from tqdm.auto import tqdm
    except ImportError:
        told = ""

        def line(part: float) -> None:
            nonlocal told
            text = f"\r{what} {100 * part:3.0f} %"
            if text != told:
                told = text
                print(text, end="", file=sys.stderr, flush=True)

        yield line
        print("\r" + " " * (len(what) + 6), end="\r", file=sys.stderr, flush=True)
        return
    with tqdm(total=1000, desc=what, bar_format="{desc} {percentage:3.0f}%|{bar}| {elapsed}<{remaining}") as bar:

        def step(part: float) -> None:
            bar.update(max(round(1000 * part) - bar.n, 0))

        yield step
        step(1.0)


def expose(
    scene: Scene | None = None,
    camera: Camera | None = None,
    *,
    record: str = "electrons",
    threads: int | None = None,
    progress: Progress = False,
    **settings: Unpack[ExposureSettings],
) -> FocalPlane:
    """Exposes a film to a scene: the noiseless mean signal of every pixel, with the truth beside it.

    The same settings and seed give the same bits for any number of threads.

    Args:
        scene: The embedded still life without.
        record: ``"electrons"`` of the body's sensor, ``"radiance"`` (linear sRGB, cd/m²), or spectral bands such as ``"400..700/10nm"``.
        threads: One a core without.
        progress: True for a bar (tqdm's where it is installed), or a function that is called with the fraction that is done.
        settings: See :class:`ExposureSettings`.

    Raises:
        DiopterError: What was asked for cannot be had; with place, found, expected and hint.
        KeyboardInterrupt: Ctrl-C.
    """
    camera = camera or Camera()
    with _bar(progress, "exposing") as told:
        plane, odd = _diopter.expose(
            _settings(camera, settings),
            None if scene is None else scene._native,
            camera._native_lens,
            camera._native_body,
            record,
            threads,
            told,
        )
    _warn(odd)
    return FocalPlane(plane)


class Photograph(NamedTuple):
    """All that came of a photograph."""

    plane: FocalPlane
    raw: RawImage
    picture: Picture

    def _repr_png_(self) -> bytes:
        return self.picture.to_png()


def shoot(
    scene: Scene | None = None,
    camera: Camera | None = None,
    *,
    threads: int | None = None,
    progress: Progress = False,
    **settings: Unpack[ExposureSettings],
) -> Photograph:
    """Takes a photograph: exposes, reads out, develops, as ``diopter shoot --denoise off --fireflies keep``: where the program writes pictures alone, it reduces
    noise and re-weights fireflies. The development's settings are the section ``develop`` of ``settings``; arguments are those of :func:`expose`."""
    camera = camera or Camera()
    with _bar(progress, "exposing") as told:
        plane, raw, picture, odd = _diopter.shoot(
            _settings(camera, settings),
            None if scene is None else scene._native,
            camera._native_lens,
            camera._native_body,
            threads,
            told,
        )
    _warn(odd)
    return Photograph(FocalPlane(plane), RawImage(raw), Picture._of(picture))


def meter(
    scene: Scene | None = None,
    camera: Camera | None = None,
    *,
    threads: int | None = None,
    **settings: Unpack[ExposureSettings],
) -> dict[str, Any]:
    """What the camera would take the picture with: ``metered_ev100``, ``exposure_s``, ``f_number``, ``t_number``, ``iso``, ``focus_distance_m`` ...
    Arguments are those of :func:`expose`."""
    camera = camera or Camera()
    facts, _, odd = _diopter.meter(
        _settings(camera, settings),
        None if scene is None else scene._native,
        camera._native_lens,
        camera._native_body,
        threads,
    )
    _warn(odd)
    found: dict[str, Any] = json.loads(facts)
    return found


def autofocus(
    scene: Scene | None = None,
    camera: Camera | None = None,
    *,
    at: tuple[float, float] | None = None,
    threads: int | None = None,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
) -> dict[str, Any]:
    """What autofocus finds: ``distance_m`` (None for infinity), ``extension_mm``, ``confidence``, ``zones``, ``chosen`` (None where it failed).

    Args:
        at: Where it looks, 0 to 1 across and down the picture.
        settings: Such as ``{"focus": {"method": "contrast", "zones": "nine"}}``.
    """
    camera = camera or Camera()
    sections = {name: dict(keys) for name, keys in (settings or {}).items()}
    sections.setdefault("focus", {})["distance"] = "auto" if at is None else f"at {at[0]},{at[1]}"
    _, report, odd = _diopter.meter(
        _settings(camera, {"settings": sections}),
        None if scene is None else scene._native,
        camera._native_lens,
        camera._native_body,
        threads,
    )
    _warn(odd)
    found: dict[str, Any] = json.loads(report) or {}
    return found


def merge(parts: Sequence[FocalPlane]) -> FocalPlane:
    """Joins parts of an exposure that hold different samples (``samples=(0, 32)``, ``(32, 64)``): what the whole would have given."""
    return FocalPlane(_diopter.merge([part._native for part in parts]))


def read_out(
    plane: FocalPlane,
    body: Body | str | os.PathLike[str] | None = None,
    *,
    iso: float | None = None,
    seed: int = 1,
    serial: str | None = None,
    temperature_c: float | None = None,
    white: str | None = None,
    color_sampling: str | None = None,
    threads: int | None = None,
) -> RawImage:
    """Reads a focal plane out: shot noise, dark current, read noise, gain, fixed pattern, converter.

    Args:
        body: The one the plane was exposed with without.
        iso: The one the camera was set to without.
        seed: Of what is new each time.
        serial: Serial number of the body: what stays is drawn from it; the camera's without.
        temperature_c: What the camera was set to, or the data sheet's, without.
        white: Illuminant that the camera takes for white: D65, A ...; what the camera was set to, or D65, without.
        color_sampling: ``"mosaic"``, one color a pixel by its filter, the default; or ``"full"``, red, green and blue in every pixel, which
            makes the mosaic ``[row][column][3]`` and needs no demosaicing.
    """
    native = None if body is None else Body.of(body)._native
    raw = _diopter.read_out(plane._native, native, iso, seed, serial, temperature_c, white, color_sampling, threads)
    return RawImage(raw)


class Expected(NamedTuple):
    """What a read-out is expected to give: the truth of a raw image. Arrays ``[row][column]``."""

    #: The number that would be read without noise of time, fixed pattern and clipping included; not rounded.
    dn: npt.NDArray[np.float32]
    #: Variance that a read-out adds, e⁻².
    variance_e2: npt.NDArray[np.float32]
    #: Whether the pixel is full on average.
    clipped: npt.NDArray[np.bool_]


def expected(
    plane: FocalPlane,
    body: Body | str | os.PathLike[str] | None = None,
    *,
    iso: float | None = None,
    serial: str | None = None,
    temperature_c: float | None = None,
    threads: int | None = None,
) -> Expected:
    """The truth beside :func:`read_out` with the same arguments."""
    native = None if body is None else Body.of(body)._native
    return Expected(*_diopter.expected(plane._native, native, iso, serial, temperature_c, threads))


def merge_raws(raws: Sequence[RawImage]) -> RawImage:
    """Joins an exposure series into one raw image of more range."""
    return RawImage(_diopter.merge_raws([raw._native for raw in raws]))


_SHORT = {"tone": "tone.curve", "demosaic": "demosaic.method", "exposure_ev": "exposure.ev", "lut": "lut.file"}


def develop(
    raw: RawImage,
    *,
    preset: str | None = None,
    recipe: str | os.PathLike[str] | None = None,
    threads: int | None = None,
    **settings: Any,
) -> Picture:
    """Develops a raw image.

    Args:
        preset: ``default``, ``plain``, ``camera``, ``soft`` or ``film``.
        recipe: A recipe file instead.
        settings: ``exposure_ev=0.5``, ``tone="agx"``, ``demosaic="rcd"``, ``lut="look.cube"``; or a section with its settings:
            ``white={"balance": "daylight"}``. :func:`recipe_settings` lists them all.
    """
    pairs: list[tuple[str, str]] = []
    for name, value in settings.items():
        if isinstance(value, Mapping):
            pairs += [(f"{name}.{key}", _text(v)) for key, v in value.items()]
        else:
            pairs.append((_SHORT.get(name, name), _text(value)))
    path = None if recipe is None else os.fspath(recipe)
    return Picture._of(_diopter.develop(raw._native, preset, path, pairs, threads))


def _text(value: Any) -> str:
    """A setting as a recipe's text."""
    value = plain(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return ",".join(_text(v) for v in value)
    return str(value)


class RecipeSetting(NamedTuple):
    """A setting of the development."""

    name: str
    unit: str
    allowed: str
    #: As text; empty where it is not set.
    default: str
    why: str


def recipe_settings() -> list[RecipeSetting]:
    """Every setting of the development."""
    return [RecipeSetting(*row) for row in _diopter.recipe_settings()]


def set_threads(threads: int | None = None) -> None:
    """Threads of calls that do not say; None: one a core. No result depends on it."""
    _diopter.set_threads(threads)
