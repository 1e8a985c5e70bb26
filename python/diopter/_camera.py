"""What photographs: lenses (and their bench), bodies, cameras."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Mapping, NamedTuple, Sequence

from . import _design, _diopter
from ._design import Fitted, Optimised, Psf, Tolerances, Wavefront
from ._errors import DiopterError
from ._units import DISTANCE_M, LENGTH_MM, TIME_S, f_number, number, plain

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Float = npt.NDArray[np.float32] | npt.NDArray[np.float64]
    Float64 = npt.NDArray[np.float64]

#: Wavelengths of the Fraunhofer lines F, d and C, nm.
VISUAL_NM = (486.1327, 587.5618, 656.2725)
#: Lenses without surfaces.
IDEAL = ("thin", "pinhole", "panorama")


class Rays(NamedTuple):
    """Rays behind (or before) a lens."""

    #: On the last surface that they met or on the film, mm, ``[ray][x, y, z]``; NaN of rays that were lost.
    positions: Float
    #: Unit directions ``[ray][3]``; NaN of rays that were lost.
    directions: Float
    #: Whether they came through, ``bool [ray]``.
    passed: npt.NDArray[np.bool_]
    #: Optical path, index × length, mm.
    path_mm: Float
    #: Fraction of the light that glass and surfaces leave; 1 where that was not asked for, 0 of rays that were lost.
    transmittance: Float


class Spot(NamedTuple):
    """A spot diagram."""

    #: Where rays meet the film, mm, ``[ray][x, y]``.
    points_mm: Float64
    #: Middle of the points, mm.
    centroid_mm: tuple[float, float]
    #: Root mean square distance from the centroid, mm.
    rms_mm: float
    #: Largest distance, mm.
    geometric_mm: float
    #: Fraction of the rays that passed.
    passed: float


class Mtf(NamedTuple):
    """Contrast over frequency."""

    frequencies_per_mm: Float64
    #: Of lines across the direction to the middle of the picture.
    tangential: Float64
    #: Of lines along it.
    sagittal: Float64
    #: Whether diffraction was left out: asked for, or because the wavefront is too steep for it to matter.
    geometric: bool


class Distortion(NamedTuple):
    """Where fields are imaged; each an array with a number a field, NaN where no light reaches the film."""

    field_deg: Float64
    height_mm: Float64
    #: Without distortion: f tan θ, carried along the chief ray from the paraxial focus to the film.
    ideal_height_mm: Float64
    distortion_percent: Float64
    #: Where tangential and sagittal rays are sharp, mm behind the film.
    tangential_focus_mm: Float64
    sagittal_focus_mm: Float64


class Vignetting(NamedTuple):
    """Light over height; each an array with a number a height."""

    height_mm: Float64
    #: Irradiance over radiance, sr, of apertures alone.
    geometric_sr: Float64
    #: The same with losses in glass and at surfaces.
    with_losses_sr: Float64


class Bench:
    """A lens with focal length, aperture and focus set: the optical bench. Made by :meth:`Lens.bench`.

    Lens space: mm, light runs along +z, the first vertex is at z = 0. Wavelengths in nm. Mirrors off the axis (``[object_axis]`` of a lens file): rays before the lens count
    from the base ray, along whose z the light comes; those at the film from its normal.
    """

    def __init__(self, native: _diopter.Bench) -> None:
        self._native = native

    def info(self, wavelength_nm: float = VISUAL_NM[1]) -> dict[str, float]:
        """Focal lengths, principal planes, pupils, f-number, T-stop, transmittance, where the film stands; mm."""
        return self._native.info(float(wavelength_nm))

    def trace(
        self,
        positions: npt.ArrayLike,
        directions: npt.ArrayLike,
        wavelengths_nm: npt.ArrayLike = VISUAL_NM[1],
        *,
        to: str = "film",
        until_film: bool = True,
        light: bool = False,
        threads: int | None = None,
    ) -> Rays:
        """Follows rays through all surfaces.

        Arrays of single precision are traced in single precision (pictures), all others in double (analysis); contiguous arrays are taken as they are.

        Args:
            positions: ``[ray][x, y, z]``, mm, before the lens (or behind it).
            directions: ``[ray][3]``, of any length.
            wavelengths_nm: One for all or one a ray.
            to: ``"film"``, or ``"object"`` for rays from the film.
            until_film: Follow rays to the film's plane instead of the last surface.
            light: Count what glass and surfaces leave of the light.
        """
        import numpy as np

        if to not in ("film", "object"):
            raise DiopterError(f'to "{to}": expected "film" or "object"', "to", f'"{to}"', '"film" or "object"')
        start, towards, nm = np.asarray(positions), np.asarray(directions), np.atleast_1d(np.asarray(wavelengths_nm))
        to_film = to == "film"
        if start.dtype == towards.dtype == np.float32:
            single = [np.ascontiguousarray(a, dtype=np.float32) for a in (start, towards, nm)]
            return Rays(
                *self._native.trace_single(single[0], single[1], single[2], to_film, until_film, light, threads)
            )
        double = [np.ascontiguousarray(a, dtype=np.float64) for a in (start, towards, nm)]
        return Rays(*self._native.trace_double(double[0], double[1], double[2], to_film, until_film, light, threads))

    def spot(
        self,
        field_deg: float = 0.0,
        wavelength_nm: float = VISUAL_NM[1],
        *,
        rays_across: int = 32,
        defocus_mm: float = 0.0,
    ) -> Spot:
        """Where a bundle of a field angle meets the film."""
        points, centroid, rms, geometric, passed = self._native.spot(
            float(field_deg), float(wavelength_nm), rays_across, float(defocus_mm)
        )
        return Spot(points, (centroid[0], centroid[1]), rms, geometric, passed)

    def mtf(
        self,
        frequencies_per_mm: Sequence[float] | npt.NDArray[Any],
        field_deg: float = 0.0,
        wavelengths_nm: Sequence[float] = VISUAL_NM,
        *,
        geometric: bool = False,
        defocus_mm: float = 0.0,
    ) -> Mtf:
        """Contrast at frequencies (cycles/mm) on the film, of equal parts of some wavelengths; with diffraction unless ``geometric``."""
        import numpy as np

        frequencies = np.asarray(frequencies_per_mm, dtype=np.float64).reshape(-1)
        tangential, sagittal, was_geometric = self._native.mtf(
            frequencies.tolist(), float(field_deg), [float(nm) for nm in wavelengths_nm], geometric, float(defocus_mm)
        )
        return Mtf(frequencies, tangential, sagittal, was_geometric)

    def psf(
        self,
        field_deg: float = 0.0,
        wavelength_nm: float = VISUAL_NM[1],
        *,
        defocus_mm: float = 0.0,
        pixel_um: float | None = None,
        pixels: int | None = None,
        geometric: bool = False,
        radii_mm: Sequence[float] | npt.NDArray[Any] = (),
        threads: int | None = None,
    ) -> Psf:
        """The image of a point, with diffraction unless ``geometric``.

        Args:
            defocus_mm: Plane behind the film.
            pixel_um: Size of a pixel; half of what diffraction needs, without. Larger ones than it needs are made that small.
            pixels: Columns and rows, about the chief ray; all that were computed, without (512 of a geometric image).
            radii_mm: Radii of :attr:`Psf.encircled_energy`.
        """
        import numpy as np

        values, pixel_mm, origin, centroid, strehl, was_geometric, energy = self._native.psf(
            *(float(field_deg), float(wavelength_nm), float(defocus_mm)),
            None if pixel_um is None else 1e-3 * float(pixel_um),
            pixels,
            geometric,
            [float(r) for r in radii_mm],
            threads,
        )
        side = values.shape[0]
        # The chief ray stands in the middle of the pixel right of and above the middle of an even number of them.
        x_mm: Float64 = (np.arange(side, dtype=np.float64) - side // 2) * pixel_mm
        y_mm: Float64 = (side - 1 - side // 2 - np.arange(side, dtype=np.float64)) * pixel_mm
        ends = (origin[0], origin[1]), (centroid[0], centroid[1])
        return Psf(values, pixel_mm, x_mm, y_mm, *ends, strehl, was_geometric, energy)

    def wavefront(
        self, field_deg: float = 0.0, wavelength_nm: float = VISUAL_NM[1], *, rays_across: int = 64, threads: int | None = None
    ) -> Wavefront:
        """The wavefront of a field on an even grid of rays over the lit part of the pupil, against the chief ray of its own wavelength."""
        return Wavefront(*self._native.wavefront(float(field_deg), float(wavelength_nm), rays_across, threads))

    def distortion(
        self, fields_deg: Sequence[float] | npt.NDArray[Any], wavelength_nm: float = VISUAL_NM[1]
    ) -> Distortion:
        """Heights of fields on the film and field curvature."""
        rows = self._native.distortion([float(f) for f in fields_deg], float(wavelength_nm))
        return Distortion(*rows.T)

    def vignetting(
        self, heights_mm: Sequence[float] | npt.NDArray[Any], wavelength_nm: float = VISUAL_NM[1]
    ) -> Vignetting:
        """Light over height on the film."""
        rows = self._native.vignetting([float(h) for h in heights_mm], float(wavelength_nm))
        return Vignetting(*rows.T)


class Lens:
    """A lens with surfaces, as published.

    Args:
        lens: Name of an embedded lens (:meth:`names`), a file (.toml, pbrt's .dat, Zemax's .zmx, CODE V's .seq, ISET's .json), or the text of a
            prescription (of more than one line).
        format: Ending that says the format of a text.
    """

    _native: _diopter.Lens

    def __init__(self, lens: str | os.PathLike[str], *, format: str = ".toml") -> None:
        text = os.fspath(lens)
        if "\n" in text:
            self._native = _diopter.Lens.parse(text, "prescription" + format)
        else:
            self._native = _diopter.Lens.read(text)

    @staticmethod
    def names() -> list[str]:
        """Names of the embedded lenses."""
        return _diopter.lens_names()

    @property
    def name(self) -> str:
        """Its name."""
        return self._native.name

    @property
    def notes(self) -> list[str]:
        """What reading it had to leave out or assume."""
        return self._native.notes

    @property
    def source(self) -> str:
        """Where its numbers come from."""
        return self._native.source

    @property
    def f_number(self) -> float | None:
        """The f-number it is sold under, where it has one."""
        return self._native.f_number

    @property
    def image_circle_mm(self) -> float | None:
        """Diameter of the picture that it was made for, mm, where that is known."""
        return self._native.image_circle_mm

    def to_toml(self) -> str:
        """The prescription as text."""
        return self._native.to_toml()

    def bench(
        self,
        *,
        aperture: float | str | None = None,
        focal_length: float | str | None = None,
        focus: float | str | None = None,
    ) -> Bench:
        """Sets the lens for the bench.

        Args:
            aperture: Such as ``"f/4"``; fully open without.
            focal_length: Of a zoom, mm or text such as ``"35 mm"``.
            focus: Distance of the object from the entrance pupil, m or text such as ``"2 m"``, or ``"inf"``: the film then stands where that is sharp.
                Without it, as published.
        """
        return Bench(
            self._native.bench(
                None if focal_length is None else number("focal_length", focal_length, LENGTH_MM, '"50 mm"'),
                None if aperture is None else f_number("aperture", aperture),
                None if focus is None else number("focus", focus, DISTANCE_M, '"2.5 m"'),
            )
        )

    def tolerances(
        self, sheet: str | os.PathLike[str], *, builds: int = 1000, seed: int | None = None, threads: int | None = None
    ) -> Tolerances:
        """Builds of this lens within tolerances, and what each perturbation does alone.

        Args:
            sheet: A tolerance sheet: a file, or its text (of more than one line). The lens that it may name does not count.
            builds: How many are drawn and measured.
            seed: Instead of the sheet's.
        """
        return _design.tolerances(self.to_toml(), sheet, builds, seed, threads)

    def build(self, sheet: str | os.PathLike[str], number: int, *, seed: int | None = None) -> Lens:
        """One build of this lens, adjusted by its compensators: row ``number`` of :attr:`Tolerances.builds`."""
        return Lens(_design.build(self.to_toml(), sheet, number, seed))

    def optimise(
        self,
        merit: str | os.PathLike[str],
        *,
        generations: int = 0,
        iterations: int = 500,
        seed: int | None = None,
        threads: int | None = None,
    ) -> Optimised:
        """A better lens from this one.

        Args:
            merit: A merit file, or its text (of more than one line): variables, operands, fields.
            generations: Of differential evolution over the whole range of the variables first.
            iterations: Most steps of the damped least squares.
        """
        told = _design.optimise(self.to_toml(), merit, generations, iterations, seed, threads)
        return _design.optimised(told, Lens(told["toml"]))

    def fit(self, measured: str | os.PathLike[str], *, iterations: int = 100, threads: int | None = None) -> Fitted:
        """This lens with its free numbers as measurements say: distortion, vignetting, MTF, calibrations.

        Args:
            measured: A file of measurements, or its text (of more than one line); a calibration that it names lies beside the file.
        """
        told = _design.fit(self.to_toml(), measured, iterations, threads)
        return _design.fitted(told, Lens(told["toml"]))

    def info(self, wavelength_nm: float = VISUAL_NM[1]) -> dict[str, float]:
        """:meth:`Bench.info` of the lens fully open, as published."""
        return self.bench().info(wavelength_nm)

    def trace(
        self,
        positions: npt.ArrayLike,
        directions: npt.ArrayLike,
        wavelengths_nm: npt.ArrayLike = VISUAL_NM[1],
    ) -> Rays:
        """:meth:`Bench.trace` of the lens fully open, as published."""
        return self.bench().trace(positions, directions, wavelengths_nm)

    def __repr__(self) -> str:
        return f"<Lens {self.name}, {self._native.surfaces} surfaces>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Lens) and self.to_toml() == other.to_toml()

    def __hash__(self) -> int:
        return hash(self.name)

    def __reduce__(self) -> tuple[Any, ...]:
        return (Lens, (self.to_toml(),))


class IsoStep(NamedTuple):
    """A sensor at an ISO speed."""

    iso: float
    gain_e_per_dn: float
    read_noise_e: float
    black_level_dn: float
    white_level_dn: float


class Body:
    """A camera body: its sensor by the data sheet.

    Args:
        body: Name of an embedded body (:meth:`names`), a data sheet (.toml), or the text of one (of more than one line).
    """

    _native: _diopter.Body
    _made_from: str

    def __init__(self, body: str | os.PathLike[str]) -> None:
        self._made_from = os.fspath(body)
        if "\n" in self._made_from:
            self._native = _diopter.Body.parse(self._made_from, "data sheet")
            return
        if self._made_from.endswith(".toml"):
            # Kept as text: a pickle of it means the same elsewhere.
            self._native = _diopter.Body.read(self._made_from)
            with open(self._made_from, encoding="utf-8") as sheet:
                self._made_from = sheet.read()
            return
        self._native = _diopter.Body.read(self._made_from)

    @classmethod
    def of(cls, body: Body | str | os.PathLike[str]) -> Body:
        """A body as it is, or by its name."""
        return body if isinstance(body, Body) else cls(body)

    @staticmethod
    def names() -> list[str]:
        """Names of the embedded bodies."""
        return _diopter.body_names()

    @property
    def name(self) -> str:
        """Its name."""
        return self._native.name

    @property
    def format_mm(self) -> tuple[float, float]:
        """Width and height of the sensor, mm."""
        width, height = self._native.format_mm
        return width, height

    @property
    def pixels(self) -> tuple[int, int]:
        """Columns and rows of the sensor."""
        columns, rows = self._native.pixels
        return columns, rows

    @property
    def pitch_mm(self) -> tuple[float, float]:
        """Distance of pixels across and down, mm."""
        across, down = self._native.pitch_mm
        return across, down

    @property
    def full_well_e(self) -> float:
        """Electrons that a pixel holds."""
        return self._native.full_well_e

    @property
    def bits(self) -> int:
        """Of the converter."""
        return self._native.adc_bits

    @property
    def channels(self) -> list[str]:
        """Names of the channels: bands of its focal planes."""
        return self._native.channels

    @property
    def iso_steps(self) -> list[IsoStep]:
        """The sheet's ISO speeds."""
        return [IsoStep(*step) for step in self._native.iso]

    def quantum_efficiency(self, wavelengths_nm: Sequence[float] | npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """Electrons a photon, ``[channel][wavelength]``."""
        import numpy as np

        return np.stack(self._native.quantum_efficiency([float(nm) for nm in wavelengths_nm]))

    def emva(
        self,
        *,
        iso: float = 100.0,
        channel: int = 0,
        wavelength_nm: float | None = None,
        exposure: float | str = 0.01,
        temperature_c: float | None = None,
        seed: int = 1,
        size: tuple[int, int] = (512, 512),
        stack: int = 64,
        threads: int | None = None,
    ) -> dict[str, Any]:
        """Measures read-outs of this body by EMVA 1288.

        Args:
            channel: Number into :attr:`channels`.
            wavelength_nm: Of the light; where the channel sees most without.
            exposure: Time, s or text such as ``"10 ms"``.
            size: Columns and rows of the pictures.
            stack: Pictures of each exposure.

        Returns:
            ``measured`` and ``sheet`` (the same figures by the data sheet): ``gain_dn_per_e``, ``quantum_efficiency``, ``dark_noise_e``,
            ``saturation_capacity_e``, ``snr_max``, ``dynamic_range``, ``dsnu_e``, ``prnu_percent`` ...; ``points`` of the photon transfer.
        """
        report: dict[str, Any] = json.loads(
            self._native.emva(
                float(iso),
                channel,
                None if wavelength_nm is None else float(wavelength_nm),
                number("exposure", exposure, TIME_S, '"10 ms"'),
                temperature_c,
                seed,
                list(size),
                stack,
                threads,
            )
        )
        return report

    def __repr__(self) -> str:
        columns, rows = self.pixels
        return f"<Body {self.name}, {columns} × {rows} pixels>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Body) and self._made_from == other._made_from

    def __hash__(self) -> int:
        return hash(self._made_from)

    def __reduce__(self) -> tuple[Any, ...]:
        return (Body, (self._made_from,))


@dataclass(frozen=True, eq=False)
class Camera:
    """A lens before a body, in its place. Values take text with units (``"f/2.8"``, ``"2.5 m"``) or plain numbers in the units named here.

    Everything may be left out: what is missing is found as ``diopter shoot`` finds it (the scene's own camera, or a view of all of it).
    """

    #: A :class:`Lens`, its name or file, or ``"thin"``, ``"pinhole"``, ``"panorama"``; a thin lens without.
    lens: Lens | str | os.PathLike[str] | None = None
    #: A :class:`Body`, its name or file.
    body: Body | str | os.PathLike[str] | None = None
    #: What is sharp: a distance (m), ``"inf"``, ``"auto"``, ``"at 0.4,0.6"``, ``"on NAME"``, ``"hyperfocal"`` or ``"extension 1.2 mm"``; what it is
    #: aimed at without.
    focus: float | str | None = None
    #: f-number.
    aperture: float | str | None = None
    #: Where it stands, m.
    position: Sequence[float] | None = None
    #: What it is aimed at, m.
    look_at: Sequence[float] | None = None
    #: Up vector of the picture.
    up: Sequence[float] | None = None
    #: A camera of the scene's file, by name or number.
    viewpoint: str | int | None = None
    #: mm; of a zoom, where it is set.
    focal_length: float | str | None = None
    #: A film format instead of the body's: a name, or such as ``"36x24"``, mm.
    format: str | None = None
    #: Blades of the iris.
    blades: int | None = None
    #: Turns the iris, degrees.
    blade_rotation_deg: float | None = None
    #: Serial number of the body: its fixed pattern is drawn from it.
    serial: str | None = None
    #: ``global``, ``leaf``, ``focal-plane`` or ``rolling``.
    shutter_type: str | None = None
    #: Other settings of a shot file, by section: ``{"focus": {"method": "phase"}, "camera": {"shake": 0.6}}``.
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Read once, and wrong names are said at once.
        lens, body = self.lens, self.body
        if lens is not None and not isinstance(lens, Lens) and os.fspath(lens) not in IDEAL:
            object.__setattr__(self, "lens", Lens(lens))
        if body is not None and not isinstance(body, Body):
            object.__setattr__(self, "body", Body(body))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Camera) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[str, object, object]:
        """What it is: its settings as text, lens and body."""
        return json.dumps(plain(self._sections()), sort_keys=True), self.lens, self.body

    @property
    def _native_lens(self) -> _diopter.Lens | None:
        return self.lens._native if isinstance(self.lens, Lens) else None

    @property
    def _native_body(self) -> _diopter.Body | None:
        return self.body._native if isinstance(self.body, Body) else None

    def _sections(self) -> dict[str, dict[str, Any]]:
        """Its settings as those of a shot file."""
        text = self.lens if isinstance(self.lens, str) else None
        values: dict[str, dict[str, Any]] = {
            "camera": {
                "lens": text,
                "look_from": self.position,
                "look_at": self.look_at,
                "up": self.up,
                "viewpoint": None if self.viewpoint is None else str(self.viewpoint),
                "focal_length": self.focal_length,
                "format": self.format,
                "blades": self.blades,
                "blade_rotation_deg": self.blade_rotation_deg,
                "serial": self.serial,
            },
            "focus": {"distance": self.focus},
            "exposure": {"aperture": self.aperture},
            "shutter": {"kind": self.shutter_type},
        }
        sections = {
            section: {key: plain(v) for key, v in keys.items() if v is not None} for section, keys in values.items()
        }
        for section, keys in self.settings.items():
            sections.setdefault(section, {}).update(plain(keys))
        return sections
