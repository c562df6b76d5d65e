"""Demonstrations as a LeRobot dataset, format 3.0: parquet files and JSON, images as PNG.

The layout is that of lerobot 0.4.4: frames in ``data/``, one row per episode with its statistics in ``meta/episodes/``,
instructions in ``meta/tasks.parquet``, statistics of all frames in ``meta/stats.json``, and a summary in
``meta/info.json``.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow
import pyarrow.parquet
from numpy.typing import NDArray

from vlafuzz.exports.demonstrations import Levels, Packed

VERSION = "v3.0"
PATH = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"  # all is in the first file of each kind
FIRST = {"chunk_index": 0, "file_index": 0}
TASKS = "meta/tasks.parquet"
STATE, ACTION = "observation.state", "action"
_COUNTERS = ("frame_index", "episode_index", "index", "task_index")
NUMBERS = {"timestamp": "float32"} | dict.fromkeys(_COUNTERS, "int64")
QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
Columns = dict[str, NDArray[Any]]
Stats = dict[str, Any]  # nested lists of numbers


class Dataset:
    """Writes a dataset episode by episode into an empty or absent folder; ``close`` completes it.

    Args:
        names: of the numbers of ``STATE`` and ``ACTION``.
    """

    def __init__(self, folder: Path, fps: int, robot: str, names: Mapping[str, list[str]]) -> None:
        self._folder, self._fps, self._robot, self._names = folder, fps, robot, names
        self._tasks: dict[str, int] = {}
        self._rows: list[dict[str, Any]] = []
        self._columns: list[Columns] = []
        self._levels: dict[str, Levels] = {}
        self._sizes: dict[str, tuple[int, ...]] = {}
        self._frames = 0
        self._writer: pyarrow.parquet.ParquetWriter | None = None

    def add(self, shown: Packed) -> None:
        task = self._tasks.setdefault(shown.scene.instruction, len(self._tasks))
        columns = self._numbered(shown, task)
        self._sizes = dict(shown.sizes)
        self._write(shown.pictures, columns)
        stats = {key: summary_of_levels(counts, len(shown.actions)) for key, counts in shown.levels.items()}
        stats |= {key: summary(values) for key, values in columns.items()}
        self._rows.append(self._row(shown, len(shown.actions), stats))
        self._columns.append(columns)
        for key, counts in shown.levels.items():
            self._levels[key] = self._levels.get(key, 0) + counts
        self._frames += len(shown.actions)

    def close(self) -> int:
        """Complete what was written, if there is anything; the number of episodes."""
        if self._writer is None:
            return 0
        self._writer.close()
        tasks = pandas.DataFrame({"task_index": list(self._tasks.values())}, index=list(self._tasks))
        meta = self._folder / "meta"
        episodes = meta / "episodes" / PATH.format(**FIRST)
        episodes.parent.mkdir(parents=True, exist_ok=True)
        tasks.to_parquet(self._folder / TASKS)
        pyarrow.parquet.write_table(pyarrow.Table.from_pylist(self._rows), episodes)
        stats = {key: summary_of_levels(counts, self._frames) for key, counts in self._levels.items()}
        for key in self._columns[0]:
            stats[key] = summary(np.concatenate([columns[key] for columns in self._columns]))
        for name, content in (("stats", stats), ("info", self._info())):
            (meta / f"{name}.json").write_text(json.dumps(content) + "\n", encoding="utf-8")
        return len(self._rows)

    def _numbered(self, shown: Packed, task: int) -> Columns:
        steps = np.arange(len(shown.actions))
        constant = {"episode_index": len(self._rows), "task_index": task}
        return {
            STATE: shown.states,
            ACTION: shown.actions,
            "timestamp": (steps / self._fps).astype(np.float32),
            "frame_index": steps,
            "index": self._frames + steps,
            **{name: np.full(len(steps), value) for name, value in constant.items()},
        }

    def _write(self, pictures: Mapping[str, list[bytes]], columns: Columns) -> None:
        arrays = {key: _image_column(frames) for key, frames in pictures.items()}
        arrays |= {key: _column(values) for key, values in columns.items()}
        table = pyarrow.table(arrays)
        if self._writer is None:
            path = self._folder / "data" / PATH.format(**FIRST)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = pyarrow.parquet.ParquetWriter(path, table.schema)
        self._writer.write_table(table)

    def _row(self, shown: Packed, length: int, stats: Mapping[str, Stats]) -> dict[str, Any]:
        return {
            "episode_index": len(self._rows),
            "tasks": [shown.scene.instruction],
            "length": length,
            "scene": shown.scene.digest,
            "finding": shown.finding,
            **{f"{kind}/{name}": number for kind in ("data", "meta/episodes") for name, number in FIRST.items()},
            "dataset_from_index": self._frames,
            "dataset_to_index": self._frames + length,
            **{f"stats/{key}/{name}": value for key, stat in stats.items() for name, value in stat.items()},
        }

    def _info(self) -> dict[str, Any]:
        pictures = {
            key: {"dtype": "image", "shape": list(size), "names": ["height", "width", "channels"]}
            for key, size in self._sizes.items()
        }
        vectors = {
            key: {"dtype": "float32", "shape": [len(names)], "names": names} for key, names in self._names.items()
        }
        numbers = {key: {"dtype": kind, "shape": [1], "names": None} for key, kind in NUMBERS.items()}
        return {
            "codebase_version": VERSION,
            "robot_type": self._robot,
            "total_episodes": len(self._rows),
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "chunks_size": 1000,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": self._fps,
            "splits": {"train": f"0:{len(self._rows)}"},
            "data_path": f"data/{PATH}",
            "video_path": None,
            "features": pictures | vectors | numbers,
        }


def write_dataset(shown: Iterable[Packed], folder: Path, fps: int, robot: str, names: Mapping[str, list[str]]) -> int:
    """Write a dataset, or nothing if there is no demonstration; returns the number of episodes."""
    dataset = Dataset(folder, fps, robot, names)
    for demonstration in shown:
        dataset.add(demonstration)
    return dataset.close()


def _image_column(pictures: list[bytes]) -> pyarrow.Array:
    rows = [{"bytes": data, "path": f"frame-{number:06d}.png"} for number, data in enumerate(pictures)]
    kind = pyarrow.struct({"bytes": pyarrow.binary(), "path": pyarrow.string()})
    return pyarrow.array(rows, kind)


def _column(values: NDArray[Any]) -> pyarrow.Array:
    if values.ndim == 1:
        return pyarrow.array(values)
    flat = pyarrow.array(np.ascontiguousarray(values, dtype=np.float32).reshape(-1))
    return pyarrow.FixedSizeListArray.from_arrays(flat, values.shape[1])


def summary(values: NDArray[Any]) -> Stats:
    """Statistics of numbers ``(n,)`` or vectors ``(n, d)``, as lists of length 1 or d."""
    table = values.reshape(len(values), -1).astype(np.float64)
    stats = {"min": table.min(0), "max": table.max(0), "mean": table.mean(0), "std": table.std(0)}
    stats |= zip(map(_named, QUANTILES), np.quantile(table, QUANTILES, axis=0), strict=True)
    return {name: stat.tolist() for name, stat in stats.items()} | {"count": [len(values)]}


def summary_of_levels(counts: Levels, pictures: int) -> Stats:
    """Statistics of levels in [0, 1] by channel: lists (3, 1, 1). Quantiles are levels that occur."""
    level, share = np.arange(256) / 255, counts / counts.sum(1, keepdims=True)
    mean, below = share @ level, np.cumsum(share, axis=1)
    stats = {
        "min": level[(share > 0).argmax(1)],
        "max": level[255 - (share[:, ::-1] > 0).argmax(1)],
        "mean": mean,
        "std": np.sqrt(((level - mean[:, None]) ** 2 * share).sum(1)),
        **{_named(quantile): level[(below >= quantile - 1e-12).argmax(1)] for quantile in QUANTILES},
    }
    return {name: stat.reshape(3, 1, 1).tolist() for name, stat in stats.items()} | {"count": [pictures]}


def _named(quantile: float) -> str:
    return f"q{100 * quantile:02.0f}"
