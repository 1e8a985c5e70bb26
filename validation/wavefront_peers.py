"""Wavefronts of ten lenses, by diopter and by Optiland, prysm and poppy: path differences ray by ray, Zernike coefficients, Strehl ratios, the Airy pattern.

    pip install optiland prysm poppy OpenEXR scipy
    python validation/wavefront_peers.py DIOPTER [--markdown table.md] [--only NAME]

Each lens is built in Optiland from what `lens convert` writes (radii, gaps, conics, aspheres) with the indices of glass that `lens trace` passes through, at 587.56 nm. Its stop has the
radius at which diopter's edge ray of the axial beam crosses it, and Optiland's robust ray aiming sends rays through the places of the stop that `lens wavefront` names. Path differences
are compared ray by ray; prysm's Noll terms are fitted to Optiland's by numpy; Strehl ratios come of Optiland's path differences over image-space direction cosines, propagated by
prysm. The Airy pattern of a parabolic mirror is compared with prysm's and poppy's closed forms.
"""

import argparse
import json
import math
import re
import subprocess
import sys
import tempfile
import tomllib
import warnings
from pathlib import Path

import numpy as np

warnings.simplefilter("ignore")

NM = 587.56
TERMS = 37
RAYS = 64
# Name, f-number, fields in degrees.
LENSES = [
    ("double-gauss-50mm", 5.6, (0, 7, 12)),
    ("tessar-50mm-f2.8", 8, (0, 7, 12)),
    ("triplet-50mm-f4", 8, (0, 7, 12)),
    ("heliar-105mm-f3.5", 11, (0, 5, 8)),
    ("cooke-triplet-25mm-f3", 8, (0, 7, 12)),
    ("planar-50mm-f1.4", 5.6, (0, 7, 12)),
    ("petzval-100mm", 8, (0, 3, 5)),
    ("summicron-50mm-f2", 8, (0, 7, 12)),
    ("apo-summicron-35mm-f2", 11, (0, 3, 6)),
    ("rf-16mm-f2.8", 5.6, (0, 15, 30)),
]


