"""Demonstrations as a LeRobot dataset.

lerobot cannot be installed beside our packages. For the test with its own loader, name the Python of another
environment with lerobot 0.4.4: VLAFUZZ_LEROBOT=PATH/bin/python scripts/test -m slow
"""

import io
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.cli.typed import typed
from tests.failures.corpus.corpora import case, make_corpus
from tests.rollouts.test_scene_runner import run
from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.common.plugins import EVERYTHING, trusting
from vlafuzz.exports.demonstrations import Packed
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.model import Verdict
from vlafuzz.rollouts.scene_runner import SimulatorSceneRunner

parquet = pytest.importorskip("pyarrow.parquet")
LEROBOT = os.environ.get("VLAFUZZ_LEROBOT")
MOVES = ["dx", "dy", "dz", "drx", "dry", "drz", "gripper"]
NAMES = {"observation.state": ["x", "y", "z", "rx", "ry", "rz", "opening"], "action": MOVES}
FRAMES, STEPS = "data/chunk-000/file-{:03d}.parquet", (4, 3, 5)
READ = """
import json, sys
import torch
library = torch.library.Library("torchvision", "DEF")  # the wheel of torchvision needs a torch with CUDA
for name in ("nms", "qnms"):
    library.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
from lerobot.datasets.compute_stats import aggregate_stats
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("vlafuzz/shown", root=sys.argv[1], delta_timestamps={"action": [0, 0.2]})
first, last = data[0], data[len(data) - 1]
facts = {"episodes": data.num_episodes, "frames": data.num_frames, "fps": data.fps,
        "shape": list(first["observation.images.front"].shape), "state": first["observation.state"].tolist(),
        "action": first["action"].tolist(), "padded": last["action_is_pad"].tolist(), "task": last["task"],
        "last": [int(last["episode_index"]), int(last["frame_index"])],
        "corner": (first["observation.images.front"][:, 0, 0] * 255).round().int().tolist(),
        "mean": data.meta.stats["action"]["mean"].tolist()}
print(json.dumps(facts))
"""


def read_by_lerobot(folder: Path) -> dict[str, Any]:
    """What lerobot's own loader says about a dataset."""
    assert LEROBOT is not None
    offline = {**os.environ, "HF_HUB_OFFLINE": "1", "PYTHONPATH": ""}
    command = [LEROBOT, "-c", READ, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, env=offline)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def pictures(number: int, steps: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 256, (steps, 12, 16, 3), np.uint8)


