"""``vlafuzz export`` of the scenes of a store."""

import json
from pathlib import Path

import pytest

from tests.doubles import ClosedForm
from vlafuzz.campaign import launch
from vlafuzz.cli import main
from vlafuzz.formats.scene_lines import load_scenes

IDLE = ("--policy", "python:tests.doubles:make_idle", "--unchecked", "--no-certify")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Runs happen in a folder of their own, without a simulator: in the dark, policies fail."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(launch, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
    return tmp_path


@pytest.fixture
def store(capsys: pytest.CaptureFixture[str]) -> str:
    main(["run", *IDLE, "--budget", "30", "--store", "a.db"])
    main(["run", *IDLE, "--budget", "10", "--store", "a.db", "--seed", "1"])
    capsys.readouterr()
    return "a.db"


@pytest.mark.parametrize("verdict", ["failed", "passed"])
def test_export_writes_the_scenes_of_a_verdict_once_each(folder: Path, store: str, verdict: str):
    assert main(["export", store, "--out", "out.jsonl", "--verdict", verdict]) == 0
    scenes = load_scenes(folder / "out.jsonl")
    assert len(set(scenes)) == len(scenes) > 0
    assert all((row.light.intensity < 0.5) == (verdict == "failed") for row in scenes)


def test_export_of_one_run_is_a_part_of_all(folder: Path, store: str):
    main(["export", store, "--out", "all.jsonl", "--verdict", "all"])
    main(["export", store, "--out", "one.jsonl", "--verdict", "all", "--run", "2"])
    everything, one = set(load_scenes(folder / "all.jsonl")), set(load_scenes(folder / "one.jsonl"))
    assert one < everything


def test_exported_scenes_can_be_run_again(store: str, capsys: pytest.CaptureFixture[str]):
    main(["export", store, "--out", "out.jsonl"])
    capsys.readouterr()
    assert main(["run", *IDLE, "--scenes", "out.jsonl", "--store", "b.db", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdicts"]["passed"] == 0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["no.db", "--out", "out.jsonl"], "no.db: no such store"),
        (["a.db", "--out", "out.jsonl", "--run", "9"], "a.db: no run 9"),
        (["a.db", "--out", "a.db/out.jsonl"], "cannot be written"),
    ],
)
def test_export_refuses_what_is_not_there(
    store: str, capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
):
    assert main(["export", *arguments]) == 2
    shown = capsys.readouterr().err
    assert says in shown
    assert "hint: " in shown


def test_a_format_that_can_express_no_scene_is_an_error_and_writes_nothing(
    folder: Path, store: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["export", store, "--format", "vlatest", "--out", "out.json"]) == 2
    assert "VLATest's scene files have no light" in capsys.readouterr().err
    assert not (folder / "out.json").exists()
