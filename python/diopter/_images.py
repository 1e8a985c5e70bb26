"""What is handed from stage to stage: focal planes, raw images, pictures."""

from __future__ import annotations

import contextlib
import json
import os
from typing import TYPE_CHECKING, Any, Literal, Sequence

from . import _diopter
from ._units import TIME_S, floats, number, t_stop

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ._camera import Body

    Float32 = npt.NDArray[np.float32]


class FocalPlane:
    """The exposure before any sensor noise: the mean signal of each pixel and band, how sure it is, and the truth beside it.

    Arrays are views without a copy, read-only, `[row][column]` or `[row][column][band]`, row 0 on top.
    Made by :func:`diopter.expose`, :meth:`load` and :meth:`from_radiance`.
    """

    __slots__ = ("_native",)
    _native: _diopter.FocalPlane

    def __init__(self, native: _diopter.FocalPlane) -> None:
        self._native = native

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        width, height = self._native.size
        return width, height

    @property
    def bands(self) -> list[tuple[str, str]]:
        """Name and unit of each band: ``electrons`` (mean electrons a pixel), or ``radiance``: cd/m² of linear sRGB bands R, G, B, and
        W·m⁻²·sr⁻¹·nm⁻¹ of spectral bands such as ``S0.405,0nm``."""
        return self._native.bands

    @property
    def mean(self) -> Float32:
        """Mean signal, ``float32 [row][column][band]``, in the unit of :attr:`bands`."""
        return self._native.mean

    @property
    def half_difference(self) -> Float32:
        """Half the difference of the two independent halves of the samples, ``float32 [row][column][band]``. Its square is an unbiased estimate of the
        variance of :attr:`mean` with one degree of freedom a pixel; linear in the samples."""
        return self._native.half_difference

    @property
    def variance(self) -> Float32:
        """Monte Carlo variance of :attr:`mean`, ``float32 [row][column][band]``, unit squared: the square of :attr:`half_difference`, a new array.
        One degree of freedom a pixel: average over neighbours before use."""
        return self._native.variance()

    @property
    def depth(self) -> Float32:
        """Distance along the camera's axis, m, ``float32 [row][column]``; infinite where nothing is hit."""
        return self._native.depth

    @property
    def normal(self) -> Float32:
        """World-space shading normal, ``float32 [row][column][3]``; 0 where nothing is hit."""
        return self._native.normal

    @property
    def albedo(self) -> Float32:
        """Albedo, linear sRGB, ``float32 [row][column][3]``."""
        return self._native.albedo

    @property
    def object(self) -> npt.NDArray[np.uint32]:
        """Object number + 1, ``uint32 [row][column]``; 0 where nothing is hit. Numbers are those of :attr:`diopter.Scene.objects`; what is put into
        the scene for the photograph (ground, studio, flash) comes behind."""
        return self._native.object

    @property
    def truth_channels(self) -> dict[str, str]:
        """The truth channels that were recorded, and what each means: its unit, whether it is of the nearest sample or weighted by coverage."""
        return {
            name: f"{about} [{unit or 'no unit'}; {merge}]" for name, unit, merge, about in self._native.truth_channels
        }

    @property
    def object_names(self) -> list[str]:
        """Names of the scene's objects by number; :attr:`object` is that number + 1. Empty where no truth channels were asked for."""
        return self._native.object_names

    @property
    def class_names(self) -> list[str]:
        """Names of the classes of its objects by number; the truth channel "class" is that number + 1. Empty where classes were not asked for."""
        return self._native.class_names

    def truth(self, name: str) -> Float32 | npt.NDArray[np.uint32]:
        """A truth channel by its name (:attr:`truth_channels`), ``[row][column]`` or ``[row][column][part]``. Channels beyond depth, normal, albedo
        and id are recorded where they are asked for: ``expose(..., truth_channels="position,flow")``."""
        values = self._native.truth(name)
        if values is None:
            raise KeyError(f"the truth channel {name!r} was not recorded: expected one of {', '.join(self.truth_channels)}")
        return values

    @property
    def metadata(self) -> dict[str, Any]:
        """How it was made: scene, body, lens, ``exposure_s``, ``f_number``, ``focus_distance_m``, ``seed``, ``samples`` ..."""
        return _facts(self._native.facts)

    def denoised(self, *, threads: int | None = None) -> FocalPlane:
        """Another plane with the renderer's noise reduced; its mean is then an estimate, and says so in its metadata."""
        return FocalPlane(self._native.denoised(threads))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes an EXR with all planes; the file of ``diopter expose``. Written beside and renamed."""
        self._native.save(os.fspath(path))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> FocalPlane:
        """Reads a plane that :meth:`save` or ``diopter expose`` wrote."""
        return cls(_diopter.FocalPlane.load(os.fspath(path)))

    @classmethod
    def from_radiance(
        cls,
        radiance: npt.ArrayLike,
        body: Body | str,
        *,
        shutter: float | str,
        t_number: float | str,
        wavelengths_nm: Sequence[float] | None = None,
        depth: npt.ArrayLike | None = None,
        threads: int | None = None,
    ) -> FocalPlane:
        """A picture of the light of a scene, from another renderer or a hyperspectral camera, on a sensor.

        The irradiance on the sensor is π L / (4 T²): vignetting and blur are those of the picture. A pixel of the picture is a pixel of the sensor.

        Args:
            radiance: ``[row][column][3]`` linear sRGB (Rec. 709), cd/m²; with ``wavelengths_nm`` ``[row][column][wavelength]``,
                W·m⁻²·sr⁻¹·nm⁻¹, linear between the wavelengths and nothing beyond them. Negative values count as none.
            body: Whose sensor.
            shutter: Exposure time, s, or text such as ``"1/100 s"``.
            t_number: T-stop of the lens, such as ``"f/4"``.
            wavelengths_nm: Rising, one a channel. Sensors are known from 380 to 780 nm: light beyond is not counted.
            depth: ``[row][column]``, m along the axis; goes into :attr:`depth`.
        """
        return cls._from_light(radiance, body, shutter, t_stop("t_number", t_number), wavelengths_nm, depth, threads)

    @classmethod
    def from_irradiance(
        cls,
        irradiance: npt.ArrayLike,
        body: Body | str,
        *,
        shutter: float | str,
        wavelengths_nm: Sequence[float] | None = None,
        depth: npt.ArrayLike | None = None,
        threads: int | None = None,
    ) -> FocalPlane:
        """The same of the light on the sensor: lx of linear sRGB, or W·m⁻²·nm⁻¹. See :meth:`from_radiance`."""
        return cls._from_light(irradiance, body, shutter, None, wavelengths_nm, depth, threads)

    @classmethod
    def _from_light(
        cls,
        light: npt.ArrayLike,
        body: Body | str,
        shutter: float | str,
        t_number: float | None,
        wavelengths_nm: Sequence[float] | None,
        depth: npt.ArrayLike | None,
        threads: int | None,
    ) -> FocalPlane:
        from ._camera import Body

        native = _diopter.from_light(
            floats(light),
            Body.of(body)._native,
            number("shutter", shutter, TIME_S, '"1/100 s"'),
            t_number,
            None if wavelengths_nm is None else [float(nm) for nm in wavelengths_nm],
            None if depth is None else floats(depth),
            threads,
        )
        return cls(native)

    def on_sensor(
        self,
        body: Body | str,
        *,
        shutter: float | str | None = None,
        t_number: float | str | None = None,
        threads: int | None = None,
    ) -> FocalPlane:
        """A plane in radiance (``expose(record="radiance")``, or spectral bands) on the sensor of a body: in electrons.

        Exposure time and T-stop are those it was exposed with unless others are given. Many bodies can so see one exposure.
        """
        from ._camera import Body

        return FocalPlane(
            self._native.on_sensor(
                Body.of(body)._native,
                None if shutter is None else number("shutter", shutter, TIME_S, '"1/100 s"'),
                None if t_number is None else t_stop("t_number", t_number),
                threads,
            )
        )

    def __repr__(self) -> str:
        width, height = self.size
        return f"<FocalPlane {width} × {height}, bands {', '.join(name for name, _ in self.bands)}>"

    def _repr_png_(self) -> bytes:
        return Picture(self._native.preview()).to_png()

    def __reduce__(self) -> tuple[Any, ...]:
        return (_plane_from_bytes, (self._native.to_bytes(),))


def _plane_from_bytes(data: bytes) -> FocalPlane:
    return FocalPlane(_diopter.FocalPlane.from_bytes(data))


class RawImage:
    """Digital numbers behind a colour filter array, as a camera writes them.

    Made by :func:`diopter.read_out` and :meth:`load`.
    """

    __slots__ = ("_native",)
    _native: _diopter.RawImage

    def __init__(self, native: _diopter.RawImage) -> None:
        self._native = native

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of the mosaic."""
        width, height = self._native.size
        return width, height

    @property
    def mosaic(self) -> npt.NDArray[np.uint16]:
        """Digital numbers, ``uint16 [row][column]`` (``[row][column][channel]`` where every pixel has all channels): a read-only view."""
        return self._native.mosaic

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> npt.NDArray[Any]:
        return _as_array(self.mosaic, dtype, copy)

    def __dlpack__(
        self,
        *,
        stream: None = None,
        max_version: tuple[int, int] | None = None,
        dl_device: tuple[int, int] | None = None,
        copy: bool | None = None,
    ) -> Any:
        """The mosaic for ``torch.from_dlpack`` and its like."""
        return _as_dlpack(self.mosaic, max_version, dl_device, copy)

    def __dlpack_device__(self) -> tuple[int, int]:
        return _DLPACK_CPU

    @property
    def pattern(self) -> npt.NDArray[np.intp]:
        """The filter pattern that repeats over the mosaic: numbers into :attr:`channels`, ``[row][column]``."""
        import numpy as np

        return np.asarray(self._native.pattern, dtype=np.intp)

    @property
    def channels(self) -> list[str]:
        """Names of the channels of the filter array."""
        return self._native.channels

    @property
    def black_level(self) -> float:
        """DN without light."""
        return self._native.black_level

    @property
    def white_level(self) -> float:
        """DN from which a pixel counts as full."""
        return self._native.white_level

    @property
    def metadata(self) -> dict[str, Any]:
        """What is known of the photograph and of the numbers: the facts of the exposure, ``black_level``, ``white_level``, ``bits``, ``cfa``,
        ``as_shot_neutral``, ``noise_profile`` (S and O of each channel, as DNG has them)."""
        native = self._native
        return _facts(native.facts) | {
            "black_level": native.black_level,
            "white_level": native.white_level,
            "bits": native.bits,
            "cfa": native.cfa,
            "as_shot_neutral": native.as_shot_neutral,
            "noise_profile": native.noise_profile,
        }

    def save(self, path: str | os.PathLike[str], *, storage: Literal["16", "packed", "lossless"] = "16") -> None:
        """Writes a DNG with a preview. ``storage``: 16 bits a number, as many as the converter has, or lossless JPEG. Written beside and renamed."""
        self._native.save(os.fspath(path), storage)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> RawImage:
        """Reads a DNG: ours or another camera's."""
        return cls(_diopter.RawImage.load(os.fspath(path)))

    def __repr__(self) -> str:
        width, height = self.size
        return f"<RawImage {width} × {height}, {self._native.cfa}, {self._native.bits} bits>"

    def _repr_png_(self) -> bytes:
        return Picture(_diopter.develop(self._native).array).to_png()

    def __reduce__(self) -> tuple[Any, ...]:
        return (_raw_from_bytes, (self._native.to_bytes(),))


