"""The expert's solutions of failing scenes, written as the policy acts: what is read back solves them."""

import io
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.cli.typed import typed
from tests.doubles import ended, stored
from tests.exports.test_lerobot import LEROBOT, read_by_lerobot
from tests.rollouts.test_scene_runner import run
from tests.worlds.tabletop.sim.scenes import nominal, pick_up, put
from vlafuzz.cli import main
from vlafuzz.exports.demonstrations import Demonstrations, ExpertRunner, Packed
from vlafuzz.exports.selection import around, failures_of
from vlafuzz.model import Latency, Scene
from vlafuzz.policies.base import ActionSpec, CameraRequest, PolicySpec
from vlafuzz.policies.clients.model import Model
from vlafuzz.policies.clients.servers import options_of
from vlafuzz.store.records import Manifest
from vlafuzz.store.store import Store
from vlafuzz.worlds.provenance import described

CAN, APPLE = nominal(), pick_up(put("apple", 0.02, 0.1))
INSIDE = pick_up(put("apple", 0.02, 0.1), put("orange", 0.02, 0.1))  # not fair: one in the other
LIBERO = "openpi:ws://gpu:8000?profile=libero"


def of_policy(name: str) -> Manifest:
    """The run of a policy behind a server, which nobody asks."""
    return replace(run("make_frozen"), policy=name, spec=described(Model(name, options_of(name)).spec))


def tiny_pictures(**action: object) -> Manifest:
    cameras = (CameraRequest("front", 32, 24),)
    return replace(run("make_frozen"), spec=described(PolicySpec("own", action=ActionSpec(**action), cameras=cameras)))


def failing(path: Path, manifest: Manifest, *scenes: Scene) -> Path:
    trials = (ended(scene, proposal=at, cell=f"grasp|light|x{at}y0") for at, scene in enumerate(scenes))
    return stored(path, *trials, about=manifest)


def solved(manifest: Manifest, scene: Scene) -> np.ndarray:
    """The actions of the expert's solution as they are written, which solve the scene once more."""
    runner = ExpertRunner(manifest)
    shown = runner.show(scene)
    runner.close()
    assert isinstance(shown, Packed)
    return shown.actions


@pytest.mark.render
@pytest.mark.parametrize(
    ("options", "most"),
    [
        ("profile=libero", 2.0),  # moves in units of 5 cm, at 20 Hz
        ("hz=10&relative_to=target&sticky=3&rotation=rpy&gripper=close_01", 1.0),
    ],
)
def test_a_solution_is_written_as_the_policy_acts(options: str, most: float):
    solution = solved(of_policy(f"openpi:ws://gpu:8000?{options}"), CAN)
    assert solution.shape[1] == 7
    assert 0.5 < np.abs(solution).max() <= most
    opened = 0.0 if "close_01" in options else -1.0
    assert (solution[0, -1], solution[-1, -1]) == (opened, 1.0)


@pytest.mark.render
def test_a_robot_that_acts_late_is_shown_actions_that_are_early():
    late = solved(tiny_pictures(relative_to="current"), replace(CAN, latency=Latency(2)))
    in_time = solved(tiny_pictures(relative_to="current"), CAN)
    assert len(in_time) < len(late) <= len(in_time) + 2
    assert np.array_equal(late[: len(in_time)], in_time)


@pytest.mark.render
def test_every_demonstration_of_a_scene_is_another_one(tmp_path: Path):
    path = failing(tmp_path / "a.db", tiny_pictures(), CAN)
    wanted = list(islice(around(path, failures_of(path)), 3))
    assert [each.attempt for each in wanted] == [0, 1, 2]
    of_one = Demonstrations().shown((each._replace(scene=CAN) for each in wanted), 3, 3)
    assert len({each.actions.tobytes() for each in of_one}) == 3
    scenes = [each.scene for each in Demonstrations().shown(iter(wanted), 3, 3)]
    assert scenes[0] == CAN
    assert len(set(scenes)) == 3
    x = [each.targets[0].x for each in scenes]
    assert max(x) - min(x) < 0.01


