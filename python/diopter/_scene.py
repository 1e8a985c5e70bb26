"""Scenes: embedded, from files, or put together from arrays."""

from __future__ import annotations

import copy
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Sequence

from . import _diopter
from ._errors import DiopterError
from ._units import floats, three

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class Material:
    """What a surface is made of. Made by the functions :meth:`diffuse`, :meth:`conductor`, :meth:`dielectric`, :meth:`principled` and
    :meth:`emissive`."""

    kind: str
    color: npt.ArrayLike = 0.5
    texture: npt.ArrayLike | None = None
    metal: str | None = None
    emission: npt.ArrayLike | None = None
    numbers: tuple[tuple[str, float], ...] = ()

    @staticmethod
    def diffuse(color: npt.ArrayLike = 0.5) -> Material:
        """Lambertian reflection. ``color``: reflectance from 0 to 1, one number or linear sRGB, or a picture ``[row][column][3]`` that lies on the
        texture coordinates of a mesh, (0, 0) its upper left corner."""
        color, texture = _texture(color)
        return Material("diffuse", color, texture)

    @staticmethod
    def conductor(metal: str = "aluminium", roughness: float = 0.0) -> Material:
        """A metal by its measured index of refraction: silver, gold, copper, aluminium, chromium, nickel, titanium, iron, platinum,
        tungsten, brass or stainless-steel. ``roughness``: √α of the GGX distribution, 0 to 1."""
        return Material("conductor", metal=metal, numbers=(("roughness", roughness),))

    @staticmethod
    def dielectric(ior: float = 1.5, roughness: float = 0.0, color: npt.ArrayLike = 1.0) -> Material:
        """A solid body of glass, water ... of an index of refraction. ``color``: tint of what goes through, 0 to 1."""
        return Material("dielectric", color, numbers=(("ior", ior), ("roughness", roughness)))

    @staticmethod
    def principled(
        color: npt.ArrayLike = 0.5,
        *,
        metallic: float = 0.0,
        roughness: float = 0.5,
        ior: float = 1.5,
        transmission: float = 0.0,
        clearcoat: float = 0.0,
    ) -> Material:
        """glTF's metallic-roughness material. ``color``: as of :meth:`diffuse`; all else from 0 to 1 but ``ior``."""
        color, texture = _texture(color)
        numbers = {
            "metallic": metallic,
            "roughness": roughness,
            "ior": ior,
            "transmission": transmission,
            "clearcoat": clearcoat,
        }
        return Material("principled", color, texture, numbers=tuple(numbers.items()))

    @staticmethod
    def emissive(
        luminance: npt.ArrayLike = 1000.0, *, temperature_k: float | None = None, two_sided: bool = False
    ) -> Material:
        """A lamp: the same radiance in all directions, from the front.

        Args:
            luminance: cd/m², one number (of D65) or linear sRGB.
            temperature_k: Of a black body, K, instead of a colour; ``luminance`` is then one number.
        """
        import numpy as np

        numbers: tuple[tuple[str, float], ...] = (("two_sided", float(two_sided)),)
        if temperature_k is None:
            return Material("black", emission=luminance, numbers=numbers)
        if np.ndim(luminance) == 0:
            numbers += (("kelvin", float(temperature_k)), ("luminance", float(np.asarray(luminance))))
            return Material("black", numbers=numbers)
        raise DiopterError(
            "luminance: expected one number beside temperature_k", "luminance", repr(luminance), "one number, cd/m²"
        )


def _texture(color: npt.ArrayLike) -> tuple[npt.ArrayLike, npt.ArrayLike | None]:
    """A constant colour and a picture."""
    import numpy as np

    return (1.0, color) if np.ndim(color) == 3 else (color, None)


