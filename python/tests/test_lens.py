"""The lens bench and bodies."""

from __future__ import annotations

import numpy as np
import pytest

import diopter as dp


@pytest.fixture(scope="module")
def lens() -> dp.Lens:
    return dp.Lens("tessar-50mm-f2.8")


def test_a_lens_focuses_parallel_rays(lens: dp.Lens) -> None:
    bench = lens.bench(aperture="f/8")
    info = bench.info()
    assert info["effective_focal_length_mm"] == pytest.approx(49.9966, abs=0.02)
    assert info["f_number"] == pytest.approx(8.0, rel=1e-6)
    # A bundle through a small part of the pupil, and one ray far outside.
    height = np.linspace(-1.0, 1.0, 101)
    positions = np.stack([0 * height, height, 0 * height - 20], axis=1)
    positions = np.vstack([positions, [[0, 500.0, -20]]])
    directions = np.broadcast_to([0.0, 0.0, 2.0], positions.shape)
    rays = bench.trace(positions, directions)
    assert rays.passed[:-1].all() and not rays.passed[-1] and np.isnan(rays.positions[-1]).all()
    np.testing.assert_allclose(np.linalg.norm(rays.directions[:-1], axis=1), 1.0)
    # On the film within hundredths, and the slope is height over focal length.
    assert np.abs(rays.positions[:-1, 1]).max() < 0.02
    slope = rays.directions[:-1, 1] / rays.directions[:-1, 2]
    np.testing.assert_allclose(-slope[[0, -1]] * info["effective_focal_length_mm"], height[[0, -1]], rtol=2e-3)
    light = bench.trace(positions, directions, light=True)
    assert 0.7 < light.transmittance[50] < 1.0 and light.transmittance[-1] == 0.0


def test_rays_run_back_as_they_came(lens: dp.Lens) -> None:
    bench = lens.bench()
    positions = np.array([[0.0, 3.0, -20.0], [2.0, -1.0, -20.0]])
    directions = np.array([[0.0, 0.05, 1.0], [0.02, 0.0, 1.0]])
    there = bench.trace(positions, directions, until_film=False)
    back = bench.trace(there.positions, -there.directions, to="object")
    expected = -directions / np.linalg.norm(directions, axis=1)[:, None]
    np.testing.assert_allclose(back.directions, expected, atol=1e-9)


def test_single_precision_is_close_to_double_and_threads_change_nothing(lens: dp.Lens) -> None:
    bench = lens.bench()
    rng = np.random.default_rng(1)
    positions = np.column_stack([rng.uniform(-4, 4, (5000, 2)), np.full(5000, -20.0)])
    directions = np.column_stack([rng.uniform(-0.1, 0.1, (5000, 2)), np.ones(5000)])
    nm = rng.uniform(420, 680, 5000)
    double = bench.trace(positions, directions, nm)
    one = bench.trace(positions, directions, nm, threads=1)
    np.testing.assert_array_equal(double.positions, one.positions)
    single = bench.trace(*(a.astype(np.float32) for a in (positions, directions, nm)))
    assert single.positions.dtype == np.float32
    both = single.passed & double.passed
    assert (single.passed == double.passed).mean() > 0.999 and 0.5 < both.mean() < 1.0
    # Single precision holds micrometres of tens of millimetres.
    assert np.abs(single.positions[both] - double.positions[both]).max() < 0.01


def test_the_bench_agrees_with_the_command_line(lens: dp.Lens) -> None:
    spots = dp.command("lens", "spot", "tessar-50mm-f2.8", "--field", "0,10", "--wavelength", "550", "--rays", "16")
    for told in spots:
        spot = lens.bench().spot(told["field_deg"], 550.0, rays_across=16)
        assert spot.rms_mm == pytest.approx(told["rms_mm"], rel=1e-9)
        assert len(spot.points_mm) == len(told["points_mm"])


def test_analyses(lens: dp.Lens) -> None:
    bench = lens.bench(aperture="f/8", focus="3 m")
    mtf = bench.mtf(np.array([0.0, 10.0, 50.0]))
    assert mtf.tangential[0] == pytest.approx(1.0, abs=1e-6) and 0 < mtf.tangential[2] < mtf.tangential[1] < 1
    distortion = bench.distortion([0.0, 10.0, 20.0])
    assert distortion.height_mm.shape == (3,) and abs(distortion.distortion_percent[1]) < 3
    vignetting = bench.vignetting([0.0, 10.0, 20.0])
    assert (np.diff(vignetting.geometric_sr) < 0).all() and (vignetting.with_losses_sr < vignetting.geometric_sr).all()
    with pytest.raises(dp.DiopterError, match="opens no wider"):
        lens.bench(aperture="f/1")
    with pytest.raises(dp.DiopterError, match="300 to 2500"):
        bench.info(100)
    with pytest.raises(dp.DiopterError) as e:
        bench.trace(np.zeros((3, 2)), np.zeros((3, 2)))
    assert e.value.place == "positions"


def test_a_prescription_is_text(lens: dp.Lens) -> None:
    again = dp.Lens(lens.to_toml())
    assert again == lens and again.info() == lens.info()
    with pytest.raises(dp.DiopterError, match="prescription.toml"):
        dp.Lens("name = 1\nnonsense")


def test_bodies() -> None:
    body = dp.Body("nikon-d850")
    assert "nikon-d850" in dp.Body.names() and body.pixels == (8256, 5504)
    qe = body.quantum_efficiency([450, 550, 650])
    assert qe.shape == (len(body.channels), 3) and 0 < qe.max() < 1
    report = body.emva(iso=100, channel=1, size=(64, 64), stack=8)
    measured, sheet = report["measured"], report["sheet"]
    # 64 × 64 pixels, 8 pictures: some percent.
    assert measured["gain_dn_per_e"] == pytest.approx(sheet["gain_dn_per_e"], rel=0.1)
    assert len(report["points"]) > 10