@pytest.mark.render
def test_scenes_that_cannot_be_shown_are_counted(tmp_path: Path):
    path = failing(tmp_path / "a.db", tiny_pictures(), INSIDE, CAN)
    demonstrations = Demonstrations()
    assert [each.scene for each in demonstrations.shown(around(path, failures_of(path)), 2, 2)] == [CAN]
    assert demonstrations.left_out == {"its scene is not fair": 1}


def exported(store: Path, out: Path, *flags: str) -> list[list[dict[str, Any]]]:
    """The rows of frames and of episodes of the dataset that the command writes."""
    parquet = pytest.importorskip("pyarrow.parquet")
    assert main(["export", str(store), "--format", "lerobot", "--out", str(out), "--workers", "1", *flags]) == 0
    tables = ("data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet")
    return [parquet.read_table(out / table).to_pylist() for table in tables]


@pytest.mark.render
def test_actions_that_are_read_from_the_dataset_solve_their_scenes(tmp_path: Path):
    manifest = tiny_pictures(hz=10, relative_to="current", gripper="close_positive")
    path = failing(tmp_path / "a.db", manifest, CAN, APPLE)
    rows, episodes = exported(path, tmp_path / "shown", "--demos", "3")
    assert [row["scene"] for row in episodes[:2]] == [CAN.digest, APPLE.digest]
    assert [row["finding"] for row in episodes] == [CAN.digest, APPLE.digest, CAN.digest]
    runner = ExpertRunner(manifest)
    with Store.open(path) as store:
        for episode in episodes[:2]:
            own = rows[episode["dataset_from_index"] : episode["dataset_to_index"]]
            scene = store.scene(episode["scene"])
            shown = runner.record(scene, np.array([row["action"] for row in own], np.float32))
            assert shown is not None
            first = np.array(Image.open(io.BytesIO(own[0]["observation.images.front"]["bytes"])))
            assert np.array_equal(Image.open(io.BytesIO(shown.pictures["observation.images.front"][0])), first)
            assert np.array_equal(shown.states[-1], own[-1]["observation.state"])
    runner.close()


@pytest.mark.render
def test_random_scenes_are_as_many_as_there_are_failures(tmp_path: Path):
    path = failing(tmp_path / "a.db", tiny_pictures(), CAN, APPLE)
    _, episodes = exported(path, tmp_path / "shown", "--scenes", "random")
    assert [row["finding"] for row in episodes] == ["", ""]
    assert not {row["scene"] for row in episodes} & {CAN.digest, APPLE.digest}


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--demos", "3"], "--demos 3: only --format lerobot has it"),
        (["--format", "lerobot", "--demos", "0"], "--demos: expected at least 1, got 0"),
    ],
)
def test_flags_that_make_no_sense(tmp_path: Path, flags: list[str], says: str, capsys):
    path = failing(tmp_path / "a.db", tiny_pictures(), CAN)
    said = typed(capsys, ["export", str(path), "--out", str(tmp_path / "out"), *flags], code=2).err
    assert says in " ".join(said.split())


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.skipif(LEROBOT is None, reason="VLAFUZZ_LEROBOT names no Python with lerobot")
def test_lerobot_reads_what_a_policy_of_its_own_is_trained_with(tmp_path: Path):
    name = "openpi:ws://gpu:8000?profile=libero"
    path, out = failing(tmp_path / "a.db", of_policy(name), CAN, APPLE), tmp_path / "shown"
    assert main(["export", str(path), "--format", "lerobot", "--demos", "3", "--out", str(out)]) == 0
    read = read_by_lerobot(out)
    assert (read["episodes"], read["fps"], read["shape"]) == (3, 20, [3, 224, 224])
    assert (len(read["state"]), len(read["action"][0])) == (8, 7)
    assert read["task"] == CAN.instruction
