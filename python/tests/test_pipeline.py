"""The pipeline: scene → focal plane → raw image → picture."""

from __future__ import annotations

import os
import pickle
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import diopter as dp

SMALL: Any = {"size": (48, 32), "spp": 4, "seed": 3, "shutter": "1/60 s"}


@pytest.fixture(scope="module")
def scene() -> dp.Scene:
    return dp.Scene.builtin("cornell")


@pytest.fixture(scope="module")
def plane(scene: dp.Scene) -> dp.FocalPlane:
    return dp.expose(scene, dp.Camera(body="canon-5d-mark-iv"), **SMALL)


def test_a_plane_is_arrays_without_a_copy(plane: dp.FocalPlane) -> None:
    assert plane.size == (48, 32)
    assert plane.bands == [("R", "electrons"), ("G", "electrons"), ("B", "electrons")]
    assert plane.mean.shape == (32, 48, 3) and plane.mean.dtype == np.float32
    assert plane.mean.mean() > 10
    assert plane.mean.ctypes.data == plane.mean.ctypes.data, "two views of one memory"
    assert not plane.mean.flags.writeable and not plane.mean.flags.owndata
    assert plane.depth.shape == (32, 48) and plane.normal.shape == plane.albedo.shape == (32, 48, 3)
    assert plane.object.dtype == np.uint32 and plane.object.max() > 0
    np.testing.assert_allclose(plane.variance, plane.half_difference**2)
    assert plane.metadata["seed"] == 3 and plane.metadata["samples"] == 4


def test_truth_channels_are_arrays_by_name(scene: dp.Scene) -> None:
    plane = dp.expose(scene, dp.Camera(body="canon-5d-mark-iv"), truth_channels="position,flow,crypto-object", **SMALL)
    assert list(plane.truth_channels) == ["depth", "normal", "albedo", "id", "position", "flow", "crypto-object"]
    assert plane.truth("position").shape == (32, 48, 3) and plane.truth("crypto-object").shape == (32, 48, 12)
    np.testing.assert_array_equal(plane.truth("depth"), plane.depth)
    # Nothing moves.
    hit = np.isfinite(plane.depth)
    assert hit.any() and np.abs(plane.truth("flow")[hit]).max() < 1e-2
    assert len(plane.object_names) >= plane.object.max()
    with pytest.raises(KeyError, match="motion"):
        plane.truth("motion")


def test_a_view_outlives_its_plane(scene: dp.Scene) -> None:
    plane = dp.expose(scene, **SMALL)
    mean, copy = plane.mean, np.array(plane.mean)
    del plane
    np.testing.assert_array_equal(mean, copy)


def test_threads_and_parts_change_no_bit(scene: dp.Scene, plane: dp.FocalPlane) -> None:
    camera = dp.Camera(body="canon-5d-mark-iv")
    one = dp.expose(scene, camera, threads=1, **SMALL)
    np.testing.assert_array_equal(one.mean, plane.mean)
    parts = [dp.expose(scene, camera, samples=part, **SMALL) for part in ((2, 4), (0, 2))]
    whole = dp.merge(parts)
    # Sums in another order: the last digits of single precision.
    np.testing.assert_allclose(whole.mean, plane.mean, rtol=1e-6, atol=1e-6 * float(plane.mean.max()))
    assert whole.metadata["samples"] == 4


def test_read_out_and_develop(plane: dp.FocalPlane) -> None:
    raw = dp.read_out(plane, iso=800, seed=3)
    again = dp.read_out(plane, iso=800, seed=3, threads=1)
    other = dp.read_out(plane, iso=800, seed=4)
    assert raw.mosaic.shape == (32, 48) and raw.mosaic.dtype == np.uint16
    np.testing.assert_array_equal(raw.mosaic, again.mosaic)
    assert (raw.mosaic != other.mosaic).any()
    assert raw.metadata["iso"] == 800 and raw.metadata["noise_seed"] == 3
    assert raw.pattern.shape == (2, 2) and raw.channels[raw.pattern[0, 0]] == raw.channels[0]
    picture = dp.develop(raw, tone="agx", exposure_ev=0.5, white={"balance": "daylight"})
    assert picture.array.shape == (32, 48, 3) and picture.encoding == "srgb"
    assert 0.0 < float(picture.array.mean()) < 1.0
    assert picture.to_png().startswith(b"\x89PNG") and plane._repr_png_().startswith(b"\x89PNG")


