"""Tolerances and the optimiser beside Optiland: sensitivities, the spread of builds, and the same merit made smaller.

    pip install optiland prysm scipy
    python validation/tolerance_peers.py DIOPTER [--builds 100] [--iterations 50]

The triplet of `lens list` at f/5.6, three fields, 587.56 nm, all radii ±0.5 %, all gaps ±0.05 mm. Optiland's lens is built as `wavefront_peers.py` does it; its perturbations are its own
(`Tolerancing`, `SensitivityAnalysis`, `MonteCarlo`), its spots by 24 rings of equal area with 24 rays each (of its hexapolar rings the outermost stands on the edge of the pupil, which
makes spots of spherical aberration a tenth larger). The optimiser's merit is the sum of the mean square spots of three fields with the focal length held at 50 mm, all curvatures and the film free; both results are measured by diopter.
"""

import argparse
import json
import math
import tempfile
import time
import tomllib
import warnings
from pathlib import Path

import numpy as np
from wavefront_peers import NM, optic_of, run

warnings.simplefilter("ignore")

LENS, F_NUMBER, FIELDS = "triplet-50mm-f4", 5.6, (0, 7, 12)
RADIUS_PERCENT, GAP_MM = 0.5, 0.05
RINGS = 24
# Of the yield, mm.
MOST_EFL = 0.4


def sheet() -> str:
    return (
        f'lens = "{LENS}"\naperture = {F_NUMBER}\nfields_deg = {list(FIELDS)}\nwavelengths_nm = [{NM}]\n'
        f'[[tolerance]]\nradius = "{RADIUS_PERCENT}%"\n[[tolerance]]\nthickness = {GAP_MM}\n'
    )


def plain_optic(program: str):
    """The lens in Optiland with rays aimed at the paraxial entrance pupil: aiming at the stop takes it minutes here."""
    optic = optic_of(program, LENS, F_NUMBER, FIELDS)
    optic.set_ray_aiming("paraxial")
    return optic


def rings_of_equal_area(rings: int):
    """Rays of the pupil that stand for the same area each."""
    from optiland.distribution import BaseDistribution

    class Given(BaseDistribution):
        def generate_points(self, num_points):
            raise NotImplementedError

    radius = np.sqrt((np.arange(rings) + 0.5) / rings)
    angle = (np.arange(24) + 0.5) / 24 * math.tau
    given = Given()
    given.x, given.y = np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()
    return given


def operands(problem, optic, rings: int, weight: float = 1.0, target=None) -> None:
    rays = rings_of_equal_area(rings)
    for field in FIELDS:
        data = {"optic": optic, "surface_number": -1, "Hx": 0, "Hy": field / max(FIELDS), "num_rays": 1, "wavelength": NM * 1e-3}
        problem.add_operand("rms_spot_size", input_data={**data, "distribution": rays}, target=target, weight=weight)


def tolerancing(program: str, sampler):
    """Optiland's lens with the perturbations of the sheet; `sampler(middle, half)` makes their samplers."""
    from optiland.tolerancing.core import Tolerancing

    optic = plain_optic(program)
    problem = Tolerancing(optic)
    problem.add_operand("f2", input_data={"optic": optic})
    operands(problem, optic, RINGS)
    surfaces = tomllib.loads(run(program, "lens", "convert", LENS))["surfaces"]
    for i, s in enumerate(surfaces):
        if "radius" in s:
            half = abs(s["radius"]) * RADIUS_PERCENT / 100
            problem.add_perturbation("radius", sampler(s["radius"], half), surface_number=i + 1)
    for i, s in enumerate(surfaces[:-1]):
        problem.add_perturbation("thickness", sampler(s["gap"], GAP_MM), surface_number=i + 1)
    return problem


def sensitivities(program: str, told: dict) -> None:
    from optiland.tolerancing.perturbation import RangeSampler
    from optiland.tolerancing.sensitivity_analysis import SensitivityAnalysis

    problem = tolerancing(program, lambda middle, half: RangeSampler(middle - half, middle + half, 2))
    perturbations, tables = problem.perturbations, []
    # It takes six at a time.
    for first in range(0, len(perturbations), 6):
        problem.perturbations = perturbations[first : first + 6]
        analysis = SensitivityAnalysis(problem)
        analysis.run()
        tables.append(analysis.get_results().iloc[:, 2:6].to_numpy(dtype=float))
    values = np.concatenate(tables).reshape(-1, 2, 4)
    theirs = 0.5 * (values[:, 1] - values[:, 0])
    index = [k for k, q in enumerate(told["quantities"]) if q["quantity"] in ("efl", "spot")]
    parts = told["perturbations"]
    ours = np.array([[0.5 * (p["plus"][k] - p["minus"][k]) for k in index] for p in parts])
    ours[:, 1:] *= 1e-3
    # A longer radius is its algebraic increase in Optiland; in diopter, too.
    print(f"{len(parts)} perturbations, half differences: largest, and largest difference from Optiland's")
    for k, name in enumerate(["efl, mm", *(f"spot at {f}°, mm" for f in FIELDS)]):
        size, off = np.abs(ours[:, k]).max(), np.abs(ours[:, k] - theirs[:, k]).max()
        print(f"  {name}: {size:.3e}, {off:.1e} ({100 * off / size:.2f} %)")


