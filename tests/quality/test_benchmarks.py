"""What the benchmark of strategies counts is what there is."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.worlds.tabletop.test_vlatest import grasp, write
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.vlatest import read_vlatest

SCRIPT = Path(__file__).parents[2] / "scripts" / "bench_strategies.py"
SAID = ("target-type", "target-position")


def bench(tmp_path: Path, *args: str) -> dict[str, Any]:
    out = tmp_path / "out.json"
    command = [sys.executable, str(SCRIPT), args[0], "--repeats", "2", "--workers", "2", "--out", str(out), *args[1:]]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    return json.loads(out.read_text())  # type: ignore[no-any-return]


@pytest.fixture
def labels(tmp_path: Path) -> Path:
    """A pool of 120 scenes, of which a VLA passed those on the left."""
    rng, names = np.random.default_rng(1), ("apple", "orange", "opened_coke_can", "pepsi_can")
    scenes = [grasp(str(rng.choice(names)), rng.uniform(-0.5, -0.1), rng.uniform(0, 0.4)) for _ in range(120)]
    path = write(tmp_path / "t-grasp.json", *scenes)
    read = read_vlatest(path, load_catalogue()).scenes
    left = [index for index, scene in enumerate(read) if scene.targets[0].y > 0]
    assert 50 <= len(left) <= 70
    (tmp_path / "all-correct-task.json").write_text(json.dumps({"t-grasp": {"vla": left}}))
    return tmp_path


def test_of_a_whole_pool_every_strategy_finds_all_that_is_wanted(labels: Path):
    flags = ("--strategies", "random", "nsga2", "--budget", "120", "--repeats", "1")
    found = bench(labels, "replay", str(labels), *flags)
    passed = len(json.loads((labels / "all-correct-task.json").read_text())["t-grasp"]["vla"])
    for row in found["found"]:
        assert row["runs"] == [120 - passed if "failures" in row["case"] else passed]


def test_who_learns_from_labels_finds_more_of_what_is_wanted(labels: Path):
    flags = ("--strategies", "random", "nsga2", "--budget", "60", "--repeats", "4")
    found = bench(labels, "replay", str(labels), *flags)
    assert all(row["gain"] > 0.1 for row in found["found"] if row["strategy"] == "nsga2")
    assert found["pooled"]["nsga2"]["ratio"]["value"] > 1.1


@pytest.mark.slow
def test_random_scenes_fail_as_often_as_was_planted(tmp_path: Path):
    flags = ["--strategies", "random", "--shares", "0.1", "--signals", "flat", "--budget", "200"]
    rows = bench(tmp_path, "toy", *flags)["failures"]
    assert len(rows) == 5
    assert all(8 <= failures <= 35 for row in rows for failures in row["runs"])


def test_causes_identifies_more_planted_faults_than_random_scenes_and_triage(tmp_path: Path):
    flags = ["--arms", "causes", "random + triage", "--densities", "dense", "--budgets", "150"]
    content = bench(tmp_path, "faults", *flags, "--splits", "0.3")
    causes, triage = content["identified"]
    assert sum(causes["runs"]) >= sum(triage["runs"])
    assert causes["precision"]["value"] > 0.8


@pytest.mark.slow
def test_an_expert_with_planted_faults_fails_in_the_simulator_for_no_other_reason(tmp_path: Path):
    flags = ["--policies", "expert", "--arms", "causes", "--densities", "dense", "--budgets", "60"]
    (causes,) = bench(tmp_path, "faults", *flags, "--repeats", "1")["identified"]
    assert causes["reported"] >= 1
    assert causes["unplanted"] == 0
