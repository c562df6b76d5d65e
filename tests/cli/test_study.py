"""``vlafuzz study``: with real spaces, without a simulator."""

import json
from pathlib import Path

import pytest

from tests.doubles import ClosedForm
from vlafuzz import launch
from vlafuzz.cli import main
from vlafuzz.corpus.store import Corpus

SMALL = ("--subject", "python:tests.doubles:make_idle", "--scenes", "6", "--out", "out")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(launch, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
    return tmp_path / "out"


def study(*flags: str) -> None:
    assert main(["study", *flags, *SMALL]) == 0


def runs(folder: Path) -> list[tuple[str, str]]:
    with Corpus.open(folder / "study.db") as corpus:
        return [(run.manifest.task, run.status) for run in corpus.runs()]


def test_rq1_has_a_run_of_every_task_and_the_papers_figures(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study("rq1", "--json")
    found = json.loads(capsys.readouterr().out)
    assert [each["task"] for each in found["standings"]] == ["pick-up", "move-near", "put-on", "put-in"]
    assert [stage["stage"] for stage in found["standings"][0]["stages"]] == ["grasp", "lift", "success"]
    assert {each["judged"] for each in found["standings"]} == {6}
    assert found["published"][0]["mean"] == 0.124
    assert json.loads((folder / "study.json").read_text()) == found
    assert "12.4%, elsewhere 12.8%" in (folder / "study.md").read_text()
    assert (folder / "stages.png").read_bytes().startswith(b"\x89PNG")


def test_what_is_stored_is_not_run_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study("rq1", "--task", "pick-up")
    study("rq1", "--task", "pick-up", "--task", "put-on")
    assert runs(folder) == [("pick-up", "finished"), ("put-on", "finished")]
    study("rq1", "--task", "pick-up")
    assert len(runs(folder)) == 2
    assert "pick-up" in capsys.readouterr().out


def test_an_interrupted_study_goes_on(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(ClosedForm, "outcome", interrupted)
        assert main(["study", "rq1", "--task", "pick-up", *SMALL]) == 130
    assert runs(folder) == [("pick-up", "interrupted")]
    study("rq1", "--task", "pick-up")
    assert runs(folder) == [("pick-up", "finished")]


def test_several_subjects_stand_in_one_table(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study("rq1", "--task", "pick-up", "--subject", "expert")
    shown = capsys.readouterr().out
    assert "expert" in shown
    assert "make_idle" in (folder / "study.md").read_text()
    assert len(runs(folder)) == 2


def test_stores_can_be_counted_without_a_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study("rq1", "--task", "pick-up", "--json")
    first = json.loads(capsys.readouterr().out)
    assert main(["study", "rq1", "--from", "out/study.db", "--out", "again", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == first
    assert not Path("again/study.db").exists()


def test_a_guided_run_is_no_sample(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flags = ["--strategy", "feedback", "--budget", "4", "--store", "a.db", *SMALL[:2]]
    assert main(["run", *flags]) == 0
    capsys.readouterr()
    assert main(["study", "rq1", "--from", "a.db", "--out", "out"]) == 2
    assert "a.db: no run with scenes of strategy random or pool" in capsys.readouterr().err


def test_rq2_has_a_run_of_every_number_of_confounders(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study("rq2", "--task", "move-near", "--json")
    found = json.loads(capsys.readouterr().out)
    assert [each["confounders"] for each in found["standings"]] == [0, 1, 2, 3, 4]
    assert found["published"] == []
    (similar,) = found["similar"]
    assert similar["similar"] + similar["other"] == 24


def test_a_number_without_room_is_left_out_and_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tight = Path("tight.yaml")
    tight.write_text("extends: paper-rq1\nmin_distance: 0.3\n")
    study("rq2", "--task", "pick-up", "--operators", str(tight), "--json")
    told = capsys.readouterr()
    assert len(json.loads(told.out)["standings"]) < 5
    assert "left out: pick-up: no room for" in " ".join(told.err.split())


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["rq1", "--task", "pick-nose"], "unknown task 'pick-nose'"),
        (["rq1", "--scenes", "0"], "--budget"),
        (["rq1", "--operators", "none.yaml"], "no file"),
    ],
)
def test_bad_input_is_a_sentence(flags: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", *flags[:1], *SMALL, *flags[1:]]) == 2
    assert says in capsys.readouterr().err
