"""The same comparison again: it does what is missing, and refuses runs that do not belong to it."""

import json
from pathlib import Path

import pytest

from tests.cli.comparing import IDLE, compare, complaint, dark, runs, timeless, without_simulator
from tests.doubles import ClosedForm, Gone, Raising
from tests.failures.triage.runners import PlantedRunner
from vlafuzz.campaign import launch
from vlafuzz.cli import main
from vlafuzz.failures.triage import scene_runner as runner
from vlafuzz.model.outcome import Outcome
from vlafuzz.store.store import Store


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch) -> Path:
    return without_simulator(tmp_path, monkeypatch)


def test_done_twice_nothing_is_run_again(capsys, monkeypatch):
    compare("--json")
    first = capsys.readouterr().out
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: Raising(KeyboardInterrupt()))
    monkeypatch.setattr(runner, "SimulatorSceneRunner", None)
    compare("--json")
    assert capsys.readouterr().out == first


def test_a_larger_limit_goes_on_with_what_was_triaged(monkeypatch, capsys):
    compare("--triage-rollouts", "1")
    with Store.open(Path("a.db")) as store:
        first = store.triaged()
    compare("--triage-rollouts", "100")
    with Store.open(Path("a.db")) as store:
        both = store.triaged()
    assert [row.seconds for row in both[: len(first)]] == [row.seconds for row in first]
    assert len(both) > len(first) > 0
    monkeypatch.setattr(runner, "SimulatorSceneRunner", None)
    capsys.readouterr()
    compare("--triage-rollouts", "50", "--json")
    assert all(run["triage_rollouts"] <= 50 for run in json.loads(capsys.readouterr().out)["runs"])


class Interrupted(PlantedRunner):
    """Ctrl-C in its second finding."""

    def renew(self) -> None:
        super().renew()
        if self.renewed == 2:
            raise KeyboardInterrupt


def test_triage_goes_on_after_an_interruption(monkeypatch, capsys):
    compare("--store", "whole.db", "--triage-rollouts", "200", "--json")
    whole = json.loads(capsys.readouterr().out)
    with monkeypatch.context() as patched:
        patched.setattr(runner, "SimulatorSceneRunner", lambda *_, **__: Interrupted([dark]))
        compare("--triage-rollouts", "200", code=130)
    assert "hint: the same command continues" in capsys.readouterr().err
    compare("--triage-rollouts", "200", "--json")
    document = json.loads(capsys.readouterr().out)
    assert list(map(timeless, document["runs"])) == list(map(timeless, whole["runs"]))


def test_more_repeats_and_strategies_only_add_runs():
    compare("--repeats", "1")
    compare("--strategies", "feedback,nsga2,random")
    assert [row[:2] for row in runs()] == [
        ("random", 3), ("feedback", 3), ("nsga2", 3), ("feedback", 4), ("nsga2", 4), ("random", 4),
    ]  # fmt: skip


class Stopping(ClosedForm):
    """Ctrl-C in the 15th scene, counted over all runs."""

    left = 15

    def outcome(self, scene) -> Outcome:  # type: ignore[no-untyped-def]
        Stopping.left -= 1
        if Stopping.left < 0:
            raise KeyboardInterrupt
        return super().outcome(scene)


def test_the_same_command_goes_on_after_an_interruption(monkeypatch, capsys):
    compare("--store", "whole.db", "--json")
    whole = json.loads(capsys.readouterr().out)
    with monkeypatch.context() as patched:
        patched.setattr(Stopping, "left", 20)
        patched.setattr(launch, "make_evaluator", lambda *_: Stopping())
        compare(code=130)
    assert "hint: the same command continues" in capsys.readouterr().err
    assert [status for *_, status in runs()] == ["finished", "interrupted"]
    compare("--json")
    document = json.loads(capsys.readouterr().out)
    assert [row[:2] for row in runs()] == [row[:2] for row in runs("whole.db")]
    assert list(map(timeless, document["runs"])) == list(map(timeless, whole["runs"]))
    assert document["curves"] == whole["curves"]


def test_a_store_with_runs_of_other_conditions_is_refused(capsys):
    compare("--repeats", "1")
    other = "a.db: run 1 has other conditions:"
    assert f"{other} budget 12, not 13" in complaint(capsys, "--budget", "13")
    assert f"{other} task pick-up, not put-on" in complaint(capsys, "--task", "put-on")
    assert f"{other} other operators, or other ranges" in complaint(capsys, "--vary", "light")
    assert len(runs()) == 2


def test_a_run_that_others_answered_is_refused(capsys):
    for _ in range(2):
        args = ("--budget", "12", "--seed", "3", "--store", "a.db")
        for strategy in ("random", "python:tests.doubles:make_random_again"):
            assert main(["run", *IDLE, "--unchecked", "--strategy", strategy, *args]) == 0
    message = complaint(capsys, "--strategies", "random,python:tests.doubles:make_random_again", "--repeats", "1")
    assert "run 2 reused" in message


def test_a_policy_that_is_gone_ends_it_and_the_same_command_goes_on(monkeypatch, capsys, folder: Path):
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: Gone(after=20))
    assert "8 scenes in a row had no answer" in complaint(capsys, code=3)
    assert "interrupted" in [status for *_, status in runs()]
    assert not (folder / "out" / "compare.json").exists()
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: ClosedForm())
    compare()
    assert {status for *_, status in runs()} == {"finished"}