def run(program: str, *arguments: str):
    done = subprocess.run([program, *arguments], capture_output=True, text=True, timeout=300)
    if done.returncode:
        raise SystemExit(f"diopter {' '.join(arguments)}: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout


def traced(program: str, name: str, f: float, field: float, pupil: str) -> dict:
    flags = ["--aperture", str(f), "--field", str(field), "--wavelength", str(NM), "--pupil", pupil, "--json"]
    told = json.loads(run(program, "lens", "trace", name, *flags))
    return told[0] if isinstance(told, list) else told


def optic_of(program: str, name: str, f: float, fields: tuple):
    """The lens in Optiland, its stop, and its prescription."""
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic

    sheet = tomllib.loads(run(program, "lens", "convert", name))
    surfaces = sheet["surfaces"]
    events = traced(program, name, f, 0, "0,1")["surfaces"]
    assert len(events) == len(surfaces), name
    points = [np.array(e["point_mm"]) for e in events]
    # The path from surface to surface over the distance is the index between them.
    index = [1.0] * len(surfaces)
    for i in range(len(surfaces) - 1):
        index[i] = events[i + 1]["path_mm"] / float(np.linalg.norm(points[i + 1] - points[i]))
    stop = next(i for i, s in enumerate(surfaces) if s.get("stop"))
    optic = Optic()
    optic.surfaces.add(index=0, thickness=np.inf)
    for i, s in enumerate(surfaces):
        gap = s["gap"]
        gap = gap["infinity"] if isinstance(gap, dict) else gap
        shape = {"radius": s.get("radius", np.inf), "conic": s.get("conic", 0.0)}
        unknown = set(s) - {"radius", "conic", "asphere", "gap", "glass", "semi_diameter", "stop", "coating"}
        if unknown:
            raise SystemExit(f"{name}: {unknown} of surface {i + 1} are not written for Optiland")
        material = "air" if abs(index[i] - 1) < 1e-9 else IdealMaterial(n=index[i])
        if "asphere" in s:
            powers = {int(k): v for k, v in s["asphere"].items()}
            shape |= {"surface_type": "even_asphere", "coefficients": [powers.get(2 * k, 0.0) for k in range(1, max(powers) // 2 + 1)]}
        optic.surfaces.add(index=i + 1, thickness=gap, material=material, is_stop=i == stop, **shape)
    optic.surfaces.add(index=len(surfaces) + 1)
    for surface in optic.surfaces:
        # Its default leaves 1e-6 mm of an asphere, thousandths of a wave.
        if hasattr(surface.geometry, "tol"):
            surface.geometry.tol = 1e-13
    radius = math.hypot(*points[stop][:2])
    optic.set_aperture(aperture_type="float_by_stop_size", value=2 * radius)
    optic.surfaces[stop + 1].set_semi_aperture(radius)
    optic.set_field_type(field_type="angle")
    for field in fields:
        optic.add_field(y=field)
    optic.add_wavelength(value=NM * 1e-3, is_primary=True)
    optic.set_ray_aiming("robust", max_iter=30, tol=1e-10)
    return optic


def peer_opd(optic, share: float, places: np.ndarray):
    """Optiland's path differences (waves) and directions in image space at places of the stop; `share` of the largest field."""
    from optiland.distribution import BaseDistribution
    from optiland.wavefront import Wavefront

    class Given(BaseDistribution):
        def generate_points(self, num_points):
            raise NotImplementedError

    given = Given()
    given.x, given.y = places[:, 0].copy(), places[:, 1].copy()
    wave = Wavefront(optic, fields=[(0, share)], wavelengths=[NM * 1e-3], distribution=given)
    data = wave.get_data((0, share), NM * 1e-3)
    rays = optic.trace(Hx=0, Hy=share, wavelength=NM * 1e-3, num_rays=None, distribution=given)
    return np.asarray(data.opd), np.stack([np.asarray(rays.L), np.asarray(rays.M)], 1)


def noll_fit(places: np.ndarray, values: np.ndarray) -> np.ndarray:
    from prysm.polynomials import noll_to_nm, zernike_nm

    r, t = np.hypot(places[:, 0], places[:, 1]), np.arctan2(places[:, 1], places[:, 0])
    columns = [zernike_nm(n, m, r, t, norm=True) for n, m in (noll_to_nm(j) for j in range(1, TERMS + 1))]
    return np.linalg.lstsq(np.stack(columns, 1), values, rcond=None)[0]


def strehl(directions: np.ndarray, opd: np.ndarray, edge: np.ndarray) -> float:
    """Largest irradiance over that without aberration: even amplitude over direction cosines within `edge`, moved to the focal plane by prysm."""
    from prysm.propagation import focus_fixed_sampling
    from scipy.spatial import ConvexHull, Delaunay

    middle = 0.5 * (edge.min(0) + edge.max(0))
    half = 0.5 * (edge.max(0) - edge.min(0)).max()
    unit = (directions - middle) / half
    inside = Delaunay(((edge - middle) / half)[ConvexHull(edge).vertices])
    side = 512
    axis = (np.arange(side) - side / 2 + 0.5) / (side / 2) * 1.05
    x, y = np.meshgrid(axis, axis)
    at = np.stack([x.ravel(), y.ravel()], 1)
    lit = inside.find_simplex(at) >= 0
    smooth = polynomial(unit, opd)
    phase = np.where(lit, smooth(at), 0)
    pupil = (lit * np.exp(2j * math.pi * phase)).reshape(side, side)
    # A pupil of 1.05 mm half width at unit distance ratio: only the ratio of the peaks counts; 1024 places over the middle of the image.
    dx = axis[1] - axis[0]
    image = np.abs(focus_fixed_sampling(pupil, dx, 100.0, 0.55, 0.55 * 100 / 2 / 48, 1024)) ** 2
    perfect = np.abs(focus_fixed_sampling(np.abs(pupil), dx, 100.0, 0.55, 0.55 * 100 / 2 / 48, 1024)) ** 2
    return float(image.max() / perfect.max())


def polynomial(places: np.ndarray, values: np.ndarray):
    """A polynomial of degree 14 through values: an interpolation of smooth wavefronts up to the edge."""
    powers = [(i, j) for i in range(15) for j in range(15 - i)]
    cheb = np.polynomial.chebyshev.chebval

    def columns(p):
        unit = np.eye(15)
        tx = [cheb(p[:, 0] / 1.2, unit[i]) for i in range(15)]
        ty = [cheb(p[:, 1] / 1.2, unit[i]) for i in range(15)]
        return np.stack([tx[i] * ty[j] for i, j in powers], 1)

    found = np.linalg.lstsq(columns(places), values, rcond=1e-12)[0]
    return lambda p: columns(p) @ found


def compare(program: str, name: str, f: float, fields: tuple) -> list:
    optic = optic_of(program, name, f, fields)
    flags = ["--aperture", str(f), "--wavelength", str(NM), "--field", ",".join(map(str, fields)), "--json"]
    waves = json.loads(run(program, "lens", "wavefront", name, *flags, "--rays", str(RAYS), "--terms", str(TERMS)))
    images = json.loads(run(program, "lens", "psf", name, *flags))
    rows = []
    for field, wave, image in zip(fields, waves, images):
        samples = np.array(wave["samples"])
        places, ours = samples[:, :2], samples[:, 2]
        theirs, directions = peer_opd(optic, field / max(fields), places)
        inside = np.hypot(*places.T) <= 1 + 1e-9
        # The outermost rays of each sixteenth of the circle: where they stay inside the edge of the stop, a rim clips.
        radius, sector = np.hypot(*places.T), ((np.arctan2(places[:, 1], places[:, 0]) / math.tau) % 1 * 16).astype(int)
        if min(radius[sector == k].max() for k in range(16)) < 1 - 5 / RAYS:
            raise SystemExit(f"{name} at {field}: rims clip its beam; expected a smaller aperture or field")
        ring = np.linspace(0, 2 * math.pi, 256, endpoint=False)
        edge = peer_opd(optic, field / max(fields), np.stack([np.cos(ring), np.sin(ring)], 1))[1]
        ours_fit = np.array(wave["zernikes_waves"])
        theirs_fit = noll_fit(places[inside], theirs[inside])
        # Piston says nothing: it depends on which ray stands for nought.
        rows.append(
            {
                "lens": name,
                "f": f,
                "field": field,
                "rays": len(ours),
                "rms": float(np.sqrt(np.mean((ours - ours.mean()) ** 2))),
                "opd": float(np.abs((ours - theirs) - (ours - theirs).mean()).max()),
                "zernike": float(np.abs(ours_fit - theirs_fit)[1:].max()),
                "strehl": image["strehl"],
                "peer": strehl(directions, theirs, edge),
            }
        )
    return rows


def airy(program: str) -> dict:
    """Largest difference from the Airy pattern within its fifth dark ring, in units of the peak: diopter's image of a parabolic mirror f/8."""
    import OpenEXR
    import poppy
    from prysm.psf import airydisk

    sheet = 'name = "paraboloid"\nsurfaces = [\n  { radius = -400, conic = -1, mirror = true, gap = -200, semi_diameter = 12.5, stop = true },\n]\n'
    with tempfile.TemporaryDirectory() as folder:
        lens, exr = Path(folder) / "paraboloid.toml", Path(folder) / "psf.exr"
        lens.write_text(sheet)
        told = json.loads(run(program, "lens", "psf", str(lens), "--field", "0", "--wavelength", "550", "--json", "-o", str(exr)))[0]
        parts = OpenEXR.File(str(exr)).channels()
        values = next(iter(parts.values())).pixels.astype(float)
    side, pixel = values.shape[0], told["pixel_mm"]
    # The middle of an even number of pixels is the one right of and, from the top, above the middle: where the irradiance is largest.
    row, column = np.unravel_index(values.argmax(), values.shape)
    y, x = np.mgrid[:side, :side]
    r_um = np.hypot(x - column, y - row) * pixel * 1e3
    sine = math.sin(2 * math.atan(12.5 / 400))
    pattern = airydisk(np.maximum(r_um, 1e-9), 1 / (2 * sine), 0.55)
    near = r_um * sine / 0.55 < 2.62
    # poppy's closed form counts in arcseconds of a telescope: one of diameter D = 2 sin u at a distance of 1.
    half = min(row, column, side - 1 - row, side - 1 - column)
    window = np.s_[row - half : row + half + 1, column - half : column + half + 1]
    arcseconds = math.degrees(pixel * 1e-3) * 3600
    theirs = poppy.misc.airy_2d(diameter=2 * sine, wavelength=0.55e-6, shape=(2 * half + 1,) * 2, pixelscale=arcseconds)
    # The exact peak of the irradiance: π sin²u / λ² of all light, a pixel wide.
    peak = math.pi * (sine / 0.55e-3 * pixel) ** 2
    return {
        "prysm": float(np.abs(values / peak - pattern)[near].max()),
        "prysm, shape": float(np.abs(values / values.max() - pattern)[near].max()),
        "poppy": float(np.abs(values[window] / peak - theirs / theirs.max())[near[window]].max()),
        "strehl": told["strehl"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--markdown", type=Path)
    parser.add_argument("--only")
    a = parser.parse_args()
    head = "| lens | f-number | field, ° | rays | wavefront rms, waves | path difference, largest difference | Zernike, largest difference | Strehl | Optiland, prysm |"
    text = head + "\n|" + "---|" * 9 + "\n"
    print(text, end="", flush=True)
    rows = []
    for name, f, fields in LENSES:
        if a.only and a.only != name:
            continue
        for r in compare(a.program, name, f, fields):
            rows.append(r)
            line = (
                f"| {r['lens']} | {r['f']} | {r['field']} | {r['rays']} | {r['rms']:.4f} | {r['opd']:.1e} | {r['zernike']:.1e} "
                f"| {r['strehl']:.4f} | {r['peer']:.4f} |"
            )
            print(line, flush=True)
            text += line + "\n"
    print("Airy:", airy(a.program))
    worst = {k: max(r[k] for r in rows) for k in ("opd", "zernike")}
    worst["strehl"] = max(abs(r["strehl"] - r["peer"]) for r in rows)
    print("worst:", worst)
    if a.markdown:
        a.markdown.write_text(text)
    sys.exit(not (worst["zernike"] < 0.002 and worst["strehl"] < 0.005))


if __name__ == "__main__":
    main()
