"""Photographs of 3D scenes the way a real camera takes them.

A photograph is a chain of values, each with a unit; each can be looked at, saved, and made by other programs::

    import diopter as dp

    scene = dp.Scene.builtin("still-life")
    camera = dp.Camera(lens="double-gauss-50mm", body="nikon-d850", focus="auto", aperture="f/2.8")
    plane = dp.expose(scene, camera, spp=64, size=(600, 400), seed=1, progress=True)   # mean electrons, depth, normals ...
    raw = dp.read_out(plane, iso=800, seed=3)                                            # digital numbers behind a filter array
    picture = dp.develop(raw, tone="agx")                                                # RGB
    picture.save("photo.jpg")

Values take text with units (``"1/125 s"``, ``"f/2.8"``, ``"50 mm"``) or plain numbers in the units of the documentation: seconds, metres in the scene,
millimetres in the lens, nanometres. Errors are :class:`DiopterError`, with the parts of the sentence. Long calls release the interpreter, stop on Ctrl-C
and show progress.
"""

from __future__ import annotations

from ._camera import VISUAL_NM, Bench, Body, Camera, Distortion, IsoStep, Lens, Mtf, Rays, Spot, Vignetting
from ._design import Fitted, FittedNumber, Optimised, Perturbation, Psf, Quantity, Tolerances, Wavefront, Zernikes
from ._diopter import __version__
from ._errors import DiopterError, DiopterWarning
from ._images import FocalPlane, Picture, RawImage
from ._pipeline import (
    Expected,
    ExposureSettings,
    Photograph,
    RecipeSetting,
    autofocus,
    develop,
    expected,
    expose,
    merge,
    merge_raws,
    meter,
    read_out,
    recipe_settings,
    set_threads,
    shoot,
)
from ._program import command
from ._scene import Material, Scene
from .dataset import Dataset

__all__ = [
    "VISUAL_NM",
    "Bench",
    "Body",
    "Camera",
    "Dataset",
    "DiopterError",
    "DiopterWarning",
    "Distortion",
    "Expected",
    "ExposureSettings",
    "Fitted",
    "FittedNumber",
    "FocalPlane",
    "IsoStep",
    "Lens",
    "Material",
    "Mtf",
    "Optimised",
    "Perturbation",
    "Photograph",
    "Picture",
    "Psf",
    "Quantity",
    "RawImage",
    "Rays",
    "RecipeSetting",
    "Scene",
    "Spot",
    "Tolerances",
    "Vignetting",
    "Wavefront",
    "Zernikes",
    "__version__",
    "autofocus",
    "command",
    "develop",
    "expected",
    "expose",
    "merge",
    "merge_raws",
    "meter",
    "read_out",
    "recipe_settings",
    "set_threads",
    "shoot",
]
