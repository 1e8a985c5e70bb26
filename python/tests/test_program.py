"""The program in the wheel, processes and signals."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import diopter as dp


def test_the_program_is_there(tmp_path: Path) -> None:
    run = subprocess.run([sys.executable, "-m", "diopter", "--help"], capture_output=True, text=True)
    assert run.returncode == 0 and "shoot" in run.stdout
    run = subprocess.run([sys.executable, "-m", "diopter", "shoot", "--spp", "many"], capture_output=True, text=True)
    assert run.returncode == 2 and "--spp" in run.stderr
    shot = dp.command("shoot", "--size", "24x16", "--spp", "1", "-o", "a.jpg", cwd=tmp_path)
    assert shot["size"] == [24, 16] and (tmp_path / "a.jpg").exists()
    with pytest.raises(dp.DiopterError) as e:
        dp.command("shoot", "--lens", "panorame")
    assert e.value.place == "lens" and e.value.hint is not None
    assert "cornell" in str(dp.command("scene", "list"))


def test_the_program_exposes_the_same_bits(tmp_path: Path) -> None:
    flags = ["--size", "24x16", "--spp", "4", "--shutter", "1/60", "--seed", "7", "--body", "nikon-d850"]
    dp.command("expose", "cornell", *flags, "-o", "a.exr", cwd=tmp_path)
    plane = dp.expose(dp.Scene.builtin("cornell"), dp.Camera(body="nikon-d850"), size=(24, 16), spp=4, shutter="1/60", seed=7)
    np.testing.assert_array_equal(dp.FocalPlane.load(tmp_path / "a.exr").mean, plane.mean)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_stops_an_exposure() -> None:
    # Processes in the background of a shell begin with the signal ignored, and Python leaves it so.
    text = (
        "import signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "import diopter as dp\n"
        "print('begun', flush=True)\n"
        "try:\n    dp.expose(size=(3000, 2000), spp=4096, shutter=0.01)\n"
        "except KeyboardInterrupt:\n    print('stopped', flush=True)\n"
    )
    with subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "begun\n"
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        answer, _ = process.communicate(timeout=60)
        assert answer == "stopped\n" and process.returncode == 0


def _mean(seed: int) -> float:
    return float(dp.expose(dp.Scene.builtin("cornell"), size=(12, 8), spp=2, shutter=0.1, seed=seed).mean.mean())


@pytest.mark.skipif(sys.platform != "linux", reason="processes that are forked")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_works_after_its_parent_has() -> None:
    here = [_mean(seed) for seed in (1, 2)]
    with multiprocessing.get_context("fork").Pool(2) as pool:
        there = pool.map_async(_mean, (1, 2)).get(timeout=60)
    assert there == here
