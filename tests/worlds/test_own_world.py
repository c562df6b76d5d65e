"""A world from outside the package: runs, causes, triage, reports, corpora and regress work on it."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

from tests.cli.typed import told, typed
from tests.worlds.reacher import Reacher
from vlafuzz.cli import main
from vlafuzz.errors import SceneError
from vlafuzz.model import Conditions, Monitor, Scene, Setting, Stage

MODULE = "python:tests.worlds.reacher"
WORLD, POLICY = f"{MODULE}:Reacher", f"{MODULE}:downhill"
NARROW = f"{MODULE}:Narrow"  # whose actions are two numbers, not seven
TASK = f"{WORLD}/reach"
CARTS = "python:tests.worlds.carts"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("own") / "reacher.db"
    flags = ["--world", NARROW, "--policy", f"{MODULE}:narrow", "--budget", "90", "--store", str(path)]
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
    typed(capsys, ["triage", str(store), "--limit", "4", "--trust"])
    rows = [row for row in told(capsys, ["report", str(store), "--trust", "--json"]) if row["evidence"] == "minimal"]
    assert rows
    assert {name for row in rows for name in row["operators"]} <= {"bias", "glove", "strength"}
    assert {row["witness"] for row in rows} == {"expert"}


def test_a_report_a_corpus_and_regress_work(store: Path, tmp_path: Path, capsys):
    assert main(["report", str(store), "--out", str(tmp_path / "r.html"), "--trust", "--no-videos"]) == 0
    export = ["export", str(store), "--minimal", "--out", str(tmp_path / "corpus"), "--controls", "20"]
    assert main([*export, "--trust"]) == 0
    code = main(["regress", str(tmp_path / "corpus"), "--policy", f"{MODULE}:narrow", "--trust"])
    assert code in (0, 3)  # 3: where too few controls pass for an alarm
    assert "0 worse" in capsys.readouterr().out or code == 3


def test_the_expert_of_a_world_is_a_policy_there_wherever_one_is_named(store: Path, tmp_path: Path, capsys):
    flags = f"run --world {NARROW} --strategy random --budget 2 --policy expert --store {tmp_path / 'e.db'} --json"
    assert told(capsys, flags)["verdicts"]["passed"] == 2
    assert told(capsys, f"replay {store} --trust --policy expert --json")["verdict"] == "passed"
    assert {row["verdict"] for row in told(capsys, f"doctor --world {NARROW} --policy expert --n 2 --json")} == {"ok"}
    lazy = f"run --world {CARTS}:Carts --policy expert --budget 2"
    assert f"policy 'expert': {CARTS}:Carts has no expert" in typed(capsys, lazy, code=2).err


def test_a_policy_by_the_observation_is_not_warned_of_pictures_where_a_world_has_values(tmp_path: Path, capsys):
    run = f"run --world {NARROW} --policy {MODULE}:narrow --strategy random --budget 1 --store {tmp_path / 'n.db'}"
    said = typed(capsys, run)
    assert "picture" not in said.out + said.err
    first, *_ = told(capsys, f"doctor --world {NARROW} --policy {MODULE}:narrow --n 1 --json")
    assert (first["verdict"], first["found"]) == ("ok", "sees the observation's numbers, 10 Hz")


def test_what_names_the_world_in_a_file_is_not_loaded_without_trust(store: Path, capsys):
    assert "the file names" in typed(capsys, ["report", str(store)], code=2).err


def test_the_command_to_see_a_failure_is_accepted_as_it_is_printed(store: Path, capsys):
    shown = typed(capsys, ["report", str(store), "--trust"]).out.splitlines()
    (line,) = [line for line in shown if "vlafuzz replay" in line]
    typed(capsys, [*shlex.split(line.partition("vlafuzz ")[2]), "--no-film"])


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (f"--world {WORLD}:fly", "no task 'fly'"),
        (f"--world {WORLD} --vary mass", "unknown operator 'mass'"),
        (f"--world {NARROW}", "policy 'downhill' acts by 7 numbers"),
    ],
)
def test_what_the_world_does_not_have_or_take_is_named(flags: str, says: str, capsys):
    assert says in typed(capsys, f"run {flags} --policy {POLICY} --budget 2", code=2).err


def test_settings_of_a_world_are_part_of_the_conditions_of_its_runs():
    class Heavy(Reacher):
        settings = (Setting("gravity", 9.81),)

    made = Heavy().space("reach", "own").conditions
    conditions = Conditions(task="reach", **made)
    assert (conditions.world, Heavy.settings[0].of(conditions)) == ({"gravity": 9.81}, 9.81)
    assert conditions.key() != Conditions(task="reach", **space().conditions).key()


def test_a_policy_that_sees_is_not_called_blind_or_deaf_where_only_values_vary(capsys):
    checks = told(capsys, f"doctor --world {WORLD} --policy {MODULE}:watching --n 1 --json", code=3)
    rows = {row["check"]: row["verdict"] for row in checks}
    assert (rows["sight"], rows["hearing"]) == ("ok", "ok")
    assert {row["check"]: row["found"] for row in checks}["speed"].endswith("at 10 Hz")  # the world's, not the policy's


def test_a_stage_that_is_reached_stays_so_and_is_not_looked_at_again_but_success_is():
    looks = list[str]()
    moments = {"grasp": "-gg---", "lift": "ggg---", "success": "---s-s"}

    def stage(name: str) -> Stage:
        return Stage(name, lambda now: looks.append(name) or moments[name][now] != "-", lambda now: 0.0, steps=1)

    monitor, reached, wins = Monitor(tuple(map(stage, moments))), list[int](), list[bool]()
    for now in range(6):
        monitor.observe(now)
        reached.append(len(monitor.reached))
        wins.append(monitor.success_now)
    assert (reached, wins) == ([0, 2, 2, 3, 3, 3], [False, False, False, True, False, True])
    assert [looks.count(name) for name in moments] == [2, 2, 6]


def test_a_nearness_that_is_a_number_of_numpy_gives_a_progress_that_json_can_write():
    monitor = Monitor((Stage("success", lambda now: False, lambda now: np.float32(0.25)),))
    monitor.observe(None)
    assert json.dumps(monitor.progress) == "0.25"