def _raw_from_bytes(data: bytes) -> RawImage:
    return RawImage(_diopter.RawImage.from_bytes(data))


class Picture:
    """A developed picture: RGB codes in a named space.

    Args:
        array: Codes, ``[row][column][3]``; 1.0 is white.
        space: ``srgb``, ``display-p3``, ``rec2020`` or ``acescg``.
        encoding: ``srgb``, ``linear``, ``gamma-1.8``, ``gamma-2.2``, ``gamma-2.4``, ``pq`` or ``hlg``.
    """

    __slots__ = ("_native",)
    _native: _diopter.Picture

    def __init__(self, array: npt.ArrayLike, space: str = "srgb", encoding: str = "srgb") -> None:
        self._native = _diopter.Picture(floats(array), space, encoding)

    @classmethod
    def _of(cls, native: _diopter.Picture) -> Picture:
        picture = cls.__new__(cls)
        picture._native = native
        return picture

    @property
    def array(self) -> Float32:
        """Codes in :attr:`encoding`, ``float32 [row][column][3]``: a read-only view."""
        return self._native.array

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> npt.NDArray[Any]:
        return _as_array(self.array, dtype, copy)

    def __dlpack__(
        self,
        *,
        stream: None = None,
        max_version: tuple[int, int] | None = None,
        dl_device: tuple[int, int] | None = None,
        copy: bool | None = None,
    ) -> Any:
        """The array for ``torch.from_dlpack`` and its like."""
        return _as_dlpack(self.array, max_version, dl_device, copy)

    def __dlpack_device__(self) -> tuple[int, int]:
        return _DLPACK_CPU

    @property
    def space(self) -> str:
        """Primaries and white: ``srgb``, ``display-p3``, ``rec2020`` or ``acescg``."""
        return self._native.space

    @property
    def encoding(self) -> str:
        """Transfer function: ``srgb``, ``linear``, ``gamma-1.8``, ``gamma-2.2``, ``gamma-2.4``, ``pq`` or ``hlg``."""
        return self._native.encoding

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        height, width = self.array.shape[:2]
        return width, height

    @property
    def metadata(self) -> dict[str, Any]:
        """How it was taken; empty where that is not known."""
        facts = self._native.facts
        return {} if facts is None else _facts(facts)

    def to_png(self, *, bits: Literal[8, 16] = 8) -> bytes:
        """The bytes of a PNG file."""
        return self._native.to_png(bits)

    def save(self, path: str | os.PathLike[str], *, quality: int = 92, bits: Literal[8, 16] = 8) -> None:
        """Writes .jpg (of a ``quality`` from 1 to 100), .png (of 8 or 16 ``bits``), .tif (16 bits) or .exr (linear), with its colour profile and EXIF.
        Written beside and renamed."""
        self._native.save(os.fspath(path), quality, bits)

    def __repr__(self) -> str:
        width, height = self.size
        return f"<Picture {width} × {height}, {self.space}, {self.encoding}>"

    def _repr_png_(self) -> bytes:
        return self.to_png()

    def __reduce__(self) -> tuple[Any, ...]:
        import numpy as np

        return (_picture_again, (np.array(self.array), self.space, self.encoding, self._native.facts))


