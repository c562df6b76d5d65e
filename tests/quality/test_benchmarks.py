"""What the benchmark of strategies counts is what there is."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "bench_strategies.py"


def bench(tmp_path: Path, *args: str) -> dict[str, Any]:
    out = tmp_path / "out.json"
    command = [sys.executable, str(SCRIPT), args[0], "--repeats", "2", "--workers", "1", "--out", str(out), *args[1:]]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    return json.loads(out.read_text())  # type: ignore[no-any-return]


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
