"""Our event sensor against the equations of v2e on the same light.

v2e (Hu, Liu & Delbruck 2021, "v2e: From Video Frames to Realistic DVS Events", CVPRW, section 4) in its plain form, written anew from the paper: at each frame the difference of the
logarithm from the memorised level is divided by the threshold and rounded towards zero: so many events; they are spread evenly over the time since the last frame; the level moves by as
many thresholds. The lin-log of 8-bit frames is left out: both get the logarithm of the photocurrent.

Usage: python validation/events_v2e.py DIOPTER [SCENE]    needs numpy, expelliarmus (reads EVT 2.0)
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

THRESHOLD, DARK = 0.2, 1.0  # of the sheet "ideal-events"


def v2e(light, times):
    """Events of each pixel and step: signed counts [step][row][column]."""
    level = np.log(light.astype(np.float64) + DARK)
    memory = level[0].copy()
    counts = []
    for now in level[1:]:
        n = np.trunc((now - memory) / THRESHOLD).astype(int)
        memory += n * THRESHOLD
        counts.append(n)
    return np.array(counts)


def main(diopter, scene):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        command = [diopter, "--json", "events", scene, "--sensor", "ideal-events", "--aperture", "f/2.8", "--size", "160x120", "--spp", "16",
                   "--duration", "40ms", "--step", "2ms", "--keep-light", out / "light.npy", "-o", out / "e.npy", "-o", out / "e.raw", "-o", out / "e.csv"]
        told = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        events, light, times = np.load(out / "e.npy"), np.load(out / "light.npy"), np.array(told["times_s"])
        assert light.shape == (len(times), 120, 160) and len(events) == told["on"] + told["off"]
        text = np.loadtxt(out / "e.csv", delimiter=",", skiprows=1, dtype=int, ndmin=2)
        assert (text == np.stack([events[k].astype(int) for k in "txyp"], axis=1)).all()
        from expelliarmus import Wizard
        raw = Wizard(encoding="evt2").read(out / "e.raw")
        same = all((raw[k].astype(np.int64) == events[k].astype(np.int64)).all() for k in "txyp")
        print(f"{len(events)} events; EVT 2.0 read by expelliarmus: {'the same' if same else 'DIFFERENT'}")
        assert same and len(raw) == len(events)

        counts = v2e(light, times)
        # Stamps are rounded down: an event of the microsecond in which a step ends may be of either step.
        step = np.clip(np.searchsorted(times, events["t"] * 1e-6 + 0.5e-6, side="left") - 1, 0, len(times) - 2)
        ours = np.zeros_like(counts)
        np.add.at(ours, (step, events["y"], events["x"]), np.where(events["p"] == 1, 1, -1))
        total, differ = np.abs(counts).sum(), (ours != counts).sum()
        net = (ours.sum(axis=0) != counts.sum(axis=0)).sum()
        print(f"v2e: {total} events; pixels and steps that differ: {differ} of {counts.size}; pixels whose sums differ: {net} of {counts[0].size}")
        assert abs(total - len(events)) <= 1e-3 * total and differ <= 1e-3 * max(total, 1) and net <= 1e-3 * counts[0].size
        # Times: v2e's k-th of n lies at k / n of the step; ours at most one of n away.
        late = []
        order = np.lexsort((events["t"], events["x"], events["y"], step))
        key = np.stack([step, events["y"], events["x"]], axis=1)[order]
        starts = np.flatnonzero(np.r_[True, (np.diff(key, axis=0) != 0).any(axis=1)])
        for a, b in zip(starts, np.r_[starts[1:], len(order)]):
            n, s = b - a, key[a][0]
            dt = times[s + 1] - times[s]
            stamps = times[s] + dt * np.arange(1, n + 1) / n
            late.extend(np.abs(events["t"][order[a:b]] * 1e-6 - stamps) / (dt / n))
        print(f"stamps: mean distance {np.mean(late):.3f}, largest {np.max(late):.3f} of v2e's spacing")
        assert np.max(late) <= 1.01


main(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "rolling-ball")