def _picture_again(
    array: npt.NDArray[np.float32], space: str, encoding: str, facts: str | None
) -> Picture:
    return Picture._of(_diopter.Picture(array, space, encoding, facts))


#: Memory of the processor, as DLPack numbers devices (``kDLCPU``).
_DLPACK_CPU = (1, 0)


def _as_array(view: npt.NDArray[Any], dtype: npt.DTypeLike | None, copy: bool | None) -> npt.NDArray[Any]:
    """What ``numpy.asarray`` asks for: without a copy where no other type is wanted."""
    import numpy as np

    if copy:
        return np.array(view, dtype=dtype)
    if copy is False and dtype is not None and np.dtype(dtype) != view.dtype:
        raise ValueError(f"{np.dtype(dtype)} of {view.dtype} without a copy: expected copy=None or copy=True")
    return np.asarray(view, dtype=dtype)


def _as_dlpack(
    view: npt.NDArray[Any], max_version: tuple[int, int] | None, dl_device: tuple[int, int] | None, copy: bool | None
) -> Any:
    """A capsule of DLPack. Our memory is read-only, which DLPack says from version 1.0 on (and numpy from 2.1 on): others are given a copy."""
    import numpy as np

    if dl_device is not None and tuple(dl_device) != _DLPACK_CPU:
        raise BufferError(f"device {dl_device}: expected {_DLPACK_CPU}, the memory of the processor")
    if not copy and max_version is not None and max_version[0] >= 1:
        with contextlib.suppress(TypeError, BufferError):
            return view.__dlpack__(max_version=max_version)
    if copy is False:
        raise BufferError("read-only memory, of which DLPack before 1.0 and numpy before 2.1 know nothing: expected copy=None or copy=True")
    return np.array(view).__dlpack__()


def _facts(text: str) -> dict[str, Any]:
    facts: dict[str, Any] = json.loads(text)
    return facts


__all__ = ["FocalPlane", "Picture", "RawImage"]
