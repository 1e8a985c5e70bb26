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
    with pytest.raises(dp.DiopterError, match="100 to 20000"):
        bench.info(50)
    glass = "{ radius = 50, gap = 4, glass = 'N-BK7', semi_diameter = 8, stop = true }"
    singlet = dp.Lens(f"name = 'singlet'\nsurfaces = [{glass}, {{ radius = -50, gap = 45, semi_diameter = 8 }}]\n")
    with pytest.raises(dp.DiopterError, match="have an index"):
        singlet.info(140)
    with pytest.raises(dp.DiopterError, match="have an index"):
        singlet.trace(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), 140.0)
    # Beyond the visible rays bend as the glass says, not as a fit of the visible goes on.
    for nm in (330.0, 1550.0):
        ray = singlet.trace(np.array([[0.0, 1e-3, -1.0]]), np.array([[0.0, 0.0, 1.0]]), nm)
        efl = -1e-3 / (ray.directions[0, 1] / ray.directions[0, 2])
        assert efl == pytest.approx(singlet.info(nm)["effective_focal_length_mm"], rel=1e-6)
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


def test_a_wavefront_and_its_zernikes_are_those_of_the_program(lens: dp.Lens) -> None:
    bench = lens.bench(aperture="f/8")
    wave = bench.wavefront(7.0, 587.56, rays_across=32)
    told = dp.command(
        "lens", "wavefront", "tessar-50mm-f2.8", "--aperture", "8", "--field", "7", "--wavelength", "587.56", "--rays", "32", "--terms", "21"
    )[0]
    np.testing.assert_allclose(np.column_stack([wave.pupil, wave.opd]), told["samples"], atol=1e-12)
    assert wave.rms_without_tilt == pytest.approx(told["rms_without_tilt_waves"])
    found = wave.zernikes(21)
    np.testing.assert_allclose(found.coefficients, told["zernikes_waves"], atol=1e-12)
    assert found.degrees[10] == (4, 0) and found.names[10] == "spherical"
    # The map holds the same rays; rows from the top: coma along y tells up from down.
    assert wave.map.shape == (32, 32) and np.isfinite(wave.map).sum() == len(wave.opd)
    row, column = np.argwhere(np.isfinite(wave.map))[0]
    top = wave.opd[wave.pupil[:, 1] > wave.pupil[:, 1].max() - 0.02]
    assert np.abs(top - wave.map[row, column]).min() < 1e-5
    # Defocus of the fringe set is 2ρ² − 1, half a wave at the edge from the mean.
    r2 = (wave.pupil**2).sum(axis=1)
    fringe = wave._replace(opd=0.7 * (2 * r2 - 1)).zernikes(4, order="fringe")
    np.testing.assert_allclose(fringe.coefficients, [0, 0, 0, 0.7], atol=1e-12)
    with pytest.raises(dp.DiopterError, match="noll"):
        wave.zernikes(4, order="born")
    with pytest.raises(dp.DiopterError, match="1 to 37"):
        wave.zernikes(38, order="fringe")


