"""What README says is so."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.doubles import ClosedForm
from tests.search import climb
from tests.sim.scenes import CATALOGUE, nominal
from vlafuzz.campaign import launch
from vlafuzz.cli import COMMANDS, main
from vlafuzz.formats.scene_lines import write_scenes
from vlafuzz.outcome import Verdict
from vlafuzz.policies.registry import known_policies
from vlafuzz.search.registry import STRATEGIES
from vlafuzz.space import load_operators
from vlafuzz.tasks.tabletop import TASKS

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
EXAMPLES = dict(re.findall(r"^### ([^\n]+)\n[^#]*?```python\n(.*?)```", README, re.DOTALL | re.MULTILINE))
OWN_POLICY, OWN_STRATEGY = EXAMPLES["Your own policy"], EXAMPLES["Your own strategy"]


@pytest.mark.parametrize("name", COMMANDS)
def test_readme_names_every_command(name):
    assert f"`vlafuzz {name}" in README


@pytest.mark.parametrize("name", list(load_operators().operators))
def test_readme_has_a_row_for_every_operator(name):
    assert re.search(rf"^\| \d+ \| `{name}`", README, flags=re.MULTILINE)


@pytest.mark.parametrize("name", TASKS)
def test_readme_names_every_task(name):
    assert f"`{name}`" in README


@pytest.mark.parametrize(("kind", "names"), [("policy", known_policies()), ("strategy", STRATEGIES)])
def test_readme_has_a_row_for_every_policy_and_strategy_and_for_your_own(kind, names):
    table = README.partition(f"| {kind} | is |\n")[2].partition("\n\n")[0]
    first = " ".join(re.findall(r"^\| (.*?) \|", table, re.MULTILINE))
    assert {*names, "python:pkg.mod:factory"} <= set(re.findall(r"`(.*?)`", first))


@pytest.fixture
def save(tmp_path, monkeypatch):
    """Saves an example as ``mine.py``, where vlafuzz is then called."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield (tmp_path / "mine.py").write_text
    sys.modules.pop("mine", None)


def test_the_example_of_an_own_policy_runs_and_is_about_twenty_lines(save):
    from vlafuzz.conditions.conditions import Conditions
    from vlafuzz.policies.registry import make_policy
    from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator

    save(OWN_POLICY)
    evaluator = ManiSkillEvaluator(
        Conditions(task="pick-up", min_distance=0.15), make_policy("python:mine:make"), CATALOGUE
    )
    outcome = evaluator.evaluate([nominal("pick-up")])[0]
    evaluator.close()
    assert outcome.verdict is Verdict.FAILED
    assert outcome.lost_stage == "grasp"
    assert len([line for line in OWN_POLICY.splitlines() if line.strip()]) <= 22


def test_the_example_of_an_own_strategy_is_the_tested_one_and_runs(save, monkeypatch, capsys):
    assert Path(climb.__file__).read_text().endswith("\n\n" + OWN_STRATEGY)
    save(OWN_STRATEGY)
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: ClosedForm())
    assert main(["run", "--strategy", "python:mine:make", "--budget", "30", "--store", "a.db", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rollouts"] == 30


def output_of(example: str, folder: Path) -> str:
    (folder / "example.py").write_text(example)
    done = subprocess.run(
        [sys.executable, "example.py"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_example_from_python_lists_the_causes_of_two_failures_in_five_lines(tmp_path):
    example = EXAMPLES["From Python"]
    lines = output_of(example, tmp_path).splitlines()
    assert [re.match(r"\w+ pick-up\|\w+\|[\w+-]+", line) is not None for line in lines] == [True, True]
    assert len([line for line in example.splitlines() if line]) == 5


def test_the_example_of_the_page_on_python_lists_failures_and_causes(tmp_path):
    page = (Path(__file__).parent.parent / "docs" / "python.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    lines = output_of(example, tmp_path).splitlines()
    assert [line for line in lines if re.match(r"[0-9a-f]{32} (grasp|lift|success)", line)]


def test_the_gymnasium_example_runs(tmp_path):
    write_scenes(tmp_path / "failures.jsonl", [nominal("pick-up")])
    assert "tensor" in output_of(EXAMPLES["In gymnasium"] + "print(info['progress'])\n", tmp_path)


@pytest.mark.parametrize("script", ["demo", "test", "setup", "check"])
def test_scripts_are_executable_and_parse(script):
    path = Path(__file__).parent.parent / "scripts" / script
    assert path.stat().st_mode & 0o111
    assert subprocess.run([shutil.which("bash"), "-n", path], check=False).returncode == 0
