import json
from pathlib import Path

import pytest

from vlafuzz.cli import main
from vlafuzz.scene import Placement, Scene, write_scenes

FAIR = Scene("pick-up", (Placement("apple", "resting", 0.0, 0.0),), "pick up apple")
CROWDED = Scene("pick-up", FAIR.targets, "pick up apple", (Placement("orange", "resting", 0.1, 0.0),))
UNKNOWN = Scene("pick-up", (Placement("duck", "resting", 0.0, 0.0),), "pick up duck")


def scenes(folder: Path, *scenes: Scene) -> Path:
    path = folder / "scenes.jsonl"
    write_scenes(path, scenes)
    return path


def test_fair_scenes_are_fine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lint", "--static", str(scenes(tmp_path, FAIR, FAIR))]) == 0
    assert "scenes.jsonl" in capsys.readouterr().out


def test_each_rejection_has_its_line_check_and_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = scenes(tmp_path, FAIR, CROWDED, UNKNOWN)
    path.write_text(path.read_text() + '\n{"task": 3}\n')
    assert main(["lint", "--static", "--json", str(path)]) == 1
    (row,) = json.loads(capsys.readouterr().out)
    assert {key: row[key] for key in ("scenes", "valid", "semantic", "geometry", "settling", "broken")} == {
        "scenes": 3, "valid": 1, "semantic": 1, "geometry": 1, "settling": 0, "broken": 1,
    }  # fmt: skip
    assert [(each["line"], each["check"]) for each in row["rejections"]] == [
        (2, "geometry"),
        (3, "semantic"),
        (5, "broken"),
    ]
    assert row["rejections"][1]["reason"] == "unknown object 'duck'"


def test_verbose_names_file_and_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scenes(tmp_path, FAIR, CROWDED)
    assert main(["lint", "--static", "--verbose", str(path)]) == 1
    assert f"{path}:2: geometry: apple and orange: 0.100 m between" in capsys.readouterr().out


def test_min_distance_can_be_chosen(tmp_path: Path) -> None:
    path = scenes(tmp_path, CROWDED)
    assert main(["lint", "--static", str(path)]) == 1
    assert main(["lint", "--static", "--min-distance", "0.05", str(path)]) == 0
    assert main(["lint", "--static", "--min-distance", "-1", str(path)]) == 2


def test_a_file_that_is_not_there_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lint", "--static", "nowhere.jsonl"]) == 2
    assert capsys.readouterr().err.startswith("error: nowhere.jsonl: cannot read scenes")


def test_what_rolls_away_fails_settling(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tilted = Placement("coke_can", "standing", 0.0, 0.0, quaternion=(0.9239, 0.3827, 0.0, 0.0))
    path = scenes(tmp_path, FAIR, Scene("pick-up", (tilted,), "pick up coke can"))
    assert main(["lint", "--json", str(path)]) == 1
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["valid"], row["settling"]) == (1, 1)
