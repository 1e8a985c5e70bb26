"""Engines that schedule work: workers die, tasks fail, the bytes stay."""

from __future__ import annotations

import json
import os
import pickle
import signal
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any, Callable, Iterator

import pytest

import diopter as dp
from diopter._parts import _unpacked, packed, sample_ranges

SPEC: dict[str, Any] = {
    "name": "engines",
    "items": 16,
    "seed": 5,
    "shot": {"scene": {"file": "cornell"}, "exposure": {"shutter": "1/30"}, "render": {"size": "24x16", "spp": 2}},
    "vary": [{"name": "iso", "choice": [100, 400, 1600]}, {"name": "aperture", "range": ["f/2", "f/8"], "scale": "log"}],
    "write": {"files": ["dng", "expected.npy", "mean.npy"], "shard_items": 6},
}
SCENE = dp.Scene("walls").add_quad((-1, 0, -3), [(2, 0, 0), (0, 2, 0)], dp.Material.diffuse(0.5)).set_environment(1000.0)
CAMERA = dp.Camera(lens="thin", body="canon-5d-mark-iv", position=(0, 1, 0), look_at=(0, 1, -3), aperture="f/4")
PICTURE: dict[str, Any] = {"shutter": 0.01, "size": (48, 32), "seed": 2}
SPP, PARTS = 8, 4


@pytest.fixture(scope="module")
def dataset() -> dp.Dataset:
    return dp.Dataset(SPEC)


@pytest.fixture(scope="module")
def expected(dataset: dp.Dataset, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("sets") / "one"
    dataset.make(folder)
    return bytes_of(folder)


@pytest.fixture(scope="module")
def whole() -> bytes:
    """The picture in the same parts, made in this process."""
    parts = [dp.expose(SCENE, CAMERA, spp=SPP, samples=part, **PICTURE) for part in sample_ranges(SPP, PARTS)]
    return pickle.dumps(dp.merge(parts))


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


class Killer:
    """A progress function that kills a worker once, when the first result is there and most are not."""

    def __init__(self, workers: Callable[[], list[int]]) -> None:
        self.workers, self.killed, self.told = workers, list[int](), list[float]()

    def __call__(self, part: float) -> None:
        self.told.append(part)
        if not self.killed and part < 0.5:
            pid = self.workers()[0]
            os.kill(pid, signal.SIGKILL)
            self.killed.append(pid)

    def check(self) -> None:
        assert self.killed, "no worker was killed: the test shows nothing"
        assert self.told == sorted(self.told) and self.told[-1] == 1.0


def test_workers_keep_the_scene() -> None:
    sent = [packed(SCENE) for _ in range(2)]
    assert sent[0] is not None and sent[0] == sent[1]
    # What arrives with a task is other memory of the same bytes.
    assert _unpacked(sent[0]) is _unpacked(bytes(bytearray(sent[0]))) and packed(None) is None


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            yield client


def test_dask_with_a_killed_worker(client: Any, dataset: dp.Dataset, expected: dict[str, bytes], whole: bytes, tmp_path: Path) -> None:
    import diopter.dask

    def workers() -> list[int]:
        return sorted(client.run(os.getpid).values())

    killer = Killer(workers)
    diopter.dask.make(client, dataset, tmp_path / "set", progress=killer)
    killer.check()
    assert bytes_of(tmp_path / "set") == expected
    client.wait_for_workers(2)
    killer = Killer(workers)
    plane = diopter.dask.expose(client, SCENE, CAMERA, parts=PARTS, spp=SPP, progress=killer, **PICTURE)
    killer.check()
    assert pickle.dumps(plane) == whole


def test_errors_of_dask_workers_are_ours(client: Any) -> None:
    import diopter.dask

    with pytest.raises(dp.DiopterError) as e:
        diopter.dask.expose(client, SCENE, CAMERA, parts=2, spp=4, retries=0, shutter="soon")
    assert e.value.place == "exposure.shutter"
    with pytest.raises(dp.DiopterError) as e:
        diopter.dask.expose(client, SCENE, CAMERA, parts=2, spp=4, to="whole.png", **PICTURE)
    assert e.value.place == "to"


def test_ray_with_a_killed_worker(dataset: dp.Dataset, expected: dict[str, bytes], whole: bytes, tmp_path: Path) -> None:
    ray = pytest.importorskip("ray")
    psutil = pytest.importorskip("psutil")
    import diopter.ray

    def workers() -> list[int]:
        # Ray names its workers after what they run; its own agents are called ray::, too, and its node ends with them.
        children = psutil.Process().children(recursive=True)
        named = [(p.pid, " ".join(p.cmdline()[:1])) for p in children if p.is_running()]
        return [pid for pid, name in named if name.startswith(("ray::_run", "ray::expose_part"))]

    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        killer = Killer(workers)
        diopter.ray.make(dataset, tmp_path / "set", progress=killer)
        killer.check()
        assert bytes_of(tmp_path / "set") == expected
        killer = Killer(workers)
        plane = diopter.ray.expose(SCENE, CAMERA, parts=PARTS, spp=SPP, progress=killer, to=tmp_path / "whole.exr", **PICTURE)
        killer.check()
        assert pickle.dumps(plane) == whole
        assert sorted(p.name for p in tmp_path.iterdir()) == ["set", "whole.exr"], "parts are gone"
    finally:
        ray.shutdown()


def test_openjd_with_a_task_that_fails(dataset: dp.Dataset, expected: dict[str, bytes], tmp_path: Path) -> None:
    pytest.importorskip("openjd.cli")
    spec, job, folder = tmp_path / "spec.toml", tmp_path / "job.yaml", tmp_path / "set"
    spec.write_text(dataset.specification)
    dp.command("dataset", "job", spec, "-o", job, "--items-per-task", "5", "--cores", "1", "--folder", folder)
    openjd = [sys.executable, "-m", "openjd"]
    subprocess.run([*openjd, "check", str(job)], check=True, capture_output=True)
    # Stands before the program: ends with an error the first time that it is asked for item 5.
    program = tmp_path / "sometimes"
    program.write_text(
        f'#!/bin/sh\nif [ "$5" = 5 ] && [ ! -e "{tmp_path}/failed" ]; then touch "{tmp_path}/failed"; exit 1; fi\n'
        f'exec "{sys.executable}" -m diopter "$@"\n'
    )
    program.chmod(program.stat().st_mode | stat.S_IEXEC)
    command = [*openjd, "run", str(job), "-p", f"Program={program}"]
    first = subprocess.run(command, capture_output=True, text=True)
    assert first.returncode != 0 and (tmp_path / "failed").exists(), first.stdout[-2000:] + first.stderr[-2000:]
    assert not json.loads((folder / "card.json").read_text())["complete"]
    second = subprocess.run(command, capture_output=True, text=True)
    assert second.returncode == 0, second.stdout[-2000:] + second.stderr[-2000:]
    assert bytes_of(folder) == expected
