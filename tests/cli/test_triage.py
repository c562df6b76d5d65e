import json
import re
from pathlib import Path

import pytest

import vlafuzz.failures.triage.pipeline  # noqa: F401 - it imports the class that is replaced here
from tests.cli.typed import complaint, told, typed
from tests.failures.triage.planted import TILTED, Planted
from tests.failures.triage.runners import PlantedRunner, interrupted
from vlafuzz.cli import main
from vlafuzz.model import Outcome
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.rollouts import scene_runner as runner
from vlafuzz.store.store import Store


@pytest.fixture(autouse=True)
def store(tilted: Path, monkeypatch) -> Path:
    """There is no simulator."""
    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda store, run, **_: PlantedRunner([TILTED]))
    return tilted


def test_triage_prints_one_json_object(capsys):
    printed = told(capsys, ["triage", "a.db", "--json"])
    assert (printed["triaged"], printed["unjudged"]) == (3, 0)
    assert printed["buckets"] == {"minimal": 3, "witnessed": 0, "unproven": 0, "flaky": 0}
    assert printed["signatures"] == {"pick-up|grasp|camera-orientation:+yaw": 3}


@pytest.mark.parametrize(
    ("ends", "code", "said"),
    [
        (
            Outcome.error("policy: connect: no answer", unanswered=True),
            3,
            "error: 3 failures could not be judged: policy or simulator broke",
        ),
        (Outcome.invalid("static", "unfair"), 0, "3 failures could not be judged: no longer fair"),
    ],
)
def test_findings_that_could_not_be_judged_say_why(ends: Outcome, code: int, said: str, monkeypatch, capsys):
    monkeypatch.setattr(PlantedRunner, "evaluate", lambda _, scenes, numbers: [ends] * len(scenes))
    assert main(["triage", "a.db", "--json"]) == code
    printed = capsys.readouterr()
    assert said in printed.err.splitlines()
    found = json.loads(printed.out)
    assert (found["unjudged"], found["broken"], found["triaged"]) == (3, 3 if code else 0, 0)


def test_it_prints_a_table_of_buckets_and_where_the_failures_are_listed(capsys):
    printed = typed(capsys, ["triage", "a.db"]).out
    assert re.search(r"witnessed +│ 3 \(100%\)", printed)
    assert "`vlafuzz report a.db` lists the failures" in printed


def test_it_goes_on_where_it_ended(capsys):
    for limit, done in ((2, 2), (2, 3), (2, 3)):
        assert told(capsys, ["triage", "a.db", "--limit", str(limit), "--json"])["triaged"] == done


def test_a_triage_whose_time_is_over_says_what_is_left(capsys):
    printed = typed(capsys, ["triage", "a.db", "--time", "0.000001s", "--json"])
    assert json.loads(printed.out)["triaged"] == 0
    assert "3 failures left: --time is over\nhint: continue with" in printed.err


def test_an_interruption_keeps_what_is_done_and_says_how_to_go_on(capsys, store: Path):
    with interrupted():
        assert "hint: continue with `vlafuzz triage a.db`" in typed(capsys, ["triage", "a.db"], code=130).err
    with Store.open(store) as opened:
        assert len(opened.triaged()) == 1


def test_findings_of_another_version_and_place_are_said_to_be_so(monkeypatch, capsys):
    class Elsewhere(PlantedRunner):
        changed, elsewhere = ("commit", "simulator"), "at another place: AVX2 instead of AVX512"

    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda store, run, **_: Elsewhere([TILTED]))
    made = "by another version: its commit, simulator differ and at another place: AVX2 instead of AVX512;"
    assert f"run 1 was made {made}" in typed(capsys, "triage a.db").err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.db"], "error: none.db: no such store"),
        (["scenes.jsonl"], "error: scenes.jsonl: is not a store of vlafuzz"),
        (["a.db", "--limit", "0"], "error: --limit: expected at least 1, got 0"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(arguments, said, capsys):
    write_scenes(Path("scenes.jsonl"), [Planted([TILTED]).finding(0)])
    assert complaint(capsys, ["triage", *arguments]).startswith(said)