def test_full_color_has_three_numbers_a_pixel(plane: dp.FocalPlane) -> None:
    full = dp.read_out(plane, iso=800, seed=3, color_sampling="full")
    mosaic = dp.read_out(plane, iso=800, seed=3).mosaic
    assert full.mosaic.shape == (*mosaic.shape, 3)
    assert dp.develop(full).array.shape == (*mosaic.shape, 3)
    # Green of a Bayer pattern's two greens and of all pixels is the same light.
    green = (mosaic[0::2, 1::2].mean() + mosaic[1::2, 0::2].mean()) / 2
    assert full.mosaic[..., 1].mean() == pytest.approx(green, rel=0.05)
    with pytest.raises(dp.DiopterError, match="color_sampling"):
        dp.read_out(plane, color_sampling="half")


def test_the_expected_raw_image_is_the_mean_of_read_outs(plane: dp.FocalPlane) -> None:
    truth = dp.expected(plane, iso=800)
    raws = np.stack([dp.read_out(plane, iso=800, seed=seed).mosaic for seed in range(200)]).astype(float)
    free = ~truth.clipped
    off = raws.mean(axis=0) - truth.dn
    # The mean of 200 has 0.07 of the noise of one; five deviations over 1536 pixels, and half a number of rounding.
    assert np.abs(off[free]).max() < 5 * raws.std(axis=0)[free].max() / np.sqrt(200) + 0.5


def test_shoot_is_the_stages_one_by_one(scene: dp.Scene, plane: dp.FocalPlane) -> None:
    photograph = dp.shoot(scene, dp.Camera(body="canon-5d-mark-iv"), iso=400, **SMALL)
    np.testing.assert_array_equal(photograph.plane.mean, plane.mean)
    raw = dp.read_out(plane, iso=400, seed=3)
    np.testing.assert_array_equal(photograph.raw.mosaic, raw.mosaic)
    np.testing.assert_array_equal(photograph.picture.array, dp.develop(raw).array)


def test_files_give_back_what_was_written(plane: dp.FocalPlane, tmp_path: Path) -> None:
    plane.save(tmp_path / "a.exr")
    read = dp.FocalPlane.load(tmp_path / "a.exr")
    np.testing.assert_array_equal(read.mean, plane.mean)
    np.testing.assert_array_equal(read.object, plane.object)
    assert read.metadata == plane.metadata
    raw = dp.read_out(read, seed=5)
    np.testing.assert_array_equal(raw.mosaic, dp.read_out(plane, seed=5).mosaic)
    raw.save(tmp_path / "a.dng", storage="lossless")
    np.testing.assert_array_equal(dp.RawImage.load(str(tmp_path / "a.dng")).mosaic, raw.mosaic)
    for name in ("a.jpg", "a.png", "a.tif", "a.exr"):
        dp.develop(raw).save(tmp_path / ("b" + name))
        assert (tmp_path / ("b" + name)).stat().st_size > 100
    assert not list(tmp_path.glob(".diopter-*")), "nothing is left beside"


def test_pickles(plane: dp.FocalPlane, scene: dp.Scene) -> None:
    again = pickle.loads(pickle.dumps(plane))
    np.testing.assert_array_equal(again.mean, plane.mean)
    raw = dp.read_out(plane)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(raw)).mosaic, raw.mosaic)
    camera = dp.Camera(lens="tessar-50mm-f2.8", body="nikon-d850", aperture="f/4")
    assert pickle.loads(pickle.dumps(camera)).lens == camera.lens
    assert pickle.loads(pickle.dumps(scene)).objects == scene.objects
    picture = dp.develop(raw)
    again = pickle.loads(pickle.dumps(picture))
    np.testing.assert_array_equal(again.array, picture.array)
    assert again.metadata == picture.metadata and picture.metadata["body"]


def test_planes_carry_what_the_camera_was_set_to(scene: dp.Scene) -> None:
    camera = dp.Camera(body="nikon-d850", serial="42")
    taken: Any = {"temperature_c": 35, "white": "A", "iso": 200, "size": (24, 16), "spp": 2}
    plane = dp.expose(scene, camera, **taken)
    raw = dp.read_out(plane)
    assert [raw.metadata[k] for k in ("serial", "temperature_c", "white")] == ["42", 35, "A"]
    np.testing.assert_array_equal(raw.mosaic, dp.shoot(scene, camera, **taken).raw.mosaic)
    other = dp.read_out(plane, serial="43", white="D50")
    assert other.metadata["serial"] == "43" and other.metadata["white"] == "D50"


def test_the_same_plane_is_the_same_file(plane: dp.FocalPlane, tmp_path: Path) -> None:
    for k in range(4):
        plane.save(tmp_path / f"{k}.exr")
    assert len({(tmp_path / f"{k}.exr").read_bytes() for k in range(4)}) == 1
    assert pickle.dumps(plane) == pickle.dumps(plane)


def test_series_and_files_are_refused(scene: dp.Scene) -> None:
    for section in ({"sequence": {"frames": 3}}, {"output": {"files": ["a.exr"]}}):
        with pytest.raises(dp.DiopterError, match="one exposure"):
            dp.expose(scene, settings=section, size=(12, 8), spp=1)


