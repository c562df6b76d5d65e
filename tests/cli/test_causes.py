"""``vlafuzz run`` with a strategy that looks for causes ends with them."""

import re
from pathlib import Path

import pytest

from tests.cli.typed import told, typed
from tests.failures.triage.planted import DARK, TILTED
from tests.failures.triage.runners import PlantedEvaluator, PlantedRunner, interrupted
from vlafuzz.campaign import config
from vlafuzz.cli import main
from vlafuzz.failures.triage.pipeline import PER_CAUSE
from vlafuzz.rollouts import scene_runner
from vlafuzz.store.store import Store

RUN = ("run", "--policy", "python:tests.doubles:make_idle", "--unchecked", "--store", "a.db")
CAUSES = (*RUN, "--strategy", "causes", "--budget", "120")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch) -> Path:
    """Runs happen in a folder of their own, without a simulator: policies fail in the dark, or if tilted."""
    faults = [lambda scene: DARK(scene) or TILTED(scene)]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(config, "make_evaluator", lambda *_: PlantedEvaluator(faults))
    monkeypatch.setattr(scene_runner, "SimulatorSceneRunner", lambda *_, **__: PlantedRunner(faults))
    return tmp_path


def test_a_run_ends_with_what_fails_how_sure_that_is_and_one_command_and_triage_lists_its_causes(capsys):
    what, sure, step = typed(capsys, CAUSES).out.splitlines()[-3:]
    assert re.fullmatch(r"Fails when the light is at most .* times the usual, or the camera .*\.", what)
    rollouts, certified, causes = re.search(r": (\d+) rollouts, (\d) of (\d) causes certified$", sure).groups()
    assert (int(rollouts) > 120, certified) == (True, causes)
    assert re.fullmatch(r"Next, to see it: `vlafuzz report a.db --limit \d --out a.html --trust` \(about .*\)", step)
    again = ["triage", "a.db", "--time", "0.001s"]  # too short for any other failure
    (printed,) = told(capsys, [*again, "--json"])["runs"]
    causes = {cause["signature"]: cause for cause in printed["causes"]}
    assert causes.keys() >= {"pick-up|grasp|light:dark", "pick-up|grasp|camera-orientation:+yaw"}
    first = causes["pick-up|grasp|light:dark"]
    assert (first["bucket"], first["lost_stage"], first["witness"]) == ("minimal", "grasp", "seeing")
    assert first["rate"]["failures"] == first["rate"]["rollouts"] >= 4
    shares = [cause["share"]["value"] for cause in printed["causes"] if cause["bucket"] == "minimal"]
    assert shares == sorted(shares, reverse=True)
    assert min(shares) > 0
    probability = printed["probability"]
    assert 0 <= probability["low"] <= probability["value"] <= probability["high"] <= 1
    certification = printed["certification"]
    assert 2 <= certification["certified"] <= certification["causes"]
    with Store.open(Path("a.db")) as store:
        assert certification["rollouts"] == sum(row.policy_rollouts for row in store.triaged())
        assert {row.scene for row in store.triaged()} == {one.scene for one in store.causes(1).causes}
    shown = typed(capsys, again).out
    assert "light (dark): fails from intensity × 0." in shown
    assert "camera-orientation (+yaw): fails from yaw 2." in shown
    assert re.search(r"\d+ more rollouts certified \d+ of \d+ causes", shown)
    assert "unexplained: " in shown


def test_triage_certifies_the_commonest_cause_first_and_then_the_next_one(capsys):
    told(capsys, [*RUN, "--strategy", "causes", "--budget", "90", "--no-certify", "--json"])
    (one,) = told(capsys, ["triage", "a.db", "--limit", "1", "--json"])["runs"]
    assert one["certification"]["certified"] == 1 < one["certification"]["causes"]
    assert [cause["bucket"] for cause in one["causes"]][:2] == ["minimal", "observed"]
    (again,) = told(capsys, ["triage", "a.db", "--time", "0.001s", "--json"])["runs"]
    assert again["causes"] == one["causes"]
    (two,) = told(capsys, ["triage", "a.db", "--limit", "1", "--json"])["runs"]
    assert two["certification"]["certified"] == 2


def test_a_run_goes_on_with_what_certification_leaves(capsys):
    alone = told(capsys, [*RUN, "--strategy", "causes", "--budget", "90", "--no-certify", "--json"])
    whole = told(capsys, [*RUN, "--strategy", "causes", "--budget", "90", "--json", "--store", "b.db"])
    assert alone["rollouts"] == 90 < whole["rollouts"]
    assert whole["rollouts"] + whole["certification"]["rollouts"] <= 2 * 90 + PER_CAUSE
    assert whole["probability"] == alone["probability"]


def test_without_certification_the_causes_are_those_of_the_strategy_and_failures_are_no_rate(capsys):
    shown = typed(capsys, [*CAUSES, "--no-certify"]).out
    assert re.search(r"· not certified · [0-9a-f]{12}", " ".join(shown.split()))
    what, sure, step = shown.splitlines()[-3:]
    assert re.fullmatch(r"Probably fails when .*\.", what)
    rate = r"[\d.]+% of random scenes fail \([\d.]+–[\d.]+%\)"
    assert re.fullmatch(rf"{rate}: 120 rollouts, 0 of \d causes certified", sure)
    triage = r"`vlafuzz triage a.db --limit \d --trust` \(about .*; --time bounds it\)"
    assert re.fullmatch(f"Next, to certify what is left: {triage}", step)
    triaged = typed(capsys, ["triage", "a.db", "--limit", "1"]).out
    assert "certified 1 of " in triaged
    assert "not certified means: a few single rollouts suggest these operators" in triaged


def test_after_another_strategy_triage_finds_the_causes(capsys):
    assert main([*RUN, "--strategy", "random", "--budget", "10"]) == 0
    assert "Next, to find the causes: `vlafuzz triage a.db --trust` (about " in capsys.readouterr().out
    printed = told(capsys, [*RUN, "--strategy", "random", "--budget", "10", "--json"])
    assert [printed[key] for key in ("causes", "unexplained", "probability", "certification")] == [None] * 4


def test_a_guided_run_that_draws_nothing_at_random_tells_no_failure_probability(capsys):
    shown = typed(capsys, [*RUN, "--strategy", "nsga2", "--budget", "10"]).out
    assert "how often it fails is unknown without random scenes: 10 rollouts" in shown
    assert "% of random scenes fail" not in shown


def test_an_interrupted_certification_lists_the_causes_and_says_how_to_go_on(capsys):
    with interrupted():
        printed = typed(capsys, [*CAUSES], code=130)
    assert printed.out.count("· certified: ") == 1 <= printed.out.count("· not certified")
    assert "interrupted: all finished causes are stored\nhint: `vlafuzz triage a.db --trust` goes on" in printed.err
    assert re.search(r"to certify what is left: `vlafuzz triage a.db --limit \d --trust`", printed.out)
    assert typed(capsys, ["triage", "a.db", "--limit", "1"]).out.count("· certified: ") == 2


def test_no_cause_is_begun_for_which_there_is_no_time(capsys, monkeypatch):
    for module in ("vlafuzz.cli.runs", "vlafuzz.failures.triage.pipeline"):
        monkeypatch.setattr(f"{module}.pace", lambda *_: 1e4)
    printed = typed(capsys, [*CAUSES, "--time", "5m"])
    assert "no cause is certified: one takes about" in printed.err
    assert re.search(r"`vlafuzz triage a.db --limit .*` \(about [\d.]+ h; --time bounds it.*\)", printed.out)
    assert "· certified" not in printed.out
