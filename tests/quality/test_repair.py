"""The study of repairs: its figures, and its steps with a little of everything."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"
TASK = "pick-up"


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(SCRIPTS)
    from repair import figures

    monkeypatch.setattr(figures, "DRAWS", 400)
    return figures


def write(folder: Path, policy: str, kind: str, failed: np.ndarray) -> None:
    file = folder / "judged" / policy / f"{kind}-{TASK}-0.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    rows = [{"task": TASK, "kind": kind, "scene": number, "failed": bool(one)} for number, one in enumerate(failed)]
    file.write_text("".join(f"{json.dumps(row)}\n" for row in rows))


def test_an_arm_is_compared_with_the_others_in_the_same_scenes(figures, tmp_path: Path):
    rng = np.random.default_rng(1)
    hard = rng.random(400) < 0.5
    for policy, kept in {"shipped": 1.0, "random-0": 0.8, "random-1": 0.8, "failed-0": 0.4, "failed-1": 0.4}.items():
        write(tmp_path, policy, "random", hard & (rng.random(400) < kept))
        write(tmp_path, policy, "nominal", np.arange(100) < 5)
    shipped, failed, random = figures.rows(tmp_path, [TASK])
    arms = [(row.arm, row.repeats) for row in (shipped, failed, random)]
    assert arms == [("shipped", 1), ("failed", 2), ("random", 2)]
    for estimate, truth in (
        (shipped.failures[TASK], 0.5),
        (failed.failures["all"], 0.2),
        (failed.fewer, 0.3),
        (failed.fewer_than_random, 0.2),
        (random.fewer_than_random, 0.0),
        (failed.nominal, 0.05),
    ):
        value, low, high = estimate
        assert low <= value <= high
        assert low - 0.02 <= truth <= high + 0.02
    assert failed.lost == (0, 0, 0)
    assert failed.fewer_than_random[1] > 0.1


@pytest.mark.slow
@pytest.mark.render
def test_a_repair_ends_with_better_or_worse_weights_and_a_page(tmp_path: Path):
    flags = ["--tasks", TASK, "--arms", "failed", "mixed", "--again", "mixed", "--budget", "16", "--demos", "4"]
    flags += ["--old-demos", "1", "--recipe", "--updates 2 --batch 8", "--scenes", "20", "--nominal", "20"]
    command = [sys.executable, str(SCRIPTS / "repair_mini.py"), str(tmp_path / "out"), *flags]
    assert "page.html" in subprocess.run(command, capture_output=True, text=True, check=True).stdout
    out = tmp_path / "out"
    assert {path.name for path in (out / "judged").iterdir()} == {"shipped", "failed-0", "mixed-0", "mixed-again-0"}
    rounds = json.loads((out / "mini" / "mixed-again-0" / "policy.json").read_text())["rounds"]
    assert [part["recipe"]["updates"] for part in rounds[-2:]] == [2, 2]
    assert "mixed-again: fails in" in (out / "page.html").read_text()
