"""Data sets: the same bytes whoever makes them, and files that other programs read."""

from __future__ import annotations

import hashlib
import io
import json
import pickle
import tarfile
from pathlib import Path
from typing import Any, Iterator

import numpy as np
import pytest

import diopter as dp
from diopter._parts import sample_ranges
from diopter.dataset import Task, gather

SPEC: dict[str, Any] = {
    "name": "pairs",
    "items": 6,
    "seed": 3,
    "shot": {
        "scene": {"file": "cornell"},
        "exposure": {"shutter": "1/30"},
        "render": {"size": "24x16", "spp": 2},
    },
    "vary": [
        {"name": "iso", "choice": [100, 400, 1600]},
        {"name": "aperture", "range": ["f/2", "f/8"], "scale": "log"},
    ],
    "write": {"files": ["dng", "raw.npy", "expected.npy", "mean.npy", "depth.npy"], "shard_items": 4},
    "split": {"fractions": {"train": 0.5, "test": 0.5}},
}


@pytest.fixture(scope="module")
def dataset() -> dp.Dataset:
    return dp.Dataset(SPEC)


@pytest.fixture(scope="module")
def made(dataset: dp.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sets") / "one"
    written = dataset.make(folder)
    assert all(path.exists() for path in written)
    return folder


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_shards_are_tar_archives_with_all_items(dataset: dp.Dataset, made: Path) -> None:
    keys = []
    for shard in dataset.shards:
        with tarfile.open(made / shard.name) as archive:
            members = archive.getmembers()
            assert all((m.mtime, m.uid, m.gid, m.mode) == (0, 0, 0, 0o644) for m in members)
            for member in members:
                key, ending = member.name.split(".", 1)
                file = archive.extractfile(member)
                assert file is not None
                if ending == "json":
                    told = json.load(file)
                    keys.append(key)
                    assert told["parameters"] == dataset.parameters(int(key))["parameters"]
                    assert told["split"] == shard.name.split("-")[0]
                elif ending == "raw.npy":
                    shard_raw = np.load(io.BytesIO(file.read()))
                    np.testing.assert_array_equal(shard_raw, dataset[int(key)]["raw.npy"])
    assert sorted(keys) == [f"{k:06}" for k in range(6)]
    card = json.loads((made / "card.json").read_text())
    assert card["complete"] and card["items"] == 6
    for shard_told in card["shards"]:
        assert hashlib.sha256((made / shard_told["name"]).read_bytes()).hexdigest() == shard_told["sha256"]


def test_items_are_arrays(dataset: dp.Dataset) -> None:
    item = dataset[-1]
    assert sorted(item) == dataset.files == ["depth.npy", "dng", "expected.npy", "json", "mean.npy", "raw.npy"]
    assert item["raw.npy"].shape == item["depth.npy"].shape == (16, 24) and item["mean.npy"].shape == (16, 24, 3)
    assert item["raw.npy"].dtype == np.uint16 and item["json"]["item"] == 5
    # The noiseless numbers are the mean of the noisy ones: over 384 pixels their difference is small beside the noise of one.
    noise = item["raw.npy"].astype(float) - item["expected.npy"]
    assert abs(noise.mean()) < 6 * noise.std() / np.sqrt(noise.size) + 1.0
    with pytest.raises(IndexError):
        dataset[6]


@pytest.mark.parametrize("workers", [2])
def test_several_processes_make_the_same_bytes(dataset: dp.Dataset, made: Path, tmp_path: Path, workers: int) -> None:
    dataset.make(tmp_path / "set", workers=workers, chunk=2)
    assert bytes_of(tmp_path / "set") == bytes_of(made)


def test_a_set_goes_on_where_it_was_stopped(dataset: dp.Dataset, made: Path, tmp_path: Path) -> None:
    class Stopped(Exception):
        pass

    counts: list[int] = []

    def some(tasks: Iterator[Task]) -> Iterator[Any]:
        for task in tasks:
            if len(counts) == 2:
                raise Stopped
            counts.append(1)
            yield task.run()

    def rest(tasks: Iterator[Task]) -> Iterator[Any]:
        # In the other order.
        for task in reversed(list(tasks)):
            counts.append(1)
            yield task.run()

    with pytest.raises(Stopped):
        gather(dataset, tmp_path / "set", some)
    gather(dataset, tmp_path / "set", rest)
    assert len(counts) == 6, "an item was made twice"
    assert bytes_of(tmp_path / "set") == bytes_of(made)


def test_the_program_makes_the_same_bytes(dataset: dp.Dataset, made: Path, tmp_path: Path) -> None:
    (tmp_path / "spec.toml").write_text(dataset.specification)
    dp.command("dataset", "item", "spec.toml", "--item", "4", "--count", "9", "-o", "set", cwd=tmp_path)
    dp.command("dataset", "item", "spec.toml", "--items", "0..3", "-o", "set", cwd=tmp_path)
    answer = dp.command("dataset", "make", "spec.toml", "-o", "set", cwd=tmp_path)
    assert answer["made"] == 1 and bytes_of(tmp_path / "set") == bytes_of(made)
    info = dp.command("dataset", "info", "spec.toml", "--items", "2..4", cwd=tmp_path)
    assert [row["item"] for row in info["listed"]] == [2, 3] and info["listed"][0] == dataset.parameters(2)
    dp.command("dataset", "job", "spec.toml", "-o", "job.yaml", "--items-per-task", "4", cwd=tmp_path)
    assert 'range: "0-4:4"' in (tmp_path / "job.yaml").read_text()


def test_the_table_is_parquet(dataset: dp.Dataset, made: Path) -> None:
    rows = [json.loads(line) for line in (made / "metadata.jsonl").read_text().splitlines()]
    assert len(rows) == 6 and rows[0]["parameters.iso"] == rows[0]["facts.iso"]
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(made / "metadata.parquet").to_pylist()
    assert [{k: v for k, v in row.items() if v is not None} for row in table] == [
        {k: v for k, v in row.items() if v is not None} for row in rows
    ]


def test_sets_are_pickled_and_errors_tell_their_parts(dataset: dp.Dataset) -> None:
    again = pickle.loads(pickle.dumps(dataset))
    assert len(again) == 6 and again.archive(2) == dataset.archive(2)
    with pytest.raises(dp.DiopterError) as e:
        dp.Dataset({**SPEC, "vary": [{"name": "isso", "values": [1]}]})
    assert e.value.place is not None and "[[vary]] 1 (isso)" in e.value.place
    assert e.value.hint is not None and "iso" in e.value.hint
    with pytest.raises(dp.DiopterError, match="spec.toml"):
        dp.Dataset("nowhere/spec.toml")


def test_parts_cover_all_samples_once() -> None:
    assert sample_ranges(64, 3) == [(0, 20), (20, 42), (42, 64)]
    assert sample_ranges(5, 3) == [(0, 2), (2, 4), (4, 5)]
    with pytest.raises(dp.DiopterError, match="two samples"):
        sample_ranges(4, 3)
