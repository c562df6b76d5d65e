"""``vlafuzz lab study`` with real spaces, without a simulator."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.typed import typed
from tests.doubles import Always, ClosedForm, failed, passed, rollout
from tests.packs import box, write_pack
from vlafuzz.campaign import launch
from vlafuzz.cli import main
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Camera, Scene
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.tasks import TASKS

SMALL = ("--policy", "python:tests.doubles:make_idle", "--scenes", "6", "--out", "out")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(launch, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
    return tmp_path / "out"


def study(*flags: str) -> None:
    assert main(["lab", "study", *flags, *SMALL]) == 0


def runs(folder: Path) -> list[tuple[str, str]]:
    with Store.open(folder / "study.db") as store:
        return [(run.manifest.task, run.status) for run in store.runs()]


def test_rq1_has_a_run_of_every_task(folder: Path, capsys):
    study("rq1", "--json")
    document = json.loads(capsys.readouterr().out)
    assert [row["task"] for row in document["arms"]] == ["pick-up", "move-near", "put-on", "put-in"]
    assert list(document["arms"][0]["stages"]) == ["grasp", "lift", "success"]
    assert {row["stages"]["success"]["of"] for row in document["arms"]} == {6}
    assert json.loads((folder / "rq1.json").read_text()) == document
    assert "What differs from the paper: it has 1000 scenes" in (folder / "rq1.md").read_text()


def test_several_policies_stand_in_one_table(folder: Path, capsys):
    study("rq1", "--task", "pick-up", "--policy", "expert")
    shown = capsys.readouterr().out
    assert "expert" in shown
    assert "make_idle" in (folder / "rq1.md").read_text()
    assert len(runs(folder)) == 2


def test_a_robot_that_nobody_knows_is_refused_before_anything_is_written(folder: Path, capsys):
    assert "unknown robot 'widow'" in typed(capsys, ["lab", "study", "rq1", "--robot", "widow", *SMALL], code=2).err
    assert not folder.exists()


def test_rq2_has_a_run_of_every_number_of_confounders_beside_none(folder: Path, capsys):
    study("rq2", "--task", "move-near", "--json")
    document = json.loads(capsys.readouterr().out)
    assert [row["arm"] for row in document["arms"]] == [f"{count} confounders" for count in range(5)]
    assert [row["control"] is None for row in document["arms"]] == [True, False, False, False, False]


def test_a_number_without_room_is_left_out_and_said(folder: Path, capsys):
    tight = Path("tight.yaml")
    tight.write_text("extends: paper-rq1\nmin_distance: 0.3\n")
    study("rq2", "--task", "pick-up", "--operators", str(tight), "--json")
    message = capsys.readouterr()
    assert len(json.loads(message.out)["arms"]) < 5
    for said in (message.err, (folder / "rq2.md").read_text()):
        assert "pick-up, 4 confounders: pick-up: no scene of" in " ".join(said.split())


class Dim(ClosedForm):
    """Breaks in the dark, fails in dazzling light, and passes everything else."""

    def outcome(self, scene: Scene) -> Outcome:
        if scene.light.intensity < 0.5:
            return Outcome.error("broke")
        return failed() if scene.light.intensity >= 8 else passed()


class Literal(ClosedForm):
    """Understands the plain wording, and steps one at a time; knows no objects of packs."""

    def outcome(self, scene: Scene) -> Outcome:
        plain = scene.instruction.startswith(("pick up", "put")) and " and " not in scene.instruction
        if plain and ":" not in scene.targets[0].object:
            return passed()
        return Outcome.of((rollout(0.5, ("grasp",)),), TASKS[scene.task].stage_names)


def using(evaluator: type[ClosedForm], monkeypatch) -> None:
    monkeypatch.setattr(launch, "make_evaluator", lambda manifest, _: evaluator(manifest.repeats))


def arms(capsys, *flags: str) -> list[dict[str, Any]]:
    study(*flags, "--json")
    found: list[dict[str, Any]] = json.loads(capsys.readouterr().out)["arms"]
    return [row | {"success": row["stages"]["success"]} for row in found]


def test_rq3_has_three_mutants_of_every_passed_scene_beside_an_unmutated_control(folder: Path, capsys, monkeypatch):
    using(Dim, monkeypatch)
    control, mutated, *other = arms(capsys, "rq3", "--task", "pick-up", "--task", "put-on")
    assert [(row["task"], row["arm"]) for row in other] == [("put-on", "control"), ("put-on", "light")]
    assert (control["success"]["count"], control["control"]) == (6, None)
    assert mutated["success"]["of"] + mutated["errors"] == 18
    assert mutated["errors"] > 0
    assert 0 < mutated["success"]["count"] < mutated["success"]["of"]
    assert mutated["control"]["share"] == 1
    assert mutated["gain"]["low"] < mutated["gain"]["value"] < 0
    assert "What differs from the paper: it has no control arm" in (folder / "rq3.md").read_text()


def test_rq4_moves_and_turns_the_camera_only(folder: Path, capsys):
    control, mutated = arms(capsys, "rq4", "--task", "pick-up")
    assert (control["success"]["count"], mutated["success"]["count"]) == (6, 18)
    with Store.open(folder / "study.db") as store:
        scenes = [trial.scene for trial in store.trials(2)]
    assert {row.light.intensity for row in scenes} == {1.0}
    assert len({row.camera for row in scenes}) == 1 + 18
    assert all(row.camera == Camera() for row in scenes[::4])


def test_studies_with_one_folder_share_its_runs_and_go_on(folder: Path, monkeypatch, capsys):
    study("rq1", "--task", "pick-up")
    assert len(runs(folder)) == 1
    with monkeypatch.context() as patched:
        patched.setattr(ClosedForm, "outcome", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        assert main(["lab", "study", "rq3", "--task", "pick-up", *SMALL]) == 130
    assert [status for _, status in runs(folder)] == ["finished", "interrupted"]
    for name in ("rq3", "rq4", "rq3"):
        study(name, "--task", "pick-up")
    assert [status for _, status in runs(folder)] == ["finished"] * 3


def test_rq5_compares_unseen_objects_with_seen_ones(folder: Path, capsys, monkeypatch):
    using(Literal, monkeypatch)
    pack = write_pack(Path("mine"), stick=box(0.03, 0.04, 0.08), brick=box(0.03, 0.05, 0.06))
    narrow = Path("narrow.yaml")
    narrow.write_text("extends: paper-rq1\noperators:\n  confounder-count: {low: 0, high: 0, nominal: 0}\n")
    flags = ("rq5", "--task", "pick-up", "--unseen", str(pack), "--operators", str(narrow))
    seen, unseen = arms(capsys, *flags)
    assert (seen["arm"], seen["success"]["share"], unseen["arm"], unseen["success"]["share"]) == (
        "seen",
        1,
        "unseen",
        0,
    )
    assert (unseen["gain"]["value"], unseen["p"]) == (-1.0, pytest.approx(2 / 924))


def test_rq6_says_every_scene_in_ten_other_ways(folder: Path, capsys, monkeypatch):
    using(Literal, monkeypatch)
    plain, *others = arms(capsys, "rq6", "--task", "pick-up")
    assert (plain["arm"], plain["success"]["count"], plain["p"]) == ("plain", 6, None)
    assert [(row["success"]["count"], row["stages"]["grasp"]["count"]) for row in others] == [(0, 6)] * 10
    assert (others[0]["p"], others[0]["p_holm"]) == pytest.approx((0.03125, 0.3125))
    assert "lift the {a} off the table" in (folder / "rq6.md").read_text()


def test_prompts_tell_two_steps_at_once_and_one_by_one(folder: Path, capsys, monkeypatch):
    using(Literal, monkeypatch)
    made = arms(capsys, "prompts")
    assert list(dict.fromkeys(row["task"] for row in made)) == ["move-near", "put-on", "put-in"]
    assert [row["success"]["share"] for row in made if row["task"] == "put-in"] == [1.0, 0.0, 1.0]
    with Store.open(folder / "study.db") as store:
        last = list(store.trials(len(store.runs())))[-1].scene
    assert last.instruction.startswith("pick up ")
    assert [row.split()[0] for row in last.then] == ["put"]


def test_who_passed_nothing_has_nothing_to_lose(folder: Path, capsys, monkeypatch):
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: Always(failed()))
    (control,) = arms(capsys, "rq3", "--task", "pick-up")
    assert (control["arm"], control["success"]["of"]) == ("control", 0)


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["rq1", "--task", "pick-nose"], "unknown task 'pick-nose'"),
        (["rq1", "--scenes", "0"], "--scenes"),
        (["rq1", "--operators", "none.yaml"], "no file"),
        (["rq7"], "unknown study 'rq7'"),
        (["rq5"], "rq5: --unseen is missing"),
        (["rq4", "--unseen", "ycb"], "rq4: --unseen is for rq5 only"),
        (["prompts", "--task", "pick-up"], "pick-up has one step only"),
    ],
)
def test_bad_input_is_a_sentence(flags: list[str], says: str, capsys):
    assert says in typed(capsys, ["lab", "study", *flags[:1], *SMALL, *flags[1:]], code=2).err
