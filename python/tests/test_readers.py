"""Shards are read as they are by the programs that training uses."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import diopter as dp

SPEC: dict[str, Any] = {
    "name": "read",
    "items": 9,
    "seed": 1,
    "shot": {"scene": {"file": "cornell"}, "exposure": {"shutter": "1/30"}, "render": {"size": "24x16", "spp": 1}},
    "vary": [{"name": "iso", "values": [100, 400, 1600]}],
    "write": {"files": ["dng", "raw.npy", "mean.npy"], "shard_items": 4},
}


@pytest.fixture(scope="module")
def dataset() -> dp.Dataset:
    return dp.Dataset(SPEC)


@pytest.fixture(scope="module")
def shards(dataset: dp.Dataset, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("sets") / "set"
    dataset.make(folder)
    return [str(path) for path in sorted(Path(folder).glob("*.tar"))]


def test_webdataset(dataset: dp.Dataset, shards: list[str]) -> None:
    webdataset = pytest.importorskip("webdataset")
    read = list(webdataset.WebDataset(shards, shardshuffle=False).decode())
    assert [item["__key__"] for item in read] == [f"{k:06}" for k in range(9)]
    for k in (0, 5, 8):
        made = dataset[k]
        np.testing.assert_array_equal(read[k]["raw.npy"], made["raw.npy"])
        np.testing.assert_array_equal(read[k]["mean.npy"], made["mean.npy"])
        assert read[k]["json"] == made["json"] and read[k]["dng"] == made["dng"]


def test_datasets(dataset: dp.Dataset, shards: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path))
    datasets = pytest.importorskip("datasets")
    stream = datasets.load_dataset("webdataset", data_files={"train": shards}, split="train", streaming=True, cache_dir=str(tmp_path))
    read = list(stream)
    assert [item["__key__"] for item in read] == [f"{k:06}" for k in range(9)]
    for k in (0, 5, 8):
        made, raw, told = dataset[k], read[k]["raw.npy"], read[k]["json"]
        raw = np.load(io.BytesIO(raw)) if isinstance(raw, bytes) else np.asarray(raw)
        np.testing.assert_array_equal(raw, made["raw.npy"])
        assert (json.loads(told) if isinstance(told, (str, bytes)) else told)["item"] == k
