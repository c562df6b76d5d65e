"""``--resume`` and a run beside random: with real spaces and strategies, without a simulator."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.cli.typed import complaint, told
from tests.doubles import Raising
from vlafuzz.campaign import config
from vlafuzz.campaign.config import further
from vlafuzz.campaign.forecast import Forecast, Speed
from vlafuzz.campaign.resume import resume
from vlafuzz.cli import main
from vlafuzz.common.plugins import EVERYTHING, trusting
from vlafuzz.search.registry import STRATEGIES
from vlafuzz.store.store import Store

pytestmark = pytest.mark.usefixtures("folder")
IDLE = ("--policy", "python:tests.doubles:make_idle", "--unchecked", "--no-certify", "--strategy", "random")


def run(*flags: str, code: int = 0) -> None:
    assert main(["run", *IDLE, *flags]) == code


def cut(monkeypatch, *flags: str, after: int = 5) -> None:
    """A run that Ctrl-C ends."""
    with monkeypatch.context() as patched:
        patched.setattr(config, "make_evaluator", lambda *_: Raising(KeyboardInterrupt(), after=after))
        run(*flags, code=130)


def proposed(store: str, number: int = 1) -> list[tuple[object, ...]]:
    with Store.open(Path(store)) as opened:
        assert opened.runs()[number - 1].status == "finished"
        return [
            (trial.scene, trial.outcome.verdict, trial.duplicate, trial.genome.tolist())
            for trial in opened.trials(number)
            if trial.genome is not None
        ]


def printed(capsys) -> str:
    return capsys.readouterr().out


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_run_is_gone_on_with_by_its_store_alone(monkeypatch, capsys, strategy: str):
    flags = ("--strategy", strategy, "--budget", "36", "--seed", "3", "--vary", "light,target-position")
    run(*flags, "--store", "whole.db", "--json")
    cut(monkeypatch, *flags, "--store", "a.db", after=25)
    expected = json.loads(capsys.readouterr().out)
    summary = told(capsys, ["run", "--resume", "--trust", "--no-certify", "--store", "a.db", "--json"])
    assert proposed("a.db") == proposed("whole.db")
    for row in (summary, expected):
        for name in ("store", "seconds"):
            del row[name]
    assert summary == expected


def test_a_run_with_a_predecessor_is_gone_on_with_by_the_same_one_only(monkeypatch, capsys):
    run("--budget", "30", "--seed", "8", "--store", "old.db")
    flags = ("--strategy", "causes", "--budget", "36", "--like", "old.db")
    run(*flags, "--store", "whole.db")
    monkeypatch.setattr("sys.argv", ["vlafuzz", "run", *flags])
    cut(monkeypatch, *flags, "--store", "a.db", after=25)
    assert "a.db: run 1 was begun with --like" in complaint(capsys, ["run", "--resume", "--trust", "--store", "a.db"])
    resumed = ["run", "--resume", "--trust", "--no-certify", "--store", "a.db", "--like", "old.db"]
    assert main(resumed) == 0
    assert proposed("a.db") == proposed("whole.db")


def test_only_a_run_that_has_ended_goes_on_beyond_its_budget(monkeypatch):
    flags = ("--strategy", "causes", "--budget", "36", "--seed", "3", "--store", "a.db")
    cut(monkeypatch, *flags, after=25)
    with trusting(EVERYTHING):
        plan = resume({"store": Path("a.db")})
    assert further(plan, 1) is None
    run(*flags, "--resume")
    assert further(plan, 1).more > 0


def test_the_same_command_with_resume_goes_on_with_it(monkeypatch):
    cut(monkeypatch, "--budget", "20", "--task", "put-on")
    run("--budget", "20", "--task", "put-on", "--resume")
    assert len(proposed("runs/put-on-python-tests.doubles-make_idle-0.db")) >= 20


def test_only_what_is_left_is_foreseen(monkeypatch):
    cut(monkeypatch, "--budget", "20", "--store", "a.db", after=5)
    with Store.open(Path("a.db")) as store:
        done = sum(len(trial.outcome.rollouts) for trial in store.trials(1))
    with trusting(EVERYTHING):
        plan = resume({"store": Path("a.db")})
    speed = Speed(1.0)
    rest, whole = (Forecast(part, speed, certify=False) for part in (plan, replace(plan, done=0)))
    assert 0 < done == plan.done
    assert rest.run == pytest.approx(whole.run * (20 - done) / 20)
    assert f": the other {20 - done} rollouts of up to 80 steps take" in str(rest)


def test_operators_come_from_the_store_though_their_file_is_gone(monkeypatch, folder: Path):
    light = "{intensity: {low: 0.5, high: 2.0, step: 0.05, nominal: 1}}"
    (folder / "mine.yaml").write_text(f"extends: paper\noperators: {{light: {light}}}\n")
    flags = ("--budget", "20", "--strategy", "random", "--operators", "mine.yaml", "--task", "put-in")
    run(*flags, "--store", "whole.db")
    cut(monkeypatch, *flags, "--store", "a.db")
    (folder / "mine.yaml").unlink()
    assert main(["run", "--resume", "--trust", "--store", "a.db"]) == 0
    assert proposed("a.db") == proposed("whole.db")


def test_the_newest_run_that_fits_the_flags_is_gone_on_with(monkeypatch):
    for seed in ("1", "2", "3"):
        cut(monkeypatch, "--budget", "20", "--store", "a.db", "--seed", seed, after=3)
    for flags, expected in (
        (["--seed", "2"], ["interrupted", "finished", "interrupted"]),
        ([], ["interrupted", "finished", "finished"]),
    ):
        assert main(["run", "--resume", "--trust", "--store", "a.db", *flags]) == 0
        with Store.open(Path("a.db")) as store:
            assert [row.status for row in store.runs()] == expected


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--seed", "4"], "seed 0, not 4"),
        (["--budget", "21"], "budget 20, not 21"),
        (["--task", "put-in"], "task pick-up, not put-in"),
        (["--policy", "frozen"], "not frozen"),
        (["--config", "stop-early=true"], "stop_early False, not True"),
        (["--vary", "light"], "other operators, or other ranges"),
        (["--operators", "paper"], "other operators, or other ranges"),
    ],
)
def test_other_flags_than_then_are_refused(monkeypatch, capsys, flags: list[str], says: str):
    cut(monkeypatch, "--budget", "20", "--store", "a.db")
    message = complaint(capsys, ["run", "--resume", "--trust", "--store", "a.db", *flags])
    assert "a.db: no run that ended early fits: run 1 has" in message
    assert says in message


def test_another_version_than_then_is_refused(monkeypatch, capsys):
    cut(monkeypatch, "--budget", "20", "--store", "a.db")
    monkeypatch.setattr("vlafuzz.worlds.provenance.commit", lambda: "another")
    message = complaint(capsys, ["run", "--resume", "--trust", "--store", "a.db"])
    assert "run 1 was made by another version: its commit differs (" in message
    assert "another now)" in message


def test_a_run_of_another_or_an_unknown_place_is_not_resumed_and_answers_nothing(monkeypatch, capsys):
    flags = ("--budget", "20", "--strategy", "random", "--store", "a.db")
    cut(monkeypatch, *flags)
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", "AVX2")
    message = complaint(capsys, ["run", "--resume", "--trust", "--store", "a.db"])
    assert "a.db: run 1 was made at another place: " in message
    assert "resume it there, or leave out --resume to start a new run" in message
    run(*flags)
    assert not any(duplicate for _, _, duplicate, _ in proposed("a.db", 2))
    with monkeypatch.context() as earlier:
        earlier.setattr("vlafuzz.worlds.provenance.here", lambda *_, **__: "")
        cut(monkeypatch, "--budget", "20", "--store", "b.db")
    message = complaint(capsys, ["run", "--resume", "--trust", "--store", "b.db"])
    assert "b.db: run 1 was made at a place that is not known" in message
    assert "hint: leave out --resume to start a new run, which reuses none of its outcomes" in message


def test_there_must_be_something_to_go_on_with(capsys):
    assert "a.db: no such store" in complaint(capsys, ["run", "--resume", "--trust", "--store", "a.db"])
    run("--budget", "3", "--store", "a.db")
    message = complaint(capsys, ["run", "--resume", "--trust", "--store", "a.db"])
    assert "no run ended early (runs: 1 finished)" in message
    assert "leave out --resume" in message


def test_a_second_run_in_a_store_is_told_at_once_who_writes(monkeypatch, capsys):
    monkeypatch.setattr(config, "make_evaluator", lambda *_: pytest.fail("the simulator was started first"))
    with Store.open(Path("a.db"), "write"):
        message = complaint(capsys, ["run", *IDLE, "--store", "a.db"])
    assert "is writing to it" in message
    assert "give another store" in message


def test_a_strategy_says_what_it_chose_by_itself(capsys):
    flags = ("--strategy", "nsga2", "--budget", "90")
    run(*flags, "--store", "a.db")
    assert re.search(r"strategy\W+population of 8, 11 generations", printed(capsys))
    run(*flags, "--store", "b.db", "--json")
    assert json.loads(printed(capsys))["about"] == "population of 8, 11 generations"
    run("--budget", "5", "--store", "a.db")
    assert "population" not in printed(capsys)


def test_a_run_of_narrower_ranges_is_gone_on_with_in_these(monkeypatch, capsys):
    flags = ("--strategy", "random", "--budget", "12", "--seed", "3", "--severity", "0.3")
    run(*flags, "--store", "whole.db")
    cut(monkeypatch, *flags, "--store", "parted.db")
    run("--resume", "--store", "parted.db")
    assert proposed("parted.db") == proposed("whole.db")
    assert max(abs(trial[0].camera.pitch) for trial in proposed("whole.db")) <= 1.5
    cut(monkeypatch, *flags, "--store", "other.db")
    said = complaint(capsys, ["run", *IDLE, "--resume", "--severity", "0.5", "--store", "other.db"])
    assert "severity 0.3, not 0.5" in said


def test_the_severity_at_which_one_half_fails_is_found_first(capsys):
    run("--severity", "auto", "--budget", "80", "--strategy", "random", "--store", "a.db")
    shown = capsys.readouterr()
    assert "one half fails at severity" in shown.out
    told = re.search(r"severity ([\d.]+): about one half fails there", shown.err)
    assert told
    with Store.open(Path("a.db")) as store:
        budgets = [(found.manifest.strategy, found.manifest.budget) for found in store.runs()]
        assert budgets == [("severity", 20), ("random", 60)]
        assert json.loads(store.runs()[1].manifest.operators).get("severity", 1.0) == float(told[1])
