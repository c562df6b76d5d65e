"""``vlafuzz compare``: with real spaces and strategies, without a simulator."""

import csv
import io
import json
import re
from pathlib import Path

import pytest

from tests.doubles import ClosedForm, Gone, Raising
from tests.triage.runners import PlantedRunner
from vlafuzz.campaign import launch
from vlafuzz.cli import main
from vlafuzz.outcome import Outcome
from vlafuzz.store.store import Store
from vlafuzz.triage import scene_runner as runner

IDLE = ("--policy", "python:tests.doubles:make_idle")
SMALL = (*IDLE, "--strategies", "random,feedback", "--budget", "12", "--repeats", "2", "--seed", "3")
HERE = ("--store", "a.db", "--out", "out")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """In the dark the policy fails; the expert solves what is left of the table's middle."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(launch, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
    monkeypatch.setattr(
        runner,
        "SimulatorSceneRunner",
        lambda *_, **__: PlantedRunner([], solvable=lambda scene: scene.targets[0].y > 0),
    )
    return tmp_path


def compare(*flags: str, code: int = 0) -> None:
    assert main(["compare", *SMALL, *HERE, *flags]) == code


def runs(store: str = "a.db") -> list[tuple[str, int, str]]:
    with Store.open(Path(store)) as opened:
        return [(run.manifest.strategy, run.manifest.seed, run.status) for run in opened.runs()]


def complaint(capsys: pytest.CaptureFixture[str], *flags: str) -> str:
    capsys.readouterr()
    assert main(["compare", *SMALL, *HERE, *flags]) == 2
    shown = capsys.readouterr().err.splitlines()
    assert [line.partition(": ")[0] for line in shown] == ["error", "hint"], shown
    return shown[0]


def test_every_strategy_has_the_same_seeds_and_all_runs_are_in_one_store():
    compare()
    assert [row[:2] for row in runs()] == [
        ("random", 3), ("feedback", 3), ("random", 4), ("feedback", 4),
    ]  # fmt: skip


def test_every_run_pays_for_its_own_rollouts(capsys: pytest.CaptureFixture[str]):
    compare("--strategies", "random,python:tests.doubles:make_random_again", "--json")
    document = json.loads(capsys.readouterr().out)
    assert [row["rollouts"] for row in document["runs"]] == [12] * 4
    failures = [row["failures"] for row in document["runs"]]
    assert failures[:2] == failures[2:]  # the same scenes were proposed


def test_the_json_has_all_figures(capsys: pytest.CaptureFixture[str], folder: Path):
    compare("--json")
    document = json.loads(capsys.readouterr().out)
    assert (document["budget"], document["repeats"], document["seeds"], document["reference"]) == (
        12,
        2,
        [3, 4],
        "random",
    )
    standing = document["standings"][1]
    assert standing["strategy"] == "feedback"
    assert standing["figures"]["cells"]["median"] > 0
    assert standing["solvable"]["of"] == standing["failures"]
    assert {pair["measure"] for pair in document["against"]} >= {"cells", "failures", "cid", "qd_score"}
    assert json.loads((folder / "out/compare.json").read_text()) == document


def test_with_two_repeats_it_says_that_they_are_too_few(capsys: pytest.CaptureFixture[str]):
    compare()
    assert "2 repeats are too few to tell, p is never below 1; 9 could" in capsys.readouterr().out


def test_plots_and_tables_are_in_the_folder(folder: Path, capsys: pytest.CaptureFixture[str]):
    compare()
    assert {path.name for path in (folder / "out").iterdir()} == {
        "compare.html", "compare.json", "compare.md", "runs.csv", "curves.png", "figures.png",
        "witnesses.jsonl",
    }  # fmt: skip
    assert (folder / "out/curves.png").read_bytes().startswith(b"\x89PNG")
    assert "written to out: compare.html, curves.png, figures.png" in capsys.readouterr().err


def test_the_page_shows_plots_tables_and_tests_and_needs_no_other_file(folder: Path):
    compare()
    page = (folder / "out/compare.html").read_text(encoding="utf-8")
    assert page.count('src="data:image/png;base64,iVBOR') == 2
    for part in ("Found: pick-up", "All repeats together", "Cost", "Against random", "too few repeats"):
        assert part in page
    assert "vlafuzz report a.db --out a.html" in page
    assert not re.search(r'(src|href)="(?!data:)', page)


def test_one_strategy_alone_has_a_page_without_tests(folder: Path):
    compare("--strategies", "random")
    page = (folder / "out/compare.html").read_text(encoding="utf-8")
    assert "All repeats together" in page
    assert "Against random" not in page
    assert "What can be said" not in page


def test_csv_has_a_row_a_strategy(capsys: pytest.CaptureFixture[str]):
    compare("--csv")
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [row["strategy"] for row in rows] == ["random", "feedback"]
    assert float(rows[0]["cells_median"]) > 0


def test_the_cost_of_searching_is_told_apart(capsys: pytest.CaptureFixture[str]):
    compare("--markdown")
    assert "| in rollouts | search | search share | store | store share |" in capsys.readouterr().out
    compare("--json")
    cost = json.loads(capsys.readouterr().out)["standings"][0]["figures"]
    assert 0 < cost["search_share"]["median"] + cost["store_share"]["median"] < 1


def test_markdown_can_be_pasted(capsys: pytest.CaptureFixture[str]):
    compare("--markdown")
    shown = capsys.readouterr().out
    assert "| strategy | failures | cells |" in shown
    assert "- feedback: distinct cells beside random: 2 repeats are too few to tell" in shown


def test_done_twice_nothing_is_run_again(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    compare("--json")
    first = capsys.readouterr().out
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: Raising(KeyboardInterrupt()))
    monkeypatch.setattr(runner, "SimulatorSceneRunner", None)
    compare("--json")
    assert capsys.readouterr().out == first


def in_the_dark(*_: object, **__: object) -> PlantedRunner:
    """The policy that the runs had, with an expert that solves all scenes."""
    return PlantedRunner([lambda scene: scene.light.intensity < 0.5])


def test_a_sample_is_triaged_when_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(runner, "SimulatorSceneRunner", in_the_dark)
    compare("--triage-sample", "2")
    shown = capsys.readouterr().out
    assert "2 of 2 (34.2–100%)" in shown
    assert "1 of 2 triaged" in shown
    monkeypatch.setattr(runner, "SimulatorSceneRunner", None)
    compare("--triage-sample", "2", "--json")
    document = json.loads(capsys.readouterr().out)["standings"][1]["evidence"]
    assert (document["triaged"], document["confirmed"], document["minimal"], document["signatures"]) == (
        2,
        2,
        2,
        1,
    )
    compare("--triage-sample", "2", "--csv")
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [row["evidence_signatures"] for row in rows] == ["1", "1"]
    compare("--triage-sample", "2", "--markdown")
    assert "| strategy | confirmed | witnessed | minimal | distinct signatures |" in capsys.readouterr().out


def test_a_larger_sample_goes_on_with_what_was_triaged(monkeypatch: pytest.MonkeyPatch):
    made: list[PlantedRunner] = []

    def make(*_: object, **__: object) -> PlantedRunner:
        made.append(in_the_dark())
        return made[-1]

    monkeypatch.setattr(runner, "SimulatorSceneRunner", make)
    compare("--triage-sample", "1")
    with Store.open(Path("a.db")) as store:
        first = len(store.triaged())
    compare("--triage-sample", "3")
    with Store.open(Path("a.db")) as store:
        assert len(store.triaged()) > first > 0
        assert len(store.triaged()) == sum(row.renewed for row in made)  # none of them twice


class Breaking(PlantedRunner):
    """The policy broke."""

    def evaluate(self, scenes, numbers):  # type: ignore[no-untyped-def]
        return [Outcome.error("refused") for _ in scenes]


def test_failures_that_cannot_be_judged_are_told_and_not_counted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda *_, **__: Breaking([]))
    compare("--strategies", "random", "--triage-sample", "2", "--json")
    printed = capsys.readouterr()
    assert "2 of the sampled failures could not be judged: the policy broke" in printed.err
    assert json.loads(printed.out)["standings"][0]["evidence"] is None


def test_nothing_is_triaged_by_default(capsys: pytest.CaptureFixture[str]):
    compare("--json")
    document = json.loads(capsys.readouterr().out)
    assert [row["evidence"] for row in document["standings"]] == [None, None]
    compare()
    assert "signatures" not in capsys.readouterr().out


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


def timeless(run: dict[str, object]) -> dict[str, object]:
    return {name: value for name, value in run.items() if not re.search("search|store|^seconds", name)}


def test_the_same_command_goes_on_after_an_interruption(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
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


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (("--budget", "13"), "a.db: run 1 has other conditions: budget 12, not 13"),
        (("--task", "put-on"), "a.db: run 1 has other conditions: task pick-up, not put-on"),
        (("--vary", "light"), "other operators, or other ranges"),
    ],
)
def test_a_store_with_runs_of_other_conditions_is_refused(
    capsys: pytest.CaptureFixture[str], flags: tuple[str, ...], says: str
):
    compare("--repeats", "1")
    assert says in complaint(capsys, *flags)
    assert len(runs()) == 2


def test_a_run_that_others_answered_is_refused(capsys: pytest.CaptureFixture[str]):
    for _ in range(2):
        args = ("--budget", "12", "--seed", "3", "--store", "a.db")
        for strategy in ("random", "python:tests.doubles:make_random_again"):
            assert main(["run", *IDLE, "--unchecked", "--strategy", strategy, *args]) == 0
    message = complaint(
        capsys, "--strategies", "random,python:tests.doubles:make_random_again", "--repeats", "1"
    )
    assert "run 2 reused" in message


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (("--strategies", "random,radnom"), "unknown strategy 'radnom'"),
        (("--strategies", "random,random"), "--strategies: 'random' is there twice"),
        (("--strategies", ","), "--strategies: expected names, got ','"),
        (("--repeats", "0"), "--repeats: expected at least 1, got 0"),
        (("--solvable", "-1"), "--solvable: expected at least 0, got -1"),
        (("--triage-sample", "-1"), "--triage-sample: expected at least 0, got -1"),
        (("--triage-sample", "51"), "--triage-sample: 51 of the 50 failures of --solvable"),
        (("--budget", "0"), "--budget: expected at least 1, got 0"),
        (("--seed", "-1"), "--seed: expected at least 0, got -1"),
        (("--seed", "9223372036854775807"), "--seed: too large for 2 repeats"),
        (("--task", "pick_up"), "unknown task 'pick_up'"),
        (("--policy", "pinhol"), "unknown policy 'pinhol'"),
        (("--executor", "cloud"), "unknown executor 'cloud'"),
        (("--address", "auto"), "the executor local has no address"),
        (("--json", "--csv"), "--json, --csv and --markdown exclude each other"),
    ],
)
def test_a_wrong_flag_is_a_sentence_with_a_hint_and_makes_nothing(
    capsys: pytest.CaptureFixture[str], folder: Path, flags: tuple[str, ...], says: str
):
    assert says in complaint(capsys, *flags)
    assert list(folder.iterdir()) == []


def test_a_policy_that_is_gone_ends_it_and_the_same_command_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], folder: Path
):
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: Gone(after=20))
    assert "8 scenes in a row had no answer" in complaint(capsys)
    assert "interrupted" in [status for *_, status in runs()]
    assert not (folder / "out" / "compare.json").exists()
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: ClosedForm())
    compare()
    assert {status for *_, status in runs()} == {"finished"}


def test_a_store_without_a_suffix_is_not_its_own_report_folder(folder: Path):
    assert main(["compare", *SMALL, "--store", "mine"]) == 0
    assert (folder / "mine").is_file()
    assert (folder / "mine-compare" / "compare.json").is_file()


def test_a_policy_that_breaks_ends_it(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: Raising(ConnectionError("refused")))
    assert "no scene could be judged: ConnectionError: refused" in complaint(capsys)
