"""Scenes are read as published and written back: the published files themselves where they are available."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vlafuzz.model.scene import Camera, Light, Scene
from vlafuzz.worlds.manipulation.rigs.robots import rig
from vlafuzz.worlds.tabletop.fairness import check_semantic
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS
from vlafuzz.worlds.tabletop.vlatest.read import Frame, read_vlatest
from vlafuzz.worlds.tabletop.vlatest.write import write_vlatest

CATALOGUE = load_catalogue()
UPRIGHT = [0.7071067811865476, 0.7071067811865475, 0.0, 0.0]
TURNED = [0.5783, 0.0, 0.0, 0.8158]
REAL = Path(__file__).resolve().parents[4].parent / "shared" / "vlatest" / "scenes"
FILES = sorted(REAL.glob("*t-*_n-*.json"))
GRASP: dict[str, Any] = {
    "model_id": "opened_7up_can",
    "obj_init_options": {"init_xy": [-0.3, 0.2], "orientation": UPRIGHT},
    "distractor_model_ids": ["hammer", "apple"],
    "distractor_obj_init_options": {
        "hammer": {"init_xy": [-0.4, 0.1], "init_rot_quat": TURNED},
        "apple": {"init_xy": [-0.2, 0.3], "init_rot_quat": UPRIGHT},
    },
}


def two(source: int, target: int, *models: str) -> dict[str, Any]:
    options = {
        model: {"init_xy": [-0.1 * place, 0.03], "init_rot_quat": TURNED}
        for place, model in enumerate(models)
    }
    ids = {"model_ids": list(models), "obj_init_options": options}
    return ids | {"source_obj_id": source, "target_obj_id": target}


def write(path: Path, *scenes: dict[str, Any]) -> Path:
    numbered = {str(number): scene for number, scene in enumerate(scenes)}
    path.write_text(json.dumps(numbered | {"seed": 77, "num": len(scenes)}))
    return path


def original(path: Path, frame: Frame = "original") -> tuple[Scene, ...]:
    return read_vlatest(path, CATALOGUE, frame=frame).scenes


def test_coordinates_names_orientation_and_robot_are_kept(tmp_path: Path) -> None:
    (scene,) = original(write(tmp_path / "t-grasp.json", GRASP))
    (target,) = scene.targets
    assert (scene.task, scene.robot, scene.instruction) == ("pick-up", "google", "pick up 7up can")
    assert scene.frame == "vlatest"
    assert (target.object, target.x, target.y, target.quaternion) == (
        "custom:opened_7up_can", -0.3, 0.2, tuple(UPRIGHT),
    )  # fmt: skip
    assert [placement.object for placement in scene.confounders] == ["custom:hammer", "custom:apple"]


def test_most_objects_of_the_put_tasks_have_half_their_size(tmp_path: Path) -> None:
    raw = two(0, 1, "pepsi_can", "bridge_plate_objaverse_larger", "green_cube_3cm")
    (scene,) = original(write(tmp_path / "x.json", raw))
    assert (scene.robot, scene.instruction) == ("widowx", "put pepsi can on plate larger")
    assert [placement.scale for placement in scene.placements] == [0.5, 1.0, 1.0]
    (near,) = original(write(tmp_path / "x.json", two(0, 1, "pepsi_can", "apple")))
    assert [placement.scale for placement in near.placements] == [1.0, 1.0]


def test_objects_of_ycb_have_names_of_their_own(tmp_path: Path) -> None:
    raw = two(0, 1, "apple", "table_cloth_generated", "plate")
    (scene,) = original(write(tmp_path / "ycb_t-put-on.json", raw))
    assert [placement.object for placement in scene.placements] == [
        "ycb:apple",
        "custom:table_cloth_generated",
        "ycb:plate",
    ]
    assert [placement.scale for placement in scene.placements] == [0.5, 1.0, 0.5]
    assert scene.instruction == "put apple on table cloth"


def test_the_list_is_kept_where_the_targets_are_not_its_first(tmp_path: Path) -> None:
    path = write(tmp_path / "x.json", two(2, 0, "apple", "orange", "sponge"), two(0, 1, "apple", "orange"))
    mixed, plain = original(path)
    assert [placement.object for placement in mixed.placements] == [
        "custom:sponge",
        "custom:apple",
        "custom:orange",
    ]
    assert [placement.object for placement in mixed.listing] == [
        "custom:apple",
        "custom:orange",
        "custom:sponge",
    ]
    assert Scene.from_json(mixed.to_json()) == mixed
    assert "listed" not in plain.to_json()


def test_what_is_written_is_the_file_that_was_read(tmp_path: Path) -> None:
    alone = {key: GRASP[key] for key in ("model_id", "obj_init_options")}
    path = write(tmp_path / "t-move_n-3_o-m3_s-77.json", GRASP, alone, two(2, 0, "apple", "orange", "sponge"))
    again = tmp_path / "again" / path.name
    again.parent.mkdir()
    assert write_vlatest(again, original(path), CATALOGUE) == {}
    assert json.loads(again.read_text()) == json.loads(path.read_text())


def test_what_is_left_of_a_scene_keeps_its_order(tmp_path: Path) -> None:
    path = write(tmp_path / "x.json", two(3, 0, "apple", "orange", "sponge", "eggplant"))
    (scene,) = original(path)
    left = replace(scene, confounders=scene.confounders[1:])
    write_vlatest(path, [left], CATALOGUE)
    raw = json.loads(path.read_text())["0"]
    assert (raw["model_ids"], raw["source_obj_id"], raw["target_obj_id"]) == (
        ["apple", "sponge", "eggplant"], 2, 0,
    )  # fmt: skip


def test_of_scenes_as_published_it_leaves_out_and_counts_them_too(tmp_path: Path) -> None:
    (scene,) = original(write(tmp_path / "t-grasp.json", GRASP))
    (target,) = scene.targets
    changed = [
        replace(scene, light=Light(2.0)),
        replace(scene, instruction="fetch it"),
        replace(scene, targets=(replace(target, scale=0.9),)),
        replace(scene, targets=(replace(target, object="ycb:mug"),), instruction="pick up mug"),
        replace(scene, targets=(replace(target, object="apple"),), instruction="pick up apple"),
        replace(scene, targets=(replace(target, quaternion=None),)),
    ]
    left_out = write_vlatest(tmp_path / "t-grasp.json", [*changed, scene], CATALOGUE)
    assert Counter(left_out.values()) == {1: 6}
    assert original(tmp_path / "t-grasp.json") == (scene,)


def alike(first: Any, other: Any) -> bool:
    """Whether two documents are equal, numbers to 1e-9."""
    if isinstance(first, dict):
        return first.keys() == other.keys() and all(alike(first[key], other[key]) for key in first)
    if isinstance(first, list):
        return len(first) == len(other) and all(map(alike, first, other))
    return abs(first - other) <= 1e-9 if isinstance(first, float) else bool(first == other)


def test_its_coordinates_are_not_those_of_our_rigs(tmp_path: Path) -> None:
    (scene,) = original(write(tmp_path / "t-grasp.json", GRASP))
    rejection = check_semantic(scene, CATALOGUE)
    assert rejection
    assert rejection.reason == "its coordinates are in the frame of vlatest, not of its robot"


def test_the_robot_sees_the_same_in_our_frame(tmp_path: Path) -> None:
    """Its Google robot stands at (0.35, 0.20) and faces -x."""
    (scene,) = original(write(tmp_path / "t-grasp.json", GRASP), "robot")
    target, base = scene.targets[0], rig("google").base
    assert (scene.frame, scene.robot) == ("", "google")
    assert (target.x - base[0], target.y - base[1]) == pytest.approx((0.65, 0.0))
    up = Rotation.from_quat(target.quaternion, scalar_first=True).apply([0.0, 1.0, 0.0])
    assert up == pytest.approx([0.0, 0.0, 1.0])
    near, far = scene.confounders[1], scene.confounders[0]
    assert near.x < target.x < far.x
    assert near.y < target.y < far.y  # its left is our right: the robot is turned by half a turn


@pytest.mark.skipif(not FILES, reason="no VLATest scenes in ../shared/vlatest/scenes")
@pytest.mark.parametrize("frame", ["original", "robot"])
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_published_files_come_back_as_they_are(tmp_path: Path, path: Path, frame: Frame) -> None:
    raw = json.loads(path.read_text())
    scenes = [Scene.from_json(scene.to_json()) for scene in original(path, frame)]
    assert len(scenes) == raw["num"]
    assert write_vlatest(tmp_path / path.name, scenes, CATALOGUE) == {}
    assert alike(json.loads((tmp_path / path.name).read_text()), raw)


IN_FORMAT = ("target-type", "target-position", "target-orientation", "confounder-type", "confounder-position",
        "confounder-orientation", "confounder-count")  # fmt: skip


def scenes(task: str, number: int) -> list[Scene]:
    space = SearchSpace(load_operators().only(IN_FORMAT), CATALOGUE, task)
    return [space.sample(np.random.default_rng(seed)) for seed in range(number)]


def near(first: Scene, other: Scene) -> bool:
    def flat(scene: Scene) -> list[float]:
        return [value for thing in scene.placements for value in (thing.x, thing.y, thing.yaw % 360)]

    def names(scene: Scene) -> list[tuple[str, str]]:
        return [(thing.object, thing.rest) for thing in scene.placements]

    if (first.task, first.instruction, names(first)) != (other.task, other.instruction, names(other)):
        return False
    off = np.abs(np.subtract(flat(first), flat(other)))
    return bool(np.all(np.minimum(off, 360 - off) < 1e-3))


@pytest.mark.parametrize("task", TASKS)
def test_scenes_read_back_as_they_were(tmp_path: Path, task: str) -> None:
    wanted = scenes(task, 40)
    path = tmp_path / f"{task}.json"
    left_out = write_vlatest(path, wanted, CATALOGUE)
    assert all("rest" in reason or "VLATest has no" in reason for reason in left_out)
    read = read_vlatest(path, CATALOGUE).scenes
    assert len(read) == len(wanted) - sum(left_out.values()) > 20
    assert all(any(near(scene, candidate) for candidate in wanted) for scene in read)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"light": Light(2.0)}, "light"),
        ({"camera": Camera(yaw=1.0)}, "camera"),
        ({"instruction": "Fetch it"}, "wording"),
        ({"then": ("hold it up",)}, "wording"),
    ],
)
def test_what_the_format_cannot_express_is_left_out_and_counted(tmp_path: Path, change, reason: str) -> None:
    scene = scenes("pick-up", 1)[0]
    path = tmp_path / "t-grasp.json"
    left_out = write_vlatest(path, [replace(scene, **change), scene], CATALOGUE)
    assert left_out == {f"VLATest's scene files have no {reason}": 1}
    assert len(read_vlatest(path, CATALOGUE).scenes) == 1


def test_tasks_and_objects_that_vlatest_does_not_have_are_left_out_and_counted(tmp_path: Path) -> None:
    scene = scenes("pick-up", 1)[0]
    unknown = replace(scene, targets=(replace(scene.targets[0], object="anvil"),))
    others = [replace(scene, task="juggle"), replace(scene, targets=scene.targets * 2), unknown]
    assert write_vlatest(tmp_path / "t-grasp.json", [*others, scene], CATALOGUE) == {
        "VLATest has no task juggle": 1,
        "VLATest has no pick-up with 2 target(s)": 1,
        "VLATest has no anvil": 1,
    }
