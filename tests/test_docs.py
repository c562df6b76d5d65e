"""What README says is so."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.sim.scenes import CATALOGUE, nominal
from vlafuzz.cli import COMMANDS
from vlafuzz.outcome import Verdict
from vlafuzz.scene import write_scenes
from vlafuzz.space import load_operators
from vlafuzz.subjects.registry import SUBJECTS
from vlafuzz.tasks.tabletop import TASKS

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.parametrize("name", COMMANDS)
def test_readme_names_every_command(name):
    assert f"`vlafuzz {name}" in README


@pytest.mark.parametrize("name", list(load_operators().operators))
def test_readme_has_a_row_for_every_operator(name):
    assert re.search(rf"^\| \d+ \| `{name}`", README, flags=re.MULTILINE)


@pytest.mark.parametrize("name", [*SUBJECTS, *TASKS])
def test_readme_names_every_subject_and_task(name):
    assert f"`{name}`" in README


def test_the_example_of_an_own_subject_runs_and_is_about_twenty_lines(tmp_path, monkeypatch):
    from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator
    from vlafuzz.subjects.registry import make_subject

    (tmp_path / "mine.py").write_text(EXAMPLES[0])
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    evaluator = ManiSkillEvaluator("pick-up", make_subject("python:mine:make"), CATALOGUE, min_distance=0.15)
    outcome = evaluator.evaluate([nominal("pick-up")])[0]
    evaluator.close()
    assert outcome.verdict is Verdict.FAILED
    assert outcome.lost_stage == "grasp"
    assert len([line for line in EXAMPLES[0].splitlines() if line.strip()]) <= 22


def test_the_gymnasium_example_runs(tmp_path):
    write_scenes(tmp_path / "failures.jsonl", [nominal("pick-up")])
    (tmp_path / "example.py").write_text(EXAMPLES[1] + "print(info['progress'])\n")
    done = subprocess.run(
        [sys.executable, "example.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "tensor" in done.stdout


@pytest.mark.parametrize("script", ["demo", "test", "setup", "check"])
def test_scripts_are_executable_and_parse(script):
    path = Path(__file__).parent.parent / "scripts" / script
    assert path.stat().st_mode & 0o111
    assert subprocess.run([shutil.which("bash"), "-n", path], check=False).returncode == 0
