"""Files in VLATest's format: ours, and those that were published, where they are available."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from scipy.spatial.transform import Rotation

from vlafuzz.errors import SceneError
from vlafuzz.model import Scene
from vlafuzz.worlds.manipulation.rigs import rig
from vlafuzz.worlds.tabletop.vlatest import read_vlatest

UPRIGHT = [0.7071067811865476, 0.7071067811865475, 0.0, 0.0]
TURNED = [0.5783, 0.0, 0.0, 0.8158]
REAL = Path(__file__).resolve().parents[3].parent / "shared" / "vlatest" / "scenes"
FILES = sorted(REAL.glob("*t-*_n-*.json"))


def level(degrees: float) -> list[float]:
    half = math.radians(degrees) / 2
    return [math.cos(half), 0.0, 0.0, math.sin(half)]


def other(x: float, y: float, quaternion: list[float] = UPRIGHT) -> dict[str, Any]:
    return {"init_xy": [x, y], "init_rot_quat": quaternion}


def grasp(model: str, x: float, y: float, quaternion: list[float] = UPRIGHT, **others: Any) -> dict[str, Any]:
    first = {"model_id": model, "obj_init_options": {"init_xy": [x, y], "orientation": quaternion}}
    if others:
        first |= {"distractor_model_ids": list(others), "distractor_obj_init_options": others}
    return first


def two(source: int, target: int, **objects: Any) -> dict[str, Any]:
    ids = {"model_ids": list(objects), "obj_init_options": objects}
    return ids | {"source_obj_id": source, "target_obj_id": target}


def write(path: Path, *scenes: Any) -> Path:
    numbered = {str(number): scene for number, scene in enumerate(scenes)}
    path.write_text(json.dumps(numbered | {"seed": 77, "num": len(scenes)}))
    return path


def read(folder: Path, *scenes: Any, name: str = "t-grasp.json") -> list[Scene]:
    return read_vlatest(write(folder / name, *scenes))


def test_the_second_target_says_the_task_else_the_files_name(tmp_path: Path) -> None:
    on = two(0, 1, apple=other(-0.2, 0.0), table_cloth_generated=other(-0.1, 0.1, level(0)))
    into = two(0, 1, apple=other(-0.15, 0.15), dummy_sink_target_plane=other(-0.125, 0.025, level(0)))
    scenes = read(tmp_path, on, into)
    assert [scene.instruction for scene in scenes] == ["put apple on table cloth", "put apple into yellow basket"]
    open_ = two(0, 1, apple=other(-0.2, 0.0), sponge=other(-0.1, 0.1))
    tasks = [read(tmp_path, open_, name=f"t-{name}_n-1.json")[0].task for name in ("any", "put-on", "grasp")]
    assert tasks == ["move-near", "put-on", "move-near"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[]", "not a scene file of VLATest"),
        ('{"t-grasp_n-1000": {}}', "t-grasp_n-1000: unknown key"),
        ('{"0": {}, "num": 2}', "num: says 2, but there are 1 scenes"),
        ('{"0": 3}', "0: input should be"),
        ('{"0": {"model_id": "apple"}}', "0: obj_init_options: field required"),
        (json.dumps({"0": grasp("apple", -0.3, 0.2) | {"lighting": 1}}), "0: lighting: extra inputs"),
        (
            json.dumps({"0": grasp("apple", -0.3, float("nan"))}),
            "0: obj_init_options.init_xy.1: input should be a finite",
        ),
        (json.dumps({"0": two(0, 7, apple=other(0, 0))}), "0: target_obj_id: 7 is not the index of one of 1 objects"),
        (json.dumps({"0": two(0, 1, apple=other(0, 0)) | {"model_ids": ["mug"]}}), "0: there are no options for 'mug'"),
    ],
)
def test_a_malformed_file_is_a_sentence_with_file_and_key(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "scenes.json"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        read_vlatest(path)
    assert caught.value.message.startswith(f"{path}: ")
    assert says in caught.value.message
    assert "\n" not in caught.value.message


GRASP = grasp("opened_7up_can", -0.3, 0.2, hammer=other(-0.4, 0.1, TURNED), apple=other(-0.2, 0.3))


def turned(source: int, target: int, *models: str) -> dict[str, Any]:
    options = {model: other(-0.1 * place, 0.03, TURNED) for place, model in enumerate(models)}
    return two(source, target, **options)


def names(scene: Scene) -> list[str]:
    return [placement.object for placement in scene.placements]


def test_the_robot_sees_the_same_in_our_frame(tmp_path: Path) -> None:
    """Its Google robot stands at (0.35, 0.20) and faces -x."""
    (scene,) = read(tmp_path, GRASP)
    (target,), base = scene.targets, rig("google").base
    assert (scene.task, scene.robot, scene.instruction) == ("pick-up", "google", "pick up 7up can")
    assert names(scene) == ["custom:opened_7up_can", "custom:hammer", "custom:apple"]
    assert (target.x - base[0], target.y - base[1]) == pytest.approx((0.65, 0.0))
    up = Rotation.from_quat(target.quaternion, scalar_first=True).apply([0.0, 1.0, 0.0])
    assert up == pytest.approx([0.0, 0.0, 1.0])
    far, near = scene.confounders
    assert near.x < target.x < far.x
    assert near.y < target.y < far.y  # its left is our right: the robot is turned by half a turn
    assert math.dist((near.x, near.y), (far.x, far.y)) == pytest.approx(math.hypot(0.2, 0.2))


def test_most_objects_of_the_put_tasks_have_half_their_size(tmp_path: Path) -> None:
    (scene,) = read(tmp_path, turned(0, 1, "pepsi_can", "bridge_plate_objaverse_larger", "green_cube_3cm"))
    assert (scene.robot, scene.instruction) == ("widowx", "put pepsi can on plate larger")
    assert [placement.scale for placement in scene.placements] == [0.5, 1.0, 1.0]
    (near,) = read(tmp_path, turned(0, 1, "pepsi_can", "apple"))
    assert [placement.scale for placement in near.placements] == [1.0, 1.0]


def test_objects_of_ycb_have_names_of_their_own(tmp_path: Path) -> None:
    raw = turned(0, 1, "apple", "table_cloth_generated", "plate")
    (scene,) = read(tmp_path, raw, name="ycb_t-put-on.json")
    assert names(scene) == ["ycb:apple", "custom:table_cloth_generated", "ycb:plate"]
    assert [placement.scale for placement in scene.placements] == [0.5, 1.0, 0.5]
    assert scene.instruction == "put apple on table cloth"


def test_the_list_is_kept_where_the_targets_are_not_its_first(tmp_path: Path) -> None:
    mixed, plain = read(tmp_path, turned(2, 0, "apple", "orange", "sponge"), turned(0, 1, "apple", "orange"))
    assert names(mixed) == ["custom:sponge", "custom:apple", "custom:orange"]
    assert [placed.listed for placed in mixed.placements] == [2, 0, 1]
    assert Scene.from_json(mixed.to_json()) == mixed
    assert "listed" not in plain.to_json()


@pytest.mark.skipif(not FILES, reason="no VLATest scenes in ../shared/vlatest/scenes")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_of_the_published_files_every_scene_is_read(path: Path) -> None:
    assert len(read_vlatest(path)) == json.loads(path.read_text())["num"]