def shown(number: int, steps: int) -> Packed:
    states, actions = np.random.default_rng(number).normal(size=(2, steps, 7)).astype(np.float32)
    about = replace(nominal(), instruction=f"pick up thing {number % 2}")
    return Packed.of(about, {"observation.images.front": pictures(number, steps)}, states, actions)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    from vlafuzz.exports.lerobot import write_dataset

    demos = [shown(number, steps) for number, steps in enumerate(STEPS)]
    assert write_dataset(demos, tmp_path / "shown", 5, "panda", NAMES) == len(STEPS)
    return tmp_path / "shown"


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes that the expert solves; the witness of the first is its solution."""
    with trusting(EVERYTHING):
        runner = SimulatorSceneRunner(Path("a.db"), run("make_frozen"))
        solved = runner.solve(nominal(), 0)
        runner.close()
    assert solved.verdict is Verdict.PASSED
    solution = replace(case().witness, actions=solved.rollouts[0].actions)
    first = replace(case(), scene=nominal(), witness=solution)
    folder = tmp_path_factory.mktemp("corpus") / "a"
    write_corpus(make_corpus(first, case(1)), folder)
    return folder


def test_every_frame_is_written_unchanged(folder: Path):
    frames = parquet.read_table(folder / FRAMES.format(0)).to_pylist()
    images = [np.array(Image.open(io.BytesIO(row["observation.images.front"]["bytes"]))) for row in frames]
    demos = [shown(number, steps) for number, steps in enumerate(STEPS)]
    assert np.array_equal(images, np.concatenate([pictures(*demo) for demo in enumerate(STEPS)]))
    states, actions = ([getattr(demo, part) for demo in demos] for part in ("states", "actions"))
    for key, wanted in (("observation.state", states), ("action", actions)):
        assert np.array_equal([row[key] for row in frames], np.concatenate(wanted))
    rows = [tuple(row[key] for key in ("index", "episode_index", "frame_index", "task_index")) for row in frames]
    assert rows[3:8] == [(3, 0, 3, 0), (4, 1, 0, 1), (5, 1, 1, 1), (6, 1, 2, 1), (7, 2, 0, 0)]
    assert frames[3]["timestamp"] == pytest.approx(0.6)


def test_the_metadata_describe_the_dataset(folder: Path):
    info = json.loads((folder / "meta/info.json").read_text())
    facts = [info[key] for key in ("codebase_version", "robot_type", "total_episodes", "total_frames", "fps")]
    assert facts == ["v3.0", "panda", 3, 12, 5]
    assert info["features"]["observation.images.front"]["shape"] == [12, 16, 3]
    assert info["features"]["action"]["names"] == MOVES
    episodes = parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    spans = [(row["dataset_from_index"], row["dataset_to_index"], row["tasks"]) for row in episodes]
    assert spans == [(0, 4, ["pick up thing 0"]), (4, 7, ["pick up thing 1"]), (7, 12, ["pick up thing 0"])]
    tasks = parquet.read_table(folder / "meta/tasks.parquet").to_pandas()
    assert tasks.task_index.to_dict() == {"pick up thing 0": 0, "pick up thing 1": 1}


def test_statistics_are_those_of_all_frames(folder: Path):
    stats = json.loads((folder / "meta/stats.json").read_text())
    demos = [shown(number, steps) for number, steps in enumerate(STEPS)]
    actions = np.concatenate([demo.actions for demo in demos]).astype(np.float64)
    pixels = np.concatenate([pictures(*demo).reshape(-1, 3) for demo in enumerate(STEPS)]) / 255
    for stat, values in ((stats["action"], actions), (stats["observation.images.front"], pixels)):
        wanted = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
        wanted["q90"] = np.quantile(values, 0.9, axis=0)
        for name, expected in wanted.items():
            assert np.reshape(stat[name], -1) == pytest.approx(expected, abs=0.5 / 255)
        assert stat["count"] == [12]
    assert np.shape(stats["observation.images.front"]["mean"]) == (3, 1, 1)


@pytest.mark.render
def test_the_cases_of_a_corpus_are_demonstrated(corpus: Path, tmp_path: Path, capsys):
    out = tmp_path / "shown"
    command = ["export", str(corpus), "--format", "lerobot", "--out", str(out), "--workers", "1"]
    assert "2 demonstrations written" in typed(capsys, command).err
    frames = parquet.read_table(out / FRAMES.format(0)).to_pylist()
    moved = np.array([row["observation.state"] for row in frames if row["episode_index"] == 0])
    assert moved[-1, 2] > moved[:, 2].min() + 0.01  # it was lifted
    seen = np.array(Image.open(io.BytesIO(frames[0]["observation.images.front"]["bytes"])))
    assert (seen.shape, seen.std() > 10) == ((224, 224, 3), True)


def test_a_corpus_has_no_runs_to_choose_from(corpus: Path, tmp_path: Path, capsys):
    command = ["export", str(corpus), "--format", "lerobot", "--out", str(tmp_path / "shown"), "--run", "1"]
    assert f"--run 1: {corpus} is a corpus, not a store" in typed(capsys, command, code=2).err.replace("\n", " ")


def test_a_package_that_is_missing(corpus: Path, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "vlafuzz.exports.lerobot", raising=False)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    command = ["export", str(corpus), "--format", "lerobot", "--out", str(tmp_path / "shown")]
    printed = typed(capsys, command, code=3).err
    assert "--format lerobot needs the package 'pyarrow'" in printed
    assert "-m pip install " in printed


@pytest.mark.slow
@pytest.mark.skipif(LEROBOT is None, reason="VLAFUZZ_LEROBOT names no Python with lerobot")
def test_lerobots_own_loader_reads_it(folder: Path):
    read = read_by_lerobot(folder)
    demos = [shown(number, steps) for number, steps in enumerate(STEPS)]
    actions = np.concatenate([demo.actions for demo in demos])
    assert (read["episodes"], read["frames"], read["fps"], read["shape"]) == (3, 12, 5, [3, 12, 16])
    assert read["state"] == demos[0].states[0].tolist()
    assert read["action"] == demos[0].actions[:2].tolist()
    assert read["corner"] == pictures(0, STEPS[0])[0, 0, 0].tolist()
    assert (read["task"], read["last"], read["padded"]) == ("pick up thing 0", [2, 4], [False, True])
    assert read["mean"] == pytest.approx(actions.mean(0), abs=1e-6)