def test_metering_and_autofocus(scene: dp.Scene) -> None:
    camera = dp.Camera(lens="double-gauss-50mm", aperture="f/2.8")
    with pytest.warns(dp.DiopterWarning, match="sees 39°"):
        found = dp.meter(scene, camera, size=(48, 32), iso=200)
    assert found["iso"] == 200 and found["exposure_s"] > 0 and found["metered_ev100"] is not None
    report = dp.autofocus(dp.Scene.builtin(), camera)
    assert report["chosen"] is not None and 0.2 < report["distance_m"] < 2


def test_radiance_and_spectra(scene: dp.Scene) -> None:
    light = dp.expose(scene, record="radiance", **SMALL)
    assert [unit for _, unit in light.bands] == ["radiance"] * 3
    spectral = dp.expose(scene, record="400..700/100nm", **SMALL)
    assert len(spectral.bands) == 3
    with pytest.raises(dp.DiopterError) as e:
        dp.read_out(light)
    assert e.value.place == "bands"
    on = light.on_sensor("nikon-d850")
    assert on.bands[0][1] == "electrons" and dp.read_out(on).mosaic.shape == (32, 48)
    np.testing.assert_allclose(light.on_sensor("nikon-d850", shutter="1/30 s").mean, 2 * on.mean, rtol=1e-5)
    np.testing.assert_array_equal(on.depth, light.depth)


def test_light_from_elsewhere_counts_what_the_scene_gives() -> None:
    # An even field: what is exposed through a lossless lens is what its radiance gives.
    scene = dp.Scene("even").set_environment(1000.0)
    camera = dp.Camera(lens="thin", body="nikon-d850", aperture="f/4", position=(0, 0, 0), look_at=(0, 0, -1), focus="inf")
    plane = dp.expose(scene, camera, shutter="1/100 s", size=(15, 11), spp=64)
    same = dp.FocalPlane.from_radiance(np.full((11, 15, 3), 1000.0), "nikon-d850", shutter="1/100 s", t_number="f/4")
    # The middle of the picture, where the cosine's fourth power is 1; 64 samples.
    np.testing.assert_allclose(plane.mean[5, 7], same.mean[5, 7], rtol=0.02)
    assert dp.read_out(same, iso=100).mosaic.shape == (11, 15)
    with pytest.raises(dp.DiopterError, match="4 channels"):
        dp.FocalPlane.from_irradiance(np.ones((2, 2, 4)), "nikon-d850", shutter=0.01)


def test_lines_of_any_width_count_by_their_area() -> None:
    body = dp.Body("imx249")

    def electrons(wavelengths: list[float], values: list[float]) -> float:
        light = np.broadcast_to(np.array(values) * 1e-6, (2, 2, len(values)))
        return float(dp.FocalPlane.from_irradiance(light, body, shutter=0.01, wavelengths_nm=wavelengths).mean[0, 0, 0])

    whole = electrons([400, 549, 550, 551, 700], [0, 0, 1, 0, 0])
    for half in (0.5, 0.1, 0.05):
        line = electrons([400, 550 - half, 550, 550 + half, 700], [0, 0, 1, 0, 0])
        assert line / half == pytest.approx(whole, rel=2e-3)
    assert electrons([435.7, 435.8, 435.9, 546.0, 546.1, 546.2], [0, 1, 0, 0, 1, 0]) > 0
    for wavelengths, told in (([800.0, 900.0], "380 to 780"), ([0.5, 0.6], "0.5, 0.6")):
        with pytest.raises(dp.DiopterError, match=told):
            electrons(wavelengths, [1, 1])


def test_sizes_beyond_the_memory_are_errors(scene: dp.Scene) -> None:
    with pytest.raises(dp.DiopterError, match="are free") as e:
        dp.expose(scene, size=(65000, 65000), spp=1, shutter=0.01)
    assert e.value.place == "size"
    # The largest picture takes 52 GB.
    if os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") < 48e9:
        raw = dp.read_out(dp.expose(scene, dp.Camera(body="canon-5d-mark-iv"), **SMALL))
        with pytest.raises(dp.DiopterError, match="are free") as e:
            dp.develop(raw, resize={"width": 65535, "height": 65535})
        assert e.value.place == "resize"


def test_bodies_and_cameras_are_what_they_are_made_of() -> None:
    assert dp.Body("nikon-d850") == dp.Body("nikon-d850") != dp.Body("canon-t2i")
    camera = dp.Camera(body="nikon-d850", position=[0.0, 0.0, 0.0], settings={"camera": {"shake": 0.6}})
    assert pickle.loads(pickle.dumps(camera)) == camera and hash(camera) == hash(pickle.loads(pickle.dumps(camera)))
    assert camera != dp.Camera(body="nikon-d850", position=[1.0, 1.0, 1.0]) and dp.Camera() != dp.Camera(aperture=2.8)


