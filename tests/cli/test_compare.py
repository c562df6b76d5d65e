"""``vlafuzz compare``, also again: what it shows, writes and refuses, and how it goes on."""

import json
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from tests.cli.typed import complaint
from tests.doubles import ClosedForm, Gone, Raising
from tests.failures.triage.runners import PlantedRunner, interrupted
from tests.report.stores import MANIFEST, MadeUpFilms
from vlafuzz.campaign import config
from vlafuzz.cli import main
from vlafuzz.model import Actions, Outcome, Scene
from vlafuzz.rollouts import scene_runner as runner
from vlafuzz.store.store import Store
from vlafuzz.worlds.evaluator import Film
from vlafuzz.worlds.tabletop import renderer
from vlafuzz.worlds.tabletop.renderer import Renderer

IDLE = ("--policy", "python:tests.doubles:make_idle")
_SMALL = "--strategies random,nsga2 --budget 12 --repeats 2 --seed 3 --triage-rollouts 0"
SMALL = (*IDLE, *_SMALL.split())
HERE = ("--store", "a.db", "--out", "compare.html")


def dark(scene: Scene) -> bool:
    return scene.light.intensity < 0.5


class Filmed(PlantedRunner):
    def film(self, scene: Scene, actions: Actions | None = None) -> Film:
        return MadeUpFilms()(MANIFEST, scene, actions)


