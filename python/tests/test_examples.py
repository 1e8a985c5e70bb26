"""The examples run, small."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_first_photograph(tmp_path: Path) -> None:
    picture = example("first_photograph").main(tmp_path, size=(48, 32), spp=4)
    assert picture.size == (48, 32) and (tmp_path / "first.dng").exists() and (tmp_path / "first.jpg").exists()


def test_lens_bench() -> None:
    info = example("lens_bench").main(rays=10_000)
    assert info["f_number"] == pytest.approx(5.6, rel=1e-3)


def test_sensor_noise() -> None:
    gain, sheet = example("sensor_noise").main(size=128)
    # 4096 pixels a level and channel: 2 % a variance.
    assert gain == pytest.approx(sheet, rel=0.1)


def test_raw_and_truth(tmp_path: Path) -> None:
    written = example("raw_and_truth").main(tmp_path / "set", count=2, size=(24, 16), spp=2)
    item = np.load(written[0])
    assert item["mosaic"].shape == item["expected"].shape == item["depth"].shape == (16, 24)
    again = example("raw_and_truth").main(tmp_path / "again", count=1, size=(24, 16), spp=2)
    np.testing.assert_array_equal(np.load(again[0])["mosaic"], item["mosaic"])