def test_errors_have_parts(scene: dp.Scene) -> None:
    with pytest.raises(dp.DiopterError) as e:
        dp.Camera(lens="tessar-50mm-f2.7")
    assert e.value.place == "lens" and e.value.found == '"tessar-50mm-f2.7"'
    assert e.value.hint is not None and "tessar-50mm-f2.8" in e.value.hint
    assert pickle.loads(pickle.dumps(e.value)).place == "lens"
    with pytest.raises(dp.DiopterError) as e:
        dp.expose(scene, shutter="soon", size=(8, 8))
    assert e.value.place == "exposure.shutter" and e.value.expected == 'a time such as "1/125 s" or "8 ms"'
    with pytest.raises(dp.DiopterError) as e:
        dp.Lens("double-gauss-50mm").bench(aperture="fast")
    assert e.value.found == '"fast"'
    with pytest.raises(dp.DiopterError) as e:
        dp.expose(scene, settings={"scene": {"fgo": {}}})
    assert e.value.place == "scene.fgo"
    with pytest.raises(TypeError, match='did you mean "shutter"'):
        dp.expose(scene, shuter=1)  # type: ignore[call-arg]
    with pytest.raises(dp.DiopterError):
        dp.FocalPlane.load("nowhere.exr")
    with pytest.raises(dp.DiopterError) as e:
        dp.develop(dp.read_out(dp.expose(scene, **SMALL)), tone="agks")
    assert e.value.place == "tone.curve"


def test_progress_is_told_and_can_stop(scene: dp.Scene) -> None:
    told: list[float] = []
    dp.expose(scene, size=(240, 160), spp=16, shutter=0.01, progress=told.append)
    assert told == sorted(told) and all(0 <= part <= 1 for part in told) and told[-1] == 1

    def stop(part: float) -> None:
        raise KeyboardInterrupt

    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        dp.expose(scene, size=(300, 200), spp=65536, shutter=0.01, progress=stop)
    assert time.monotonic() - began < 30


def test_other_python_threads_run_meanwhile(scene: dp.Scene) -> None:
    ticks = 0
    done = threading.Event()

    def count() -> None:
        nonlocal ticks
        while not done.wait(0.005):
            ticks += 1

    thread = threading.Thread(target=count)
    thread.start()
    began = time.monotonic()
    dp.expose(scene, size=(240, 160), spp=32, shutter=0.01)
    seconds = time.monotonic() - began
    done.set()
    thread.join()
    assert ticks > 0.1 * seconds / 0.005, f"{ticks} in {seconds} s"


def test_raw_images_and_pictures_are_arrays(plane: dp.FocalPlane) -> None:
    raw = dp.read_out(plane, seed=3)
    picture = dp.develop(raw)
    for value, array in ((raw, raw.mosaic), (picture, picture.array)):
        shared, copied = np.asarray(value), np.array(value)
        np.testing.assert_array_equal(shared, array)
        assert np.shares_memory(shared, array) and not shared.flags.writeable
        assert copied.flags.writeable and not np.shares_memory(copied, array)
        np.testing.assert_array_equal(np.asarray(value, dtype=np.float64), array.astype(np.float64))
        assert value.__dlpack_device__() == (1, 0)
        # Of a consumer that does not know of read-only memory: a copy.
        assert "dltensor" in repr(value.__dlpack__())
        with pytest.raises(BufferError, match="device"):
            value.__dlpack__(dl_device=(2, 0))
        if hasattr(np, "from_dlpack"):
            np.testing.assert_array_equal(np.from_dlpack(value), array)
    if np.lib.NumpyVersion(np.__version__) >= "2.1.0":
        assert np.shares_memory(np.from_dlpack(picture), picture.array) and not np.from_dlpack(picture).flags.writeable


def test_paths_need_not_be_text(plane: dp.FocalPlane, tmp_path: Path) -> None:
    class Somewhere:
        def __fspath__(self) -> str:
            return str(tmp_path / "b.exr")

    plane.save(Somewhere())
    assert dp.FocalPlane.load(Somewhere()).size == plane.size


def test_pictures_show_in_notebooks(plane: dp.FocalPlane) -> None:
    raw = dp.read_out(plane)
    taken = dp.Photograph(plane, raw, dp.develop(raw))
    for value in (plane, raw, taken.picture, taken):
        png = value._repr_png_()
        assert png.startswith(b"\x89PNG")
        width, height = int.from_bytes(png[16:20], "big"), int.from_bytes(png[20:24], "big")
        assert (width, height) == (48, 32)
