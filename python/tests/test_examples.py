"""The examples run, small."""

from __future__ import annotations

import ast
import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

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


def test_torch_data_set(tmp_path: Path) -> None:
    # Where torch is not installed, the example gives numpy arrays.
    module = example("torch_data_set")
    assert module.main(tmp_path / "set", count=5, size="24x16", spp=2, workers=2) == 5
    sample = module.RawAndTruth(tmp_path / "set")[3]
    assert tuple(sample["noisy"].shape) == tuple(sample["clean"].shape) == (4, 8, 12)


def test_denoising_pairs(tmp_path: Path) -> None:
    found = example("denoising_pairs").main(tmp_path / "pairs", count=2, size=(96, 64), spp=4)
    # About 10 000 squares of unit variance: their mean is within 0.015 (one deviation), five of them and the fixed pattern's own rounding.
    assert all(ratio == pytest.approx(1.0, abs=0.08) for ratio in found.values()), found
    item = np.load(tmp_path / "pairs" / "iso400-0001.npz")
    assert item["noisy"].shape == item["again"].shape == (64, 96) and (item["noisy"] != item["again"]).any()


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_run(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs the code cells in order, as a kernel would without its magic; what a cell ends with is shown as a notebook shows it."""
    monkeypatch.chdir(tmp_path)
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    names: dict[str, Any] = {"__name__": "__main__"}
    ran = 0
    for number, cell in enumerate(notebook["cells"]):
        if cell["cell_type"] != "code":
            continue
        assert not cell["outputs"] and cell["execution_count"] is None, "notebooks are kept without outputs"
        tree = ast.parse("".join(cell["source"]))
        last = tree.body[-1] if tree.body else None
        if isinstance(last, ast.Expr):
            tree.body.pop()
        exec(compile(tree, f"{path.name}[{number}]", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), f"{path.name}[{number}]", "eval"), names)
            if hasattr(value, "_repr_png_"):
                assert value._repr_png_().startswith(b"\x89PNG")
        ran += 1
    assert ran >= 3
