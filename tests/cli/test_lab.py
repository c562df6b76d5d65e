"""``vlafuzz lab``: studies with real spaces, without a simulator, and coverage."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.typed import told, typed
from tests.doubles import Always, ClosedForm, failed, passed, rollout, scene
from tests.packs import box, write_pack
from tests.report.stores import store
from vlafuzz.campaign import launch
from vlafuzz.cli import main
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Camera, Scene
from vlafuzz.model.scene_lines import write_scenes
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


def test_rq1_has_a_run_of_every_task_and_the_papers_figures(folder: Path, capsys):
    study("rq1", "--json")
    document = json.loads(capsys.readouterr().out)
    assert [row["task"] for row in document["standings"]] == ["pick-up", "move-near", "put-on", "put-in"]
    assert [stage["stage"] for stage in document["standings"][0]["stages"]] == ["grasp", "lift", "success"]
    assert {row["judged"] for row in document["standings"]} == {6}
    assert document["published"][0]["mean"] == 0.124
    assert json.loads((folder / "rq1.json").read_text()) == document
    assert "12.4%, elsewhere 12.8%" in (folder / "rq1.md").read_text()
    assert (folder / "rq1.png").read_bytes().startswith(b"\x89PNG")


def test_what_is_stored_is_not_run_again(folder: Path, capsys):
    study("rq1", "--task", "pick-up")
    study("rq1", "--task", "pick-up", "--task", "put-on")
    assert runs(folder) == [("pick-up", "finished"), ("put-on", "finished")]
    study("rq1", "--task", "pick-up")
    assert len(runs(folder)) == 2
    assert "pick-up" in capsys.readouterr().out


def test_several_policies_stand_in_one_table(folder: Path, capsys):
    study("rq1", "--task", "pick-up", "--policy", "expert")
    shown = capsys.readouterr().out
    assert "expert" in shown
    assert "make_idle" in (folder / "rq1.md").read_text()
    assert len(runs(folder)) == 2


def test_stores_can_be_counted_without_a_run(folder: Path, capsys):
    study("rq1", "--task", "pick-up", "--json")
    first = json.loads(capsys.readouterr().out)
    study("rq3", "--task", "pick-up")  # its mutants are of scenes that were passed: no sample
    capsys.readouterr()
    assert told(capsys, "lab study rq1 --from out/study.db --out again --json") == first
    assert not Path("again/study.db").exists()


def test_a_robot_that_nobody_knows_is_refused_before_anything_is_written(folder: Path, capsys):
    assert "unknown robot 'widow'" in typed(capsys, ["lab", "study", "rq1", "--robot", "widow", *SMALL], code=2).err
    assert not folder.exists()


def test_a_guided_run_is_no_sample(tmp_path: Path, capsys):
    flags = ["--strategy", "feedback", "--budget", "4", "--store", "a.db", "--unchecked", *SMALL[:2]]
    typed(capsys, ["run", *flags])
    assert main(["lab", "study", "rq1", "--from", "a.db", "--out", "out"]) == 2
    assert "a.db: no run with scenes of strategy random or pool" in capsys.readouterr().err


def test_rq2_has_a_run_of_every_number_of_confounders(folder: Path, capsys):
    study("rq2", "--task", "move-near", "--json")
    document = json.loads(capsys.readouterr().out)
    assert [row["confounders"] for row in document["standings"]] == [0, 1, 2, 3, 4]
    assert document["published"] == []
    (similar,) = document["similar"]
    assert similar["similar"] + similar["other"] == 24


def test_a_number_without_room_is_left_out_and_said(folder: Path, capsys):
    tight = Path("tight.yaml")
    tight.write_text("extends: paper-rq1\nmin_distance: 0.3\n")
    study("rq2", "--task", "pick-up", "--operators", str(tight), "--json")
    message = capsys.readouterr()
    assert len(json.loads(message.out)["standings"]) < 5
    for said in (message.err, (folder / "rq2.md").read_text()):
        assert "pick-up, 4 confounders: pick-up: no scene of" in " ".join(said.split())


@pytest.mark.parametrize("flag", ["--task", "--policy", "--robot", "--operators"])
def test_what_chooses_runs_goes_with_none_that_are_there(flag: str, capsys):
    value = {"--task": "put-in", "--robot": "panda"}.get(flag, "mine")
    assert main(["lab", "study", "rq1", "--from", "a.db", "--out", "out", flag, value]) == 2
    assert f"{flag} and --from: nothing is run" in capsys.readouterr().err


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


def document(capsys, *flags: str) -> dict[str, Any]:
    study(*flags, "--json")
    return dict(json.loads(capsys.readouterr().out))


def test_rq3_has_three_mutants_of_every_passed_scene_beside_an_unmutated_control(folder: Path, capsys, monkeypatch):
    using(Dim, monkeypatch)
    made = document(capsys, "rq3", "--task", "pick-up", "--task", "put-on")
    one, other, whole = made["kept"]
    assert [row["task"] for row in made["kept"]] == ["pick-up", "put-on", "all"]
    assert (one["default"], one["control"]["count"], whole["default"]) == (6, 6, 12)
    assert one["mutated"]["of"] + one["errors"] == 18
    assert 0 < whole["mutated"]["count"] < whole["mutated"]["of"]
    assert whole["errors"] == one["errors"] + other["errors"] > 0
    bright = [row["passed"] for row in made["points"] if row["low"] == 8 and row["curve"] == "brighter"]
    assert [row["count"] for row in bright] == [0]
    message = (folder / "rq3.md").read_text()
    assert "491 (adds up to 391)" in message
    assert "What differs from the paper: it has no control arm" in message
    assert (folder / "rq3.png").read_bytes().startswith(b"\x89PNG")


def test_alpha_can_be_drawn_evenly_in_its_logarithm(capsys):
    flags = ("rq3", "--task", "pick-up", "--scenes", "20")
    share = {}
    for alpha in ("linear", "log"):
        points = document(capsys, *flags, "--alpha", alpha, "--out", alpha)["points"]
        tried = {row["low"]: row["passed"]["of"] for row in points if row["curve"] == "brighter"}
        share[alpha] = tried[8] / sum(tried.values())
    assert share["log"] < 0.5 < share["linear"]


def test_rq4_moves_and_turns_the_camera_only(folder: Path, capsys):
    (kept,) = document(capsys, "rq4", "--task", "pick-up")["kept"]
    assert (kept["default"], kept["mutated"]["count"]) == (6, 18)
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


def test_rq5_tests_over_three_policies_and_over_scenes_with_fewer(folder: Path, capsys, monkeypatch):
    using(Literal, monkeypatch)
    pack = write_pack(Path("mine"), stick=box(0.03, 0.04, 0.08), brick=box(0.03, 0.05, 0.06))
    narrow = Path("narrow.yaml")
    narrow.write_text("extends: paper-rq1\noperators:\n  confounder-count: {low: 0, high: 0, nominal: 0}\n")
    flags = ("rq5", "--task", "pick-up", "--unseen", str(pack), "--operators", str(narrow))
    alone = document(capsys, *flags)
    (one,) = alone["differences"]
    assert (one["relative"], one["points"], one["low"]) == (-1.0, -1.0, None)
    assert (one["transfer_seen"], one["transfer_unseen"]) == ([1, 1, 1], [1, 0, None])
    assert (alone["packs"], alone["tests"]) == (["mine"], [])
    assert "With fewer than 3 policies there is no test" in (folder / "rq5.md").read_text()
    several = document(capsys, *flags, "--policy", "frozen", "--policy", "random")
    (test,) = several["tests"]
    assert (test["policies"], test["p"]) == (3, None)  # all three differ by as much


def test_rq6_says_every_scene_in_ten_other_ways(folder: Path, capsys, monkeypatch):
    using(Literal, monkeypatch)
    made = document(capsys, "rq6", "--task", "pick-up")
    plain, *others = made["prompts"]
    assert (plain["prompt"], plain["stages"][-1]["count"], plain["p"]) == ("plain", 6, None)
    assert [(row["lost"], row["gained"]) for row in others] == [(6, 0)] * 10
    assert {row["stages"][0]["count"] for row in others} == {6}
    assert (others[0]["p"], others[0]["adjusted"]) == pytest.approx((0.03125, 0.3125))
    assert (made["together"][0]["plain"]["share"], made["together"][0]["prompts"]["of"]) == (1.0, 60)
    assert "lift the {a} off the table" in (folder / "rq6.md").read_text()


def test_prompts_tell_two_steps_at_once_and_one_by_one(folder: Path, capsys, monkeypatch):
    using(Literal, monkeypatch)
    made = document(capsys, "prompts")
    assert list(dict.fromkeys(row["task"] for row in made["prompts"])) == ["move-near", "put-on", "put-in"]
    shares = {row["prompt"]: row["stages"][-1]["share"] for row in made["prompts"] if row["task"] == "put-in"}
    assert shares == {"plain": 1.0, "two-step": 0.0, "step-by-step": 1.0}
    with Store.open(folder / "study.db") as store:
        last = list(store.trials(len(store.runs())))[-1].scene
    assert last.instruction.startswith("pick up ")
    assert [row.split()[0] for row in last.then] == ["put"]


def test_who_passed_nothing_has_nothing_to_lose(folder: Path, capsys, monkeypatch):
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: Always(failed()))
    (kept,) = document(capsys, "rq3", "--task", "pick-up")["kept"]
    assert (kept["default"], kept["mutated"]["of"]) == (0, 0)
    assert (folder / "rq3.png").exists()


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["rq1", "--task", "pick-nose"], "unknown task 'pick-nose'"),
        (["rq1", "--scenes", "0"], "--scenes"),
        (["rq1", "--operators", "none.yaml"], "no file"),
        (["rq7"], "unknown study 'rq7'"),
        (["rq3", "--alpha", "cubic"], "unknown --alpha 'cubic'"),
        (["rq5"], "rq5: --unseen is missing"),
        (["rq4", "--unseen", "ycb"], "rq4: --unseen is for rq5 only"),
        (["rq2", "--from", "a.db"], "rq2: --from is for rq1 only"),
        (["prompts", "--task", "pick-up"], "pick-up has one step only"),
    ],
)
def test_bad_input_is_a_sentence(flags: list[str], says: str, capsys):
    assert says in typed(capsys, ["lab", "study", *flags[:1], *SMALL, *flags[1:]], code=2).err


def scenes(folder: Path) -> Path:
    path = folder / "scenes.jsonl"
    write_scenes(path, [scene(x=-0.2 + 0.03 * number) for number in range(9)])
    return path


def test_a_file_and_a_store_in_one_table(tmp_path: Path, capsys):
    run = store(tmp_path / "a.db", triaged=0)
    rows = told(capsys, ["lab", "coverage", str(scenes(tmp_path)), str(run), "--first", "4", "--json"])
    assert [(row["run"], row["scenes"]) for row in rows] == [(None, 4), (None, 9), (1, 4), (2, 4)]
    assert [row["failures"] is None for row in rows] == [True, True, False, False]


def test_coverage_as_csv(tmp_path: Path, capsys):
    (row,) = csv.DictReader(io.StringIO(typed(capsys, ["lab", "coverage", str(scenes(tmp_path)), "--csv"]).out))
    assert (row["task"], row["scenes"], row["positions"]) == ("pick-up", "9", "0.08")


def test_vlatests_files_stand_beside_the_papers_figures(tmp_path: Path, capsys):
    path = tmp_path / "t-grasp.json"
    upright = [0.7071067811865476, 0.7071067811865475, 0.0, 0.0]
    options = {"init_xy": [-0.31, 0.17], "orientation": upright}
    entries = {str(number): {"model_id": "hammer", "obj_init_options": options} for number in range(10)}
    path.write_text(json.dumps(entries))
    (row,) = told(capsys, ["lab", "coverage", str(path), "--json"])
    assert (row["scenes"], row["positions"], row["published"], row["sites"]) == (10, 0.01, 0.09, None)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nowhere.jsonl"], "nowhere.jsonl: cannot be read"),
        (["nowhere.db"], "nowhere.db: cannot be read"),
        (["a.jsonl", "--first", "0"], "--first"),
    ],
)
def test_a_wrong_flag_of_coverage_is_a_sentence(arguments: list[str], says: str, capsys):
    assert says in typed(capsys, ["lab", "coverage", *arguments], code=2).err
