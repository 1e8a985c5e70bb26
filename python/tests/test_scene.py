"""Scenes from arrays."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import diopter as dp

CORNERS = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], dtype=float)
FACES = [[0, 2, 1], [0, 3, 2]]


def made() -> dp.Scene:
    checker = np.indices((4, 4)).sum(axis=0) % 2
    texture = np.repeat(checker[:, :, None], 3, axis=2) * 0.8 + 0.1
    return (
        dp.Scene("mine")
        .add_mesh(CORNERS, FACES, dp.Material.diffuse(texture), uvs=CORNERS[:, [0, 2]] / 2 + 0.5, name="floor")
        .add_sphere((0, 0.3, 0), 0.3, dp.Material.conductor("gold", 0.2), name="ball")
        .add_sphere((0.7, 0.2, 0), 0.2, dp.Material.dielectric(1.5), name="glass")
        .add_quad((-0.5, 2, -0.5), [(1, 0, 0), (0, 0, 1)], dp.Material.emissive(5000.0, temperature_k=3200, two_sided=True))
        .add_point_light((1, 2, 1), (100, 80, 60))
        .add_sun((1, 1, 0), 1000.0)
        .set_environment((10, 20, 30))
    )


CAMERA = dp.Camera(lens="thin", focal_length="35 mm", position=(0, 1, 3), look_at=(0, 0.2, 0), focus="3 m", aperture="f/8")


def test_what_was_put_there_is_seen() -> None:
    scene = made()
    assert scene.objects == ["floor", "ball", "glass", "quad"] and scene.bounds is not None
    plane = dp.expose(scene, CAMERA, shutter="1/30 s", size=(36, 24), spp=8)
    seen = {scene.objects[n - 1] for n in np.unique(plane.object) if n > 0}
    assert {"floor", "ball", "glass"} <= seen
    assert plane.mean.min() >= 0 and plane.mean.mean() > 1
    assert plane.metadata["scene"] == "mine"
    # Fields of 0.1 and 0.9, and what is interpolated between: a fifteenth of the places is within a quarter of one of them.
    floor = plane.albedo[plane.object == 1]
    assert floor.min() < 0.3 and floor.max() > 0.7


def test_distances_are_metres() -> None:
    scene = dp.Scene().add_quad((-50, -50, -7), [(100, 0, 0), (0, 100, 0)], dp.Material.diffuse(0.5)).set_environment(100.0)
    camera = dp.Camera(lens="pinhole", position=(0, 0, 0), look_at=(0, 0, -1))
    plane = dp.expose(scene, camera, shutter=0.1, size=(8, 6), spp=2)
    np.testing.assert_allclose(plane.depth, 7.0, rtol=1e-5)
    np.testing.assert_allclose(plane.normal, np.broadcast_to([0, 0, 1], (6, 8, 3)), atol=1e-5)


def test_a_matte_surface_gives_what_its_light_says() -> None:
    # Under an even sky of L a matte surface has the luminance ρ L: in a furnace.
    scene = dp.Scene().add_sphere((0, 0, -5), 1.0, dp.Material.diffuse(0.5)).set_environment(1000.0)
    camera = dp.Camera(lens="pinhole", position=(0, 0, 0), look_at=(0, 0, -1), focal_length="200 mm")
    plane = dp.expose(scene, camera, record="radiance", shutter=0.1, size=(8, 6), spp=256)
    green = plane.mean[..., 1]
    # Noise of 256 samples of colours drawn by wavelength.
    np.testing.assert_allclose(green.mean(), 500.0, rtol=0.03)


def test_scenes_are_pickled_by_how_they_were_made() -> None:
    scene = made()
    again = pickle.loads(pickle.dumps(scene))
    planes = [dp.expose(s, CAMERA, shutter=0.1, size=(18, 12), spp=2) for s in (scene, again)]
    np.testing.assert_array_equal(planes[0].mean, planes[1].mean)
    # Arrays are those of when they were given.
    corners = np.array(CORNERS, dtype=np.float32)
    scene = dp.Scene().add_mesh(corners, FACES, dp.Material.diffuse())
    corners[:, 2] += 3
    assert pickle.loads(pickle.dumps(scene)).bounds == scene.bounds


def test_what_does_not_fit_is_told() -> None:
    grey = dp.Material.diffuse()
    for light in (-1.0, float("nan"), float("inf")):
        with pytest.raises(dp.DiopterError, match="radiance"):
            dp.Scene().set_environment(light)
    with pytest.raises(dp.DiopterError, match="reflectances"):
        dp.Scene().add_sphere((0, 0, 0), 1.0, dp.Material.diffuse(np.full((2, 2, 3), 255, np.uint8)))
    with pytest.raises(dp.DiopterError, match="below 4"):
        dp.Scene().add_mesh(CORNERS, [[0, 1, 4]], grey)
    with pytest.raises(dp.DiopterError, match="whole numbers"):
        dp.Scene().add_mesh(CORNERS, [[0, 1, -1]], grey)
    with pytest.raises(dp.DiopterError) as e:
        dp.Scene().add_mesh(CORNERS[:, :2], FACES, grey)
    assert e.value.place == "vertices" and e.value.found == "of shape [4, 2]"
    with pytest.raises(dp.DiopterError, match="one of silver"):
        dp.Scene().add_sphere((0, 0, 0), 1.0, dp.Material.conductor("tin"))
    with pytest.raises(dp.DiopterError, match="radius"):
        dp.Scene().add_sphere((0, 0, 0), -1.0, grey)
    with pytest.raises(dp.DiopterError, match="did you mean"):
        dp.Scene.builtin("cornel")
    with pytest.raises(dp.DiopterError, match="empty"):
        dp.expose(dp.Scene(), size=(8, 8), shutter=1)