def spread(program: str, told: dict, builds: int) -> None:
    from optiland.tolerancing.monte_carlo import MonteCarlo
    from optiland.tolerancing.perturbation import DistributionSampler

    numbers = iter(range(1000))
    make = lambda middle, half: DistributionSampler("uniform", seed=next(numbers), low=middle - half, high=middle + half)  # noqa: E731
    study = MonteCarlo(tolerancing(program, make))
    start = time.process_time()
    study.run(builds)
    seconds = time.process_time() - start
    values = study.get_results()[study.operand_names].to_numpy(dtype=float)
    index = [k for k, q in enumerate(told["quantities"]) if q["quantity"] in ("efl", "spot")]
    print(f"Optiland: {builds} builds in {seconds:.1f} s of processor time; mean and deviation, diopter's beside")
    for k, name in enumerate(["efl, mm", *(f"spot at {f}°, mm" for f in FIELDS)]):
        q = told["quantities"][index[k]]
        unit = 1e-3 if k else 1.0
        mean, deviation = values[:, k].mean(), values[:, k].std(ddof=1)
        print(f"  {name}: {mean:.5f} {deviation:.5f}; {q['mean'] * unit:.5f} {q['deviation'] * unit:.5f}")
    ours = np.array(told["builds"])[:, index] * [1.0, *(1e-3 for _ in FIELDS)]
    for limit in (0.02, 0.03, 0.04):
        good = lambda v: (np.abs(v[:, 0] - 50) <= MOST_EFL) & (v[:, 1:] <= limit).all(axis=1)  # noqa: E731
        theirs, mine = good(values).mean(), good(ours).mean()
        error = math.sqrt(mine * (1 - mine) * (1 / len(values) + 1 / len(ours)))
        print(f"yield, efl within {MOST_EFL} mm and all spots below {limit} mm: {theirs:.3f}; {mine:.3f}; {(theirs - mine) / error:+.1f} standard errors")


MERIT = """
aperture = {f}
fields_deg = {fields}
wavelengths_nm = [{nm}]
[[variable]]
surfaces = [{curved}]
what = "curvature"
[[variable]]
surfaces = {last}
what = "gap"
min = 30
max = 60
[[operand]]
kind = "spot"
[[operand]]
kind = "efl"
target = 50
weight = 1e7
"""


def spots(program: str, lens: str) -> list:
    flags = ["--aperture", str(F_NUMBER), "--wavelength", str(NM), "--json", "--field", ",".join(map(str, FIELDS))]
    told = json.loads(run(program, "lens", "spot", lens, *flags))
    efl = json.loads(run(program, "lens", "info", lens, "--wavelength", str(NM), "--json"))["effective_focal_length_mm"]
    return [s["rms_mm"] * 1e3 for s in told] + [efl]


def optimisers(program: str, iterations: int) -> None:
    from optiland.optimization import LeastSquares, OptimizationProblem

    text = run(program, "lens", "convert", LENS)
    surfaces = tomllib.loads(text)["surfaces"]
    curved = [i + 1 for i, s in enumerate(surfaces) if "radius" in s]
    with tempfile.TemporaryDirectory() as folder:
        merit, ours = Path(folder, "merit.toml"), Path(folder, "ours.toml")
        numbers = ", ".join(map(str, curved))
        merit.write_text(f'lens = "{LENS}"\n' + MERIT.format(f=F_NUMBER, fields=list(FIELDS), nm=NM, curved=numbers, last=len(surfaces)))
        import resource

        start = resource.getrusage(resource.RUSAGE_CHILDREN)
        run(program, "lens", "optimise", str(merit), "-o", str(ours))
        end = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(f"start: spots and efl {np.round(spots(program, LENS), 3)}")
        print(f"diopter: {end.ru_utime - start.ru_utime:.2f} s, spots and efl {np.round(spots(program, str(ours)), 3)}")
        optic = plain_optic(program)
        problem = OptimizationProblem()
        problem.add_operand("f2", target=50, weight=10, input_data={"optic": optic})
        operands(problem, optic, 6, weight=math.sqrt(1e3), target=0)
        for i in curved:
            problem.add_variable(optic, "radius", surface_number=i)
        problem.add_variable(optic, "thickness", surface_number=len(surfaces))
        begin = time.process_time()
        LeastSquares(problem).optimize(maxiter=iterations, tol=1e-9)
        seconds = time.process_time() - begin
        sheet = tomllib.loads(text)
        rows = []
        for i, s in enumerate(sheet["surfaces"]):
            surface = optic.surfaces[i + 1]
            radius = f"radius = {float(surface.geometry.radius)!r}, " if "radius" in s else ""
            gap = float(optic.surfaces.get_thickness(i + 1)[0]) if i + 1 == len(sheet["surfaces"]) else s["gap"]
            rest = "".join(f", {k} = {json.dumps(s[k])}" for k in ("glass", "semi_diameter", "stop") if k in s)
            rows.append(f"  {{ {radius}gap = {gap!r}{rest} }},\n")
        theirs = Path(folder, "theirs.toml")
        theirs.write_text('name = "theirs"\nf_number = 4\nsurfaces = [\n' + "".join(rows) + "]\n")
        print(f"Optiland: {seconds:.2f} s, spots and efl {np.round(spots(program, str(theirs)), 3)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--builds", type=int, default=100)
    parser.add_argument("--iterations", type=int, default=50, help="most evaluations of Optiland's optimiser, derivatives not counted")
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "sheet.toml")
        path.write_text(sheet())
        told = json.loads(run(a.program, "lens", "tolerance", str(path), "-n", "1000", "--json"))
    sensitivities(a.program, told)
    spread(a.program, told, a.builds)
    optimisers(a.program, a.iterations)


if __name__ == "__main__":
    main()