def without_simulator(tmp_path: Path, monkeypatch) -> Path:
    """In the dark the policy fails."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(config, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda *_, **__: Filmed([dark]))
    monkeypatch.setattr(renderer, "probe_once", lambda: Renderer("made up", None, None))
    return tmp_path


def compare(*flags: str, code: int = 0) -> None:
    assert main(["compare", *SMALL, *HERE, *flags]) == code


def runs(store: str = "a.db") -> list[tuple[str, int, str]]:
    with Store.open(Path(store)) as opened:
        return [(run.manifest.strategy, run.manifest.seed, run.status) for run in opened.runs()]


def told_by(capsys, *flags: str) -> dict[str, Any]:
    """The JSON of a comparison."""
    capsys.readouterr()
    compare(*flags, "--json")
    return json.loads(capsys.readouterr().out)


def refused(capsys, *flags: str, code: int = 2) -> str:
    return complaint(capsys, ["compare", *SMALL, *HERE, *flags], code=code)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch) -> Path:
    return without_simulator(tmp_path, monkeypatch)


@dataclass(frozen=True)
class Made:
    """A comparison: what it printed, also as JSON, and the folder of its store."""

    printed: str
    document: dict[str, Any]
    folder: Path


def made(folder: Path, *flags: str) -> Made:
    """A comparison takes seconds, so that tests share some."""
    with pytest.MonkeyPatch.context() as patched:
        without_simulator(folder, patched)
        with redirect_stdout(StringIO()) as out:
            compare(*flags)
        with redirect_stdout(StringIO()) as document:
            compare(*flags, "--json")
    return Made(out.getvalue(), json.loads(document.getvalue()), folder)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return made(tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def triaged(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return made(tmp_path_factory.mktemp("triaged"), "--triage-rollouts", "200")


def test_every_strategy_has_the_same_seeds_and_all_runs_are_in_one_store(plain: Made):
    assert [row[:2] for row in runs(str(plain.folder / "a.db"))] == [
        ("random", 3), ("nsga2", 3), ("random", 4), ("nsga2", 4),
    ]  # fmt: skip


def test_every_run_pays_for_its_own_rollouts(capsys):
    document = told_by(capsys, "--strategies", "random,python:tests.doubles:make_random_again")
    assert [row["rollouts"] for row in document["runs"]] == [12] * 4
    failures = [row["failures"] for row in document["runs"]]
    assert failures[:2] == failures[2:]  # the same scenes were proposed


def test_the_json_has_all_figures(plain: Made):
    document = plain.document
    assert (document["budget"], document["repeats"]) == (12, 2)
    assert (document["seeds"], document["reference"]) == ([3, 4], "random")
    standing = document["standings"][1]
    assert (standing["strategy"], standing["means"]["causes"]) == ("nsga2", None)
    assert standing["means"]["failures"]["value"] > 0


def test_strategies_are_judged_by_the_causes_that_triage_certifies(triaged: Made):
    document = triaged.document
    assert document["triage_rollouts"] == 200
    for standing in document["standings"]:
        assert standing["means"]["causes"]["value"] == 1.0
        assert standing["causes"] == {"pick-up|grasp|light:dark": 2}
    assert [pair["measure"] for pair in document["against"]] == ["causes", "failures"]
    assert all(0 < run["triage_rollouts"] <= 200 for run in document["runs"])
    assert "12 rollouts and 200 of triage, 2 repeats" in " ".join(triaged.printed.split())
    assert "nsga2: certified causes beside random: 2 repeats are too few to tell" in triaged.printed


def test_the_page_has_a_card_for_each_cause_with_the_runs_that_certified_it(triaged: Made):
    page = (triaged.folder / "compare.html").read_text()
    assert "vlafuzz report a.db --out report.html --trust" in page
    for standing in triaged.document["standings"]:
        for count in standing["causes"].values():
            assert f"<dt>runs of {standing['strategy']} certify it</dt><dd>{count} of " in page
    assert page.count("<article") == len({name for each in triaged.document["standings"] for name in each["causes"]})
    assert [page.count(f'<figure class="{kind}">') for kind in ("passes", "fails", "solves")] == [1, 1, 1]


def test_the_failure_probability_is_told_by_random_scenes_and_by_causes(capsys):
    document = told_by(capsys, "--strategies", "random,nsga2,causes", "--triage-rollouts", "0")
    random, nsga2, causes = document["standings"]
    assert random["probability"]["value"] == pytest.approx(random["means"]["failures"]["value"] / 12)
    assert nsga2["probability"] is None
    assert 0 <= causes["probability"]["low"] < causes["probability"]["value"] < causes["probability"]["high"] <= 1
    compared = [(pair["strategy"], pair["measure"]) for pair in document["against"]]
    assert compared == [("nsga2", "failures"), ("causes", "failures")]


def test_without_triage_failures_judge_and_it_says_so(plain: Made):
    assert "Nothing was triaged (--triage-rollouts 0)" in plain.printed
    too_few = "2 repeats are too few to tell, p is never below 0.5; 6 could"
    assert f"nsga2: failures beside random: {too_few}" in " ".join(plain.printed.split())
    assert "certified causes" not in plain.printed
    with Store.open(plain.folder / "a.db") as store:
        assert store.triaged() == []


def test_a_limit_that_is_too_low_for_one_failure_is_told(capsys):
    compare("--triage-rollouts", "5")
    assert "in 4 of 4 runs 5 rollouts are too few to triage one failure" in capsys.readouterr().out


def test_failures_that_cannot_be_judged_are_told_and_left_for_the_next_time(monkeypatch, capsys):
    flags = ("--strategies", "random", "--triage-rollouts", "50")
    with monkeypatch.context() as patched:
        patched.setattr(PlantedRunner, "evaluate", lambda _, scenes, numbers: [Outcome.error("refused")] * len(scenes))
        compare(*flags)
    assert "failures could not be judged: the policy broke" in capsys.readouterr().err
    assert all(run["triaged"] for run in told_by(capsys, *flags)["runs"])


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (("--strategies", "random,radnom"), "unknown strategy 'radnom'"),
        (("--strategies", "random,random"), "--strategies: 'random' is there twice"),
        (("--strategies", ","), "--strategies: expected names, got ','"),
        (("--repeats", "0"), "--repeats: expected at least 1, got 0"),
        (("--triage-rollouts", "-1"), "--triage-rollouts: expected at least 0, got -1"),
        (("--out", "."), ".: is a folder"),
        (("--seed", "9223372036854775807"), "--seed: too large for 2 repeats"),
    ],
)
def test_a_wrong_flag_is_a_sentence_with_a_hint_and_makes_nothing(capsys, folder: Path, flags, says: str):
    assert says in refused(capsys, *flags)
    assert list(folder.iterdir()) == []


def test_a_policy_that_breaks_ends_it(monkeypatch, capsys):
    monkeypatch.setattr(config, "make_evaluator", lambda *_: Raising(ConnectionError("refused")))
    assert "ended in an error, first: ConnectionError: refused" in refused(capsys, code=3)


def test_done_twice_nothing_is_run_again(capsys, monkeypatch):
    compare("--json")
    first = capsys.readouterr().out
    monkeypatch.setattr(config, "make_evaluator", lambda *_: Raising(KeyboardInterrupt()))
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
    again = told_by(capsys, "--triage-rollouts", "50", "--no-videos")
    assert all(run["triage_rollouts"] <= 50 for run in again["runs"])


def test_triage_goes_on_after_an_interruption(capsys):
    whole = told_by(capsys, "--store", "whole.db", "--triage-rollouts", "200")
    with interrupted():
        compare("--triage-rollouts", "200", code=130)
    assert "hint: the same command continues" in capsys.readouterr().err
    assert told_by(capsys, "--triage-rollouts", "200")["runs"] == whole["runs"]


def test_more_repeats_and_strategies_only_add_runs():
    compare("--repeats", "1")
    compare("--strategies", "nsga2,severity,random")
    assert [row[:2] for row in runs()] == [
        ("random", 3), ("nsga2", 3), ("severity", 3), ("nsga2", 4), ("severity", 4), ("random", 4),
    ]  # fmt: skip


def test_the_same_command_goes_on_after_an_interruption(monkeypatch, capsys):
    whole = told_by(capsys, "--store", "whole.db")
    with monkeypatch.context() as patched:
        stopping = Raising(KeyboardInterrupt(), after=20)  # scenes of all runs
        patched.setattr(config, "make_evaluator", lambda *_: stopping)
        compare(code=130)
    assert "hint: the same command continues" in capsys.readouterr().err
    assert [status for *_, status in runs()] == ["finished", "interrupted"]
    document = told_by(capsys)
    assert [row[:2] for row in runs()] == [row[:2] for row in runs("whole.db")]
    assert document["runs"] == whole["runs"]


def test_a_run_that_others_answered_is_refused(capsys):
    for _ in range(2):
        args = ("--budget", "12", "--seed", "3", "--store", "a.db")
        for strategy in ("random", "python:tests.doubles:make_random_again"):
            assert main(["run", *IDLE, "--unchecked", "--strategy", strategy, *args]) == 0
    message = refused(capsys, "--strategies", "random,python:tests.doubles:make_random_again", "--repeats", "1")
    assert "run 2 reused" in message


def test_a_policy_that_is_gone_ends_it_and_the_same_command_goes_on(monkeypatch, capsys):
    monkeypatch.setattr(config, "make_evaluator", lambda *_: Gone(after=20))
    assert "8 scenes in a row had no answer" in refused(capsys, code=3)
    assert "interrupted" in [status for *_, status in runs()]
    monkeypatch.setattr(config, "make_evaluator", lambda *_: ClosedForm())
    compare()
    assert {status for *_, status in runs()} == {"finished"}