def test_images_of_points_hold_their_light_where_they_say(lens: dp.Lens) -> None:
    bench = lens.bench(aperture="f/8")
    radii = [0.001, 0.01, 0.02]
    psf = bench.psf(10.0, 550.0, radii_mm=radii)
    assert psf.strehl is not None and 0.1 < psf.strehl < 1.0 and not psf.geometric
    assert 0.97 < psf.values.sum() <= 1.0
    # Rows run downwards: the centroid of the pixels is that of the rays, to what diffraction scatters out of the image.
    x, y = np.meshgrid(psf.x_mm, psf.y_mm)
    near = np.hypot(x, y) < 0.08
    mean = np.array([(psf.values * x)[near].sum(), (psf.values * y)[near].sum()]) / psf.values[near].sum()
    np.testing.assert_allclose(mean, psf.centroid_mm, atol=2e-4)
    # Light within a circle by counting pixels: their steps leave some percent of a small one.
    for radius, energy in zip(radii[1:], psf.encircled_energy[1:]):
        inside = np.hypot(x - psf.centroid_mm[0], y - psf.centroid_mm[1]) <= radius
        assert psf.values[inside].sum() == pytest.approx(energy, abs=0.02)
    assert (np.diff(psf.encircled_energy) > 0).all()
    small = bench.psf(10.0, 550.0, pixels=32)
    assert small.values.shape == (32, 32) and small.x_mm[16] == 0.0 == small.y_mm[15]
    side = len(psf.x_mm)
    np.testing.assert_array_equal(small.values, psf.values[side // 2 - 16 : side // 2 + 16, side // 2 - 16 : side // 2 + 16])
    spot = bench.psf(10.0, 550.0, geometric=True, pixel_um=0.5)
    assert spot.geometric and spot.strehl is None and spot.values.sum() == pytest.approx(1.0)
    with pytest.raises(dp.DiopterError, match="pixels 4"):
        bench.psf(pixels=4)


SHEET = """
fields_deg = [0, 10]
wavelengths_nm = [587.56]
[compensator]
refocus = 0.5
decenter = [{ element = [6, 8], by = 0.2, axis = "y" }]
[[tolerance]]
elements = [[3, 4]]
decenter = 0.02
[[tolerance]]
surfaces = 1
radius = "0.1%"
[[limit]]
quantity = "mtf"
at_least = 0.3
"""


def test_builds_are_arrays_and_lenses(lens: dp.Lens) -> None:
    found = lens.tolerances(SHEET, builds=8, seed=3)
    assert found.builds.shape == (8, len(found.quantities)) and found.plus.shape == (3, len(found.quantities))
    assert [p.name for p in found.perturbations][2] == "radius of surface 1"
    assert found.yield_fraction == found.good.mean()
    # The compensator answers a decentre in y, one way for one end; one in x acts alike at both. It is set in the design, too, whose fields lie on one side.
    index = [q.name for q in found.quantities].index("compensator, decentre of element 6-8 in y")
    assert found.quantities[index].unit == "mm"
    by_x, by_y = [(found.plus[k, index], found.minus[k, index]) for k in (0, 1)]
    assert by_x[0] == pytest.approx(by_x[1], abs=1e-6)
    assert by_y[0] - by_x[0] == pytest.approx(by_x[0] - by_y[1], rel=0.05) and abs(by_y[0] - by_x[0]) > 0.01
    built = lens.build(SHEET, 5, seed=3)
    assert built != lens and "build 5" in built.name
    # A row is that lens: its focal length.
    assert built.info(587.56)["effective_focal_length_mm"] == pytest.approx(found.column("efl")[5], abs=1e-6)
    with pytest.raises(dp.DiopterError, match="expected one of"):
        found.column("efll")
    with pytest.raises(dp.DiopterError, match="radus"):
        lens.tolerances(SHEET.replace("radius", "radus"), builds=1)


def test_optimised_and_fitted_lenses_come_back(lens: dp.Lens) -> None:
    merit = """
fields_deg = [0, 8]
wavelengths_nm = [587.56]
[[variable]]
surfaces = 8
what = "curvature"
[[operand]]
kind = "efl"
target = 52
"""
    better = lens.optimise(merit, iterations=30)
    assert better.merits[0] is not None and better.merits[1] < 1e-6 * better.merits[0]
    assert better.lens.info(587.56)["effective_focal_length_mm"] == pytest.approx(52, abs=1e-4)
    assert better.variables[0][0].startswith("curvature") and better.operands[0][3] == pytest.approx(52, abs=1e-4)
    # A lens 2 % larger, from the heights that it images fields at.
    scale = 1.02
    heights = lens.bench(focus="inf").distortion([5, 10, 15], 587.56).height_mm * scale
    rows = ",".join(f"{{ field_deg = {f}, height_mm = {h} }}" for f, h in zip([5, 10, 15], heights))
    measured = f'wavelengths_nm = [587.56]\n[[variable]]\nwhat = "scale"\n[distortion]\nrows = [{rows}]\n'
    fitted = lens.fit(measured)
    assert fitted.numbers[0].name == "scale" and fitted.numbers[0].value == pytest.approx(scale, abs=1e-5)
    np.testing.assert_allclose(fitted.predicted, fitted.measured, atol=1e-4)
    assert fitted.lens.info(587.56)["effective_focal_length_mm"] == pytest.approx(
        scale * lens.info(587.56)["effective_focal_length_mm"], rel=1e-4
    )
    assert fitted.degrees_of_freedom == 2 and fitted.correlations.shape == (1, 1)
