"""A world from outside the package: runs, causes, triage, reports, corpora and regress work on it."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.worlds.reacher import Reacher
from vlafuzz.cli import main
from vlafuzz.errors import SceneError
from vlafuzz.model.conditions import Conditions, Setting
from vlafuzz.model.scene import Scene

MODULE = "python:tests.worlds.reacher"
WORLD, NARROW, POLICY = f"{MODULE}:Reacher", f"{MODULE}:Narrow", f"{MODULE}:downhill"
TASK = f"{WORLD}/reach"


@pytest.fixture(scope="module", params=["", "narrow"])
def named(request: pytest.FixtureRequest) -> tuple[str, str]:
    """A world and a policy of it: with actions of seven numbers, and of two."""
    return (NARROW, f"{MODULE}:narrow") if request.param else (WORLD, POLICY)


@pytest.fixture(scope="module")
def store(named: tuple[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("own") / "reacher.db"
    flags = ["--world", named[0], "--policy", named[1], "--budget", "90", "--store", str(path)]
    assert main(["run", *flags]) == 0
    return path


def space(*vary: str):
    return Reacher().space(TASK, "own", vary=vary)


def test_a_scene_is_values_by_name_and_the_same_when_it_is_read_again():
    scene = space().nominal()
    assert dict(scene.values) == {"ball-x": 0.4, "ball-y": 0.4, "strength": 1.0, "bias": 0.0, "glove": "none"}
    assert Scene.from_json(scene.to_json()) == scene
    assert space().decode(space().encode(scene)) == scene


def test_a_scene_has_targets_or_values():
    with pytest.raises(SceneError, match="targets: expected at least one, or values"):
        Scene.from_json('{"task": "x", "instruction": "go", "targets": []}')


def test_only_what_varies_is_drawn_and_jittered():
    usual, scene = dict(space().nominal().values), space("bias").sample(np.random.default_rng(1))
    near = space("bias").jittered(scene, 1)
    for other in (scene, near):
        assert {name for name, value in other.values if value != usual[name]} == {"bias"}
    assert 0 < abs(dict(near.values)["bias"] - dict(scene.values)["bias"]) < 0.01


def test_causes_of_what_the_policy_is_known_to_get_wrong_are_certified(store: Path, capsys):
    assert main(["triage", str(store), "--limit", "4", "--trust", "--json"]) == 0
    capsys.readouterr()
    assert main(["report", str(store), "--trust", "--json"]) == 0
    rows = [row for row in json.loads(capsys.readouterr().out) if row["evidence"] == "minimal"]
    assert rows
    assert {name for row in rows for name in row["operators"]} <= {"bias", "glove", "strength"}
    assert {row["witness"] for row in rows} == {"expert"}


def test_a_report_a_corpus_and_regress_work(store: Path, named: tuple[str, str], tmp_path: Path, capsys):
    assert main(["report", str(store), "--out", str(tmp_path / "r.html"), "--trust", "--no-videos"]) == 0
    export = ["export", str(store), "--minimal", "--out", str(tmp_path / "corpus"), "--controls", "20"]
    assert main([*export, "--trust"]) == 0
    code = main(["regress", str(tmp_path / "corpus"), "--policy", named[1], "--trust"])
    assert code in (0, 3)  # 3: where too few controls pass for an alarm
    assert "0 worse" in capsys.readouterr().out or code == 3


def test_what_names_the_world_in_a_file_is_not_loaded_without_trust(store: Path, capsys):
    assert main(["report", str(store)]) == 2
    assert "the file names" in capsys.readouterr().err


def test_an_unknown_task_or_operator_is_named(capsys):
    assert main(["run", "--world", f"{WORLD}:fly", "--policy", POLICY, "--budget", "2"]) == 2
    assert "no task 'fly'" in capsys.readouterr().err
    assert main(["run", "--world", WORLD, "--policy", POLICY, "--vary", "mass", "--budget", "2"]) == 2
    assert "unknown operator 'mass'" in capsys.readouterr().err


def test_settings_of_a_world_are_part_of_the_conditions_of_its_runs():
    class Heavy(Reacher):
        settings = (Setting("gravity", 9.81),)

    made = Heavy().space("reach", "own").conditions
    conditions = Conditions(task="reach", **made)
    assert (conditions.world, Heavy.settings[0].of(conditions)) == ({"gravity": 9.81}, 9.81)
    assert conditions.key() != Conditions(task="reach", **space().conditions).key()


def test_a_policy_whose_actions_have_another_width_is_refused(capsys):
    assert main(["run", "--world", NARROW, "--policy", POLICY, "--budget", "2"]) == 2
    assert "policy 'downhill' acts by 7 numbers" in capsys.readouterr().err


def test_a_policy_that_sees_is_not_called_blind_or_deaf_where_only_values_vary(capsys):
    assert main(["doctor", "--world", WORLD, "--policy", f"{MODULE}:watching", "--n", "1", "--json"]) in (0, 3)
    rows = {row["check"]: row["verdict"] for row in json.loads(capsys.readouterr().out)}
    assert (rows["sight"], rows["hearing"]) == ("ok", "ok")
