"""A torch data set of raw images and their truth: made once as shards, read by a DataLoader. Without torch the same samples come as numpy arrays.

    python torch_data_set.py [folder] [number]
"""

from __future__ import annotations

import importlib
import io
import json
import sys
import tarfile
from pathlib import Path
from typing import Any, Iterator

import numpy as np
import numpy.typing as npt

import diopter as dp

torch: Any
try:
    torch = importlib.import_module("torch")
except ImportError:
    torch = None

Float32 = npt.NDArray[np.float32]


def specification(items: int, size: str, spp: int) -> dict[str, Any]:
    """What varies: pose, aperture, ISO speed. What is written: the numbers of the raw file, those without noise, depth."""
    return {
        "name": "raw-and-truth",
        "items": items,
        "seed": 1,
        "shot": {
            "scene": {"file": "still-life"},
            "camera": {"lens": "thin", "body": "nikon-d850", "focal_length": "50 mm"},
            "render": {"size": size, "spp": spp},
        },
        "vary": [
            {"name": "iso", "choice": [200, 800, 3200]},
            {"name": "aperture", "range": ["f/2", "f/8"], "scale": "log"},
            {"pose": {"look_at": [0, 0.08, 0], "distance": [0.7, 1.2], "elevation_deg": [10, 50], "azimuth_deg": [-40, 40]}},
        ],
        "write": {"files": ["raw.npy", "expected.npy", "depth.npy"], "shard_items": 64},
    }


def planes(mosaic: npt.NDArray[Any], black: float, white: float) -> Float32:
    """A Bayer mosaic as four planes of half the size, black 0 and white 1: ``float32 [4][row][column]``."""
    scaled = (mosaic.astype(np.float32) - black) / (white - black)
    return np.stack([scaled[y::2, x::2] for y in (0, 1) for x in (0, 1)])


class RawAndTruth:
    """The items of shards: noisy planes, noiseless planes, depth. ``torch.utils.data.DataLoader`` takes it as it is (it has ``__len__`` and
    ``__getitem__``); a shard is read where an item of it is asked for."""

    def __init__(self, folder: Path) -> None:
        body = dp.Body("nikon-d850")
        flat = dp.FocalPlane.from_irradiance(np.zeros((2, 2, 3)), body, shutter=0.01)
        raw = dp.read_out(flat, body)
        self.black, self.white = raw.black_level, raw.white_level
        self.places = list(self._index(folder))

    @staticmethod
    def _index(folder: Path) -> Iterator[tuple[Path, dict[str, tuple[int, int]]]]:
        """Where the files of each item lie within their shard: nothing is unpacked."""
        for shard in sorted(folder.glob("*.tar")):
            items: dict[str, dict[str, tuple[int, int]]] = {}
            with tarfile.open(shard) as archive:
                for member in archive:
                    key, ending = member.name.split(".", 1)
                    items.setdefault(key, {})[ending] = (member.offset_data, member.size)
            for files in items.values():
                yield shard, files

    def __len__(self) -> int:
        return len(self.places)

    def _file(self, item: int, ending: str) -> bytes:
        shard, files = self.places[item]
        start, size = files[ending]
        with open(shard, "rb") as file:
            file.seek(start)
            return file.read(size)

    def __getitem__(self, item: int) -> dict[str, Any]:
        raw, expected, depth = (np.load(io.BytesIO(self._file(item, name))) for name in ("raw.npy", "expected.npy", "depth.npy"))
        sample: dict[str, Any] = {
            "noisy": planes(raw, self.black, self.white),
            "clean": planes(expected, self.black, self.white),
            "depth": np.asarray(depth, dtype=np.float32),
        }
        told = json.loads(self._file(item, "json"))
        if torch is not None:
            sample = {name: torch.from_numpy(array) for name, array in sample.items()}
        return sample | {"iso": float(told["parameters"]["iso"])}


def main(folder: Path = Path("torch-data-set"), count: int = 16, size: str = "96x64", spp: int = 16, workers: int = 4) -> int:
    dp.Dataset(specification(count, size, spp)).make(folder, progress=True)
    samples = RawAndTruth(folder)
    batches: Any
    if torch is None:
        print("torch is not installed: numpy arrays, one item a batch")
        batches = ({name: [samples[k][name]] for name in ("noisy", "clean")} for k in range(len(samples)))
    else:
        batches = importlib.import_module("torch.utils.data").DataLoader(samples, batch_size=4, num_workers=workers)
    seen = 0
    for batch in batches:
        noisy, clean = (np.asarray(batch[name]) for name in ("noisy", "clean"))
        seen += len(noisy)
        print(f"{noisy.shape} of mean {noisy.mean():.4f}, noise {np.sqrt(np.mean((noisy - clean) ** 2)):.4f} of white")
    return seen


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "torch-data-set"), int(sys.argv[2]) if len(sys.argv) > 2 else 16)
