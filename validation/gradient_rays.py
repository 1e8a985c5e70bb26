"""Skew rays through graded glass, by diopter and by SciPy: places, directions and optical paths at the surface behind it.

    pip install scipy
    python validation/gradient_rays.py DIOPTER

Six media (both forms of the sums, radial, axial and both, converging and diverging) between a curved front and a curved back. SciPy integrates the ray equation
d²r/dt² = ½ ∇n² and the path ∫ n² dt by DOP853 (Hairer, Nørsett & Wanner 1993) with a tolerance of 1e-13, from the refracted ray that `lens trace` states at the front to
where it meets the back; refraction there is Snell's law in vectors. diopter's scheme (Sharma, Kumar & Ghatak 1982) is another one, of the fourth order.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

FRONT, BACK, THICKNESS = 40.0, -35.0, 12.0
# Whether the sums are of n², radial and axial coefficients, index of the glass.
MEDIA = {
    "Selfoc rod": (True, [-0.012], [], 1.60),
    "rod with a fourth power": (True, [-0.012, 3e-5, -1e-7], [], 1.60),
    "Wood lens": (False, [-0.004, 1e-5], [], 1.65),
    "diverging": (False, [0.0008], [], 1.55),
    "axial": (False, [], [0.01, -2e-4], 1.70),
    "radial and axial": (True, [-0.008, 2e-5], [0.02, 1e-4], 1.62),
}
RAYS = [(0, 0.9, 0.0), (0, 0.4, -0.7), (8, 0.0, 0.0), (8, 0.6, 0.5), (15, -0.5, -0.6), (15, 0.7, 0.2)]


def squared_index(medium, p):
    """n² and half its gradient."""
    squared, radial, axial, n0 = medium
    r2, z = p[0] ** 2 + p[1] ** 2, p[2]
    total = sum(a * r2 ** (i + 1) for i, a in enumerate(radial)) + sum(a * z ** (i + 1) for i, a in enumerate(axial))
    by_r2 = sum(a * (i + 1) * r2**i for i, a in enumerate(radial))
    by_z = sum(a * (i + 1) * z**i for i, a in enumerate(axial))
    gradient = np.array([2 * p[0] * by_r2, 2 * p[1] * by_r2, by_z])
    if squared:
        return n0**2 + total, 0.5 * gradient
    n = n0 + total
    return n * n, n * gradient


def through(medium, point, direction):
    """Place at the back, direction behind it and path within the medium."""

    def slope(_, state):
        n2, half = squared_index(medium, state[:3])
        return np.concatenate([state[3:6], half, [n2]])

    def back(_, state):
        x, y, z = state[:3]
        u = z - THICKNESS
        return x * x + y * y + u * u - 2 * BACK * u

    back.terminal = True
    # Past the vertex of the back the function changes its sign once.
    back.direction = 0
    n = np.sqrt(squared_index(medium, point)[0])
    start = np.concatenate([point, n * direction, [0.0]])
    found = solve_ivp(slope, [0, 40], start, method="DOP853", rtol=1e-13, atol=1e-14, events=back, max_step=0.5)
    # The event's place is read off an interpolation: one more integration up to its time.
    t = found.t_events[0][0]
    for _ in range(3):
        end = solve_ivp(slope, [0, t], start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        x, y, z = end[:3]
        along = 2 * (x * end[3] + y * end[4] + (z - THICKNESS - BACK) * end[5])
        t -= back(0, end) / along
    n = np.sqrt(squared_index(medium, end[:3])[0])
    d = end[3:6] / n
    normal = (end[:3] - [0, 0, THICKNESS + BACK]) / BACK
    normal *= np.sign(d @ normal)
    cosine = d @ normal
    bent = n * d + (np.sqrt(1 - n * n * (1 - cosine**2)) - n * cosine) * normal
    return end[:3], bent, end[6]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("diopter")
    program = parser.parse_args().diopter
    print("| medium | rays | places, mm | directions | paths, mm |\n|---|---|---|---|---|")
    for name, medium in MEDIA.items():
        squared, radial, axial, n0 = medium
        gradient = f"squared = {str(squared).lower()}"
        gradient += f", radial = {radial}" if radial else ""
        gradient += f", axial = {axial}" if axial else ""
        text = (
            'name = "graded"\nimage_circle = 10\nsurfaces = [\n'
            f'  {{ radius = {FRONT}, gap = {THICKNESS}, glass = "{n0}", semi_diameter = 4, stop = true, gradient = {{ {gradient} }} }},\n'
            f"  {{ radius = {BACK}, gap = 40, semi_diameter = 8 }},\n]\n"
        )
        worst = np.zeros(3)
        with tempfile.TemporaryDirectory() as folder:
            lens = Path(folder) / "graded.toml"
            lens.write_text(text)
            for field, x, y in RAYS:
                command = [program, "lens", "trace", str(lens), "--field", str(field), f"--pupil={x},{y}", "--json"]
                told = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
                front, back = told["surfaces"]
                place, direction, path = through(medium, np.array(front["point_mm"]), np.array(front["direction"]))
                worst = np.maximum(
                    worst,
                    [
                        np.abs(place - back["point_mm"]).max(),
                        np.abs(direction - back["direction"]).max(),
                        abs(path - back["path_mm"]),
                    ],
                )
        print(f"| {name} | {len(RAYS)} | {worst[0]:.1e} | {worst[1]:.1e} | {worst[2]:.1e} |")


if __name__ == "__main__":
    main()
