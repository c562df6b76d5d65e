from dataclasses import replace
from pathlib import Path

import pytest

from tests.cli.typed import told, typed
from vlafuzz.cli import main
from vlafuzz.model import Light, Placement, Scene
from vlafuzz.model.scene_lines import write_scenes

FAIR = Scene("pick-up", (Placement("apple", "resting", 0.0, 0.0),), "pick up apple")
CROWDED = Scene("pick-up", FAIR.targets, "pick up apple", confounders=(Placement("orange", "resting", 0.1, 0.0),))
UNKNOWN = Scene("pick-up", (Placement("duck", "resting", 0.0, 0.0),), "pick up duck")


def scenes(folder: Path, *scenes: Scene) -> Path:
    path = folder / "scenes.jsonl"
    write_scenes(path, scenes)
    return path


def test_fair_scenes_are_fine(tmp_path: Path, capsys):
    assert "scenes.jsonl" in typed(capsys, ["lint", "--static", str(scenes(tmp_path, FAIR, FAIR))]).out


def test_each_rejection_has_its_line_check_and_reason(tmp_path: Path, capsys):
    path = scenes(tmp_path, FAIR, CROWDED, UNKNOWN)
    path.write_text(path.read_text() + '\n{"task": 3}\n')
    (row,) = told(capsys, ["lint", "--static", "--json", str(path)], code=1)
    assert {key: row[key] for key in ("scenes", "valid", "semantic", "geometry", "settling", "broken")} == {
        "scenes": 3, "valid": 1, "semantic": 1, "geometry": 1, "settling": 0, "broken": 1,
    }  # fmt: skip
    rejected = [(problem["line"], problem["check"]) for problem in row["rejections"]]
    assert rejected == [(2, "geometry"), (3, "semantic"), (5, "broken")]
    assert row["rejections"][1]["reason"] == "unknown object 'duck'"


def test_each_problem_has_its_file_and_line(tmp_path: Path, capsys):
    path = scenes(tmp_path, FAIR, CROWDED)
    assert main(["lint", "--static", str(path)]) == 1
    assert f"{path}:2: geometry: apple and orange: 0.100 m between" in capsys.readouterr().out


def test_targets_that_nobody_sees_are_counted(tmp_path: Path, capsys):
    path = scenes(tmp_path, FAIR, replace(FAIR, light=Light(0.0001)))
    (row,) = told(capsys, ["lint", "--static", "--json", str(path)], code=1)
    assert (row["valid"], row["unseen"]) == (1, 1)
    assert row["rejections"][0]["reason"].startswith("apple: ")


@pytest.mark.parametrize(
    ("task", "reason"),
    [("libero_object/0", "this world checks its scenes when they are run"), ("nowhere/3", "unknown world 'nowhere'")],
)
def test_scenes_of_a_world_that_judges_none_and_of_no_world_are_not_valid(tmp_path: Path, capsys, task, reason):
    path = scenes(tmp_path, FAIR, replace(FAIR, task=task))
    (row,) = told(capsys, ["lint", "--json", "--static", str(path)], code=1)
    assert (row["valid"], row["rejections"][0]["reason"]) == (1, f"{task}: {reason}")


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [("a.json", "[" * 100_000, ""), ("a.json", '{"0": ' + "9" * 5000 + "}", ""), ("a.jsonl", "", "no scenes in it")],
    ids=["deep", "digits", "empty"],
)
def test_a_file_that_nobody_can_read_or_without_scenes_is_a_sentence(tmp_path: Path, name, text, says, capsys):
    (tmp_path / name).write_text(text)
    assert typed(capsys, ["lint", str(tmp_path / name)], code=2).err.startswith(f"error: {tmp_path / name}: {says}")


def test_what_rolls_away_fails_settling(tmp_path: Path, capsys):
    tilted = Placement("coke_can", "standing", 0.0, 0.0, quaternion=(0.9239, 0.3827, 0.0, 0.0))
    path = scenes(tmp_path, FAIR, Scene("pick-up", (tilted,), "pick up coke can"))
    (row,) = told(capsys, ["lint", "--json", str(path)], code=1)
    assert (row["valid"], row["settling"]) == (1, 1)


def test_a_file_of_vlatest_is_first_to_become_one_of_ours(tmp_path: Path, capsys):
    (tmp_path / "t-grasp.json").write_text('{"seed": 1, "num": 0}')
    said = typed(capsys, ["lint", str(tmp_path / "t-grasp.json")], code=2).err
    assert f"`vlafuzz export {tmp_path / 't-grasp.json'} --out F.jsonl` reads" in " ".join(said.split())


def test_objects_of_packs_that_were_not_given_are_said(tmp_path: Path, capsys):
    packed = Scene("pick-up", (Placement("custom:apple", "resting", 0.0, 0.0),), "pick up apple")
    assert main(["lint", "--static", str(scenes(tmp_path, packed, UNKNOWN))]) == 1
    assert "note: 1 scenes have objects of packs that were not given" in capsys.readouterr().err