class Scene:
    """What is photographed: right-handed, metres, +Y up, light in absolute units.

    ``Scene()`` is empty, to be put together by the ``add_`` methods, which return the scene. See also :meth:`load` and :meth:`builtin`.
    """

    _native: _diopter.Scene
    #: How the scene is made again: what it was read from, and what was added.
    _origin: tuple[str, Any]
    _steps: list[tuple[str, dict[str, Any]]]

    def __init__(self, name: str = "scene") -> None:
        self._native = _diopter.Scene(name)
        self._origin = ("new", name)
        self._steps = []

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, strict: bool = False) -> Scene:
        """Reads .gltf, .glb, .usd (.usda, .usdc, .usdz), .pbrt, .xml (Mitsuba), .obj, .ply, .spz or .stl. ``strict``: a texture that cannot be read is an error; without, magenta stands in for it."""
        scene = cls.__new__(cls)
        name = os.fspath(path)
        scene._native = _diopter.Scene.read(name, strict)
        # A pickle finds the file from another folder, too; names of embedded scenes are no files.
        embedded = name in _diopter.scene_names() or not os.path.exists(name)
        scene._origin = ("load", (name if embedded else os.path.abspath(name), strict))
        scene._steps = []
        return scene

    @classmethod
    def builtin(cls, name: str = "still-life") -> Scene:
        """An embedded scene; :meth:`names` lists them."""
        return cls.load(name)

    @staticmethod
    def names() -> list[str]:
        """Names of the embedded scenes."""
        return _diopter.scene_names()

    @property
    def name(self) -> str:
        """For messages and metadata."""
        return self._native.name

    @property
    def objects(self) -> list[str]:
        """Names of its objects; ``FocalPlane.object`` holds their numbers + 1."""
        return self._native.objects

    @property
    def cameras(self) -> list[str]:
        """Names of the cameras that its file has; ``Camera(viewpoint=...)`` takes one."""
        return self._native.cameras

    @property
    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """Two corners of the box around all of it at the beginning, m; None where there is nothing."""
        found = self._native.bounds()
        return None if found is None else (tuple(found[0]), tuple(found[1]))

    def _step(self, method: str, **arguments: Any) -> Scene:
        getattr(self, "_do_" + method)(**arguments)
        # As it is now: whoever gave arrays may change them.
        self._steps.append((method, copy.deepcopy(arguments)))
        return self

    def _material(self, material: Material) -> int:
        color = three(material.color, "color")
        texture = None if material.texture is None else floats(material.texture)
        emission = None if material.emission is None else three(material.emission, "luminance")
        return self._native.add_material(
            material.kind, material.kind, color, texture, material.metal, emission, dict(material.numbers)
        )

    def add_mesh(
        self,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
        material: Material,
        *,
        normals: npt.ArrayLike | None = None,
        uvs: npt.ArrayLike | None = None,
        transform: npt.ArrayLike | None = None,
        name: str = "mesh",
    ) -> Scene:
        """Adds triangles.

        Args:
            vertices: ``[vertex][x, y, z]``, m.
            faces: ``[triangle][3]`` numbers of vertices, counter-clockwise seen from outside.
            normals: ``[vertex][3]``; flat faces without.
            uvs: Texture coordinates ``[vertex][u, v]``, v downwards.
            transform: 4 × 4, world from mesh.
        """
        return self._step(
            "mesh",
            vertices=vertices,
            faces=faces,
            material=material,
            normals=normals,
            uvs=uvs,
            transform=transform,
            name=name,
        )

    def _do_mesh(
        self,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
        material: Material,
        normals: npt.ArrayLike | None,
        uvs: npt.ArrayLike | None,
        transform: npt.ArrayLike | None,
        name: str,
    ) -> None:
        self._native.add_mesh(
            name,
            floats(vertices),
            _corners(faces),
            self._material(material),
            None if normals is None else floats(normals),
            None if uvs is None else floats(uvs),
            None if transform is None else floats(transform).tolist(),
        )

    def add_sphere(
        self, center: Sequence[float], radius: float, material: Material, *, name: str = "sphere"
    ) -> Scene:
        """Adds a sphere; m."""
        return self._step("sphere", center=center, radius=radius, material=material, name=name)

    def _do_sphere(self, center: Sequence[float], radius: float, material: Material, name: str) -> None:
        self._native.add_sphere(name, three(center, "center"), float(radius), self._material(material))

    def add_quad(
        self,
        corner: Sequence[float],
        edges: Sequence[Sequence[float]],
        material: Material,
        *,
        name: str = "quad",
    ) -> Scene:
        """Adds a parallelogram of a corner and two edges, m; its front is where edge 0 × edge 1 points."""
        return self._step("quad", corner=corner, edges=edges, material=material, name=name)

    def _do_quad(
        self, corner: Sequence[float], edges: Sequence[Sequence[float]], material: Material, name: str
    ) -> None:
        both = [three(edge, "edge") for edge in edges]
        if len(both) != 2:
            raise DiopterError(f"edges: expected 2, found {len(both)}", "edges", str(len(both)), "2")
        self._native.add_quad(name, three(corner, "corner"), both, self._material(material))

    def add_point_light(
        self, position: Sequence[float], intensity: npt.ArrayLike, *, name: str = "point light"
    ) -> Scene:
        """Adds a light in a point (m) of an intensity in cd, one number (of D65) or linear sRGB."""
        return self._step("point_light", position=position, intensity=intensity, name=name)

    def _do_point_light(self, position: Sequence[float], intensity: npt.ArrayLike, name: str) -> None:
        self._native.add_point(name, three(position, "position"), three(intensity, "intensity"))

    def add_sun(
        self,
        towards: Sequence[float],
        illuminance: npt.ArrayLike = 100_000.0,
        *,
        diameter_deg: float = 0.53,
        name: str = "sun",
    ) -> Scene:
        """Adds a disc at infinity.

        Args:
            towards: Direction from the scene to the sun.
            illuminance: On a surface that faces it, lx, one number (of D65) or linear sRGB.
            diameter_deg: Angle under which it is seen; 0 is parallel light.
        """
        return self._step("sun", towards=towards, illuminance=illuminance, diameter_deg=diameter_deg, name=name)

    def _do_sun(
        self, towards: Sequence[float], illuminance: npt.ArrayLike, diameter_deg: float, name: str
    ) -> None:
        self._native.add_sun(name, three(towards, "towards"), three(illuminance, "illuminance"), float(diameter_deg))

    def set_environment(
        self, radiance: npt.ArrayLike, *, rotation_deg: float = 0.0, scale: float = 1.0
    ) -> Scene:
        """Puts light all around.

        Args:
            radiance: cd/m²: one number, linear sRGB, or a lat-long picture ``[row][column][3]``, its top upwards.
            rotation_deg: Turns the picture about the vertical.
            scale: Multiplies it.
        """
        return self._step("environment", radiance=radiance, rotation_deg=rotation_deg, scale=scale)

    def _do_environment(self, radiance: npt.ArrayLike, rotation_deg: float, scale: float) -> None:
        import numpy as np

        if np.ndim(radiance) == 3:
            picture = floats(radiance)
        else:
            picture = floats(np.broadcast_to(three(radiance, "environment"), (4, 8, 3)))
        self._native.set_environment(picture, float(rotation_deg), float(scale))

    def __repr__(self) -> str:
        return f"<Scene {self.name}: {len(self.objects)} objects, {self._native.triangles} triangles>"

    def __reduce__(self) -> tuple[Any, ...]:
        return (_again, (self._origin, self._steps))


def _again(origin: tuple[str, Any], steps: list[tuple[str, dict[str, Any]]]) -> Scene:
    """A scene from how it was made."""
    if origin[0] == "new":
        scene = Scene(origin[1])
    else:
        path, strict = origin[1]
        scene = Scene.load(path, strict=strict)
    for method, arguments in steps:
        scene._step(method, **arguments)
    return scene


def _corners(faces: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    """Numbers of vertices; negative ones and fractions are errors instead of large numbers."""
    import numpy as np

    given = np.asarray(faces)
    if given.size and (not np.issubdtype(given.dtype, np.integer) or given.min() < 0):
        raise DiopterError(
            "faces: expected whole numbers from 0 on", "faces", f"{given.dtype}, least {given.min()}", "whole numbers from 0 on"
        )
    if given.size and int(given.max()) > 0xFFFF_FFFF:
        raise DiopterError(f"faces {given.max()}: expected numbers of vertices", "faces", str(given.max()), "numbers of vertices")
    return np.ascontiguousarray(given, dtype=np.uint32)
