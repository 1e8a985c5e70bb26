"""The noise of a sensor: photon transfer by hand, beside EMVA 1288 and the data sheet.

    python sensor_noise.py [body]
"""

from __future__ import annotations

import sys

import numpy as np

import diopter as dp


def main(name: str = "nikon-d850", size: int = 256) -> tuple[float, float]:
    body = dp.Body(name)
    step = body.iso_steps[0]
    levels = np.geomspace(3e-3, 0.6, 8)
    means, variances, full = [], [], 0.0
    for lux_seconds in levels:
        # Even light on the sensor; two read-outs tell the noise of time from the fixed pattern.
        light = np.full((size, size, 3), lux_seconds / 0.01)
        plane = dp.FocalPlane.from_irradiance(light, body, shutter="10 ms")
        pair = [dp.read_out(plane, body, iso=step.iso, seed=seed) for seed in (1, 2)]
        # One channel of the mosaic.
        row, column = np.argwhere(pair[0].pattern == 1)[0]
        step_y, step_x = pair[0].pattern.shape
        a, b = (raw.mosaic[row::step_y, column::step_x].astype(float) for raw in pair)
        means.append((a.mean() + b.mean()) / 2 - pair[0].black_level)
        variances.append(np.var(a - b) / 2)
        full = pair[0].white_level - pair[0].black_level
        print(f"{lux_seconds:8.4f} lx s: {means[-1]:9.1f} DN, variance {variances[-1]:9.1f} DN²")
    # Variance over signal is the gain (DN/e⁻); what remains in the dark is read noise.
    free = np.array(means) < 0.7 * full
    gain = float(np.polyfit(np.array(means)[free], np.array(variances)[free], 1, w=1 / np.array(variances)[free])[0])
    sheet = step.gain_e_per_dn
    report = body.emva(iso=step.iso, channel=1, size=(128, 128), stack=16)
    print(f"gain: {1 / gain:.3f} e⁻/DN by hand, {1 / report['measured']['gain_dn_per_e']:.3f} by EMVA 1288, {sheet:.3f} by the sheet")
    print(f"dark noise: {report['measured']['dark_noise_e']:.2f} e⁻, dynamic range {report['measured']['dynamic_range']:.0f}")
    return 1 / gain, sheet


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(sys.argv[1])
    else:
        main()
