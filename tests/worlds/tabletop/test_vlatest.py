"""Files in VLATest's format: ours, and those that were published, where they are available."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from scipy.spatial.transform import Rotation

from vlafuzz.errors import SceneError
from vlafuzz.model.scene import Scene
from vlafuzz.worlds.manipulation.rigs import rig
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.vlatest import Frame, read_vlatest

CATALOGUE = load_catalogue()
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


def read(folder: Path, *scenes: Any, name: str = "scenes.json", frame: Frame = "fit") -> tuple[Scene, ...]:
    return read_vlatest(write(folder / name, *scenes), CATALOGUE, frame=frame).scenes


def original(folder: Path, *scenes: Any, name: str = "t-grasp.json") -> tuple[Scene, ...]:
    return read(folder, *scenes, name=name, frame="robot")


def test_a_grasp_scene(tmp_path: Path) -> None:
    (scene,) = read(tmp_path, grasp("opened_coke_can", -0.3, 0.2, orange=other(-0.4, 0.3, level(20))))
    assert (scene.task, scene.instruction) == ("pick-up", "pick up coke can")
    (target,), (confounder,) = scene.targets, scene.confounders
    assert (target.object, target.rest, target.x, target.y) == ("coke_can", "standing", -0.04, 0.0)
    placed = (confounder.object, confounder.rest, confounder.x, confounder.y)
    assert placed == ("orange", "resting", 0.04, -0.125)


def test_near_and_far_left_and_right_are_as_its_robot_sees_them(tmp_path: Path) -> None:
    near_left, far_right = read(tmp_path, grasp("apple", -0.1, 0.0), grasp("apple", -0.5, 0.4))
    assert (near_left.targets[0].x, near_left.targets[0].y) == (-0.2, 0.25)
    assert (far_right.targets[0].x, far_right.targets[0].y) == (0.12, -0.25)


def test_a_lying_cans_top_points_where_it_did_after_half_a_turn(tmp_path: Path) -> None:
    for angle in (0.0, 100.0, -90.0, 90.0, 180.0):
        (scene,) = read(tmp_path, grasp("pepsi_can", -0.3, 0.2, level(angle)))
        target = scene.targets[0]
        assert target.rest == "lying"
        rest = Rotation.from_quat(CATALOGUE["pepsi_can"].stable_pose("lying").quaternion, scalar_first=True)
        ours = (Rotation.from_euler("z", target.yaw, degrees=True) * rest).apply([0, 0, 1])  # z: up in our cans
        theirs = Rotation.from_euler("z", angle, degrees=True).apply([0, 1, 0])  # y is up in theirs
        assert ours == pytest.approx(-theirs, abs=1e-3)


@pytest.mark.parametrize(
    ("model", "turned", "flat"),
    [
        ("sponge", ("on_edge", 180.0), ("flat", -160.0)),
        ("bridge_carrot_generated_modified", ("lying", 0.0), ("lying", 20.0)),
    ],
)
def test_poses(tmp_path: Path, model: str, turned: tuple[str, float], flat: tuple[str, float]) -> None:
    scenes = read(tmp_path, grasp(model, -0.3, 0.2), grasp(model, -0.3, 0.2, level(20)))
    poses = [(scene.targets[0].rest, scene.targets[0].yaw) for scene in scenes]
    assert poses == [turned, (flat[0], pytest.approx(flat[1]))]


def test_the_source_comes_first_wherever_it_is_listed(tmp_path: Path) -> None:
    raw = two(2, 0, apple=other(-0.2, 0.1), orange=other(-0.4, 0.1), sponge=other(-0.3, 0.3))
    (scene,) = read(tmp_path, raw)
    assert (scene.task, scene.instruction) == ("move-near", "move sponge near apple")
    assert [placement.object for placement in scene.placements] == ["sponge", "apple", "orange"]


def test_the_second_target_says_the_task_else_the_files_name(tmp_path: Path) -> None:
    on = two(0, 1, apple=other(-0.2, 0.0), table_cloth_generated=other(-0.1, 0.1, level(0)))
    into = two(0, 1, apple=other(-0.15, 0.15), dummy_sink_target_plane=other(-0.125, 0.025, level(0)))
    scenes = read(tmp_path, on, into)
    assert [scene.instruction for scene in scenes] == ["put apple on table cloth", "put apple into basket"]
    open_ = two(0, 1, apple=other(-0.2, 0.0), sponge=other(-0.1, 0.1))
    tasks = [read(tmp_path, open_, name=f"t-{name}_n-1.json")[0].task for name in ("any", "put-on", "grasp")]
    assert tasks == ["move-near", "put-on", "move-near"]


def test_scenes_without_a_counterpart_are_left_out_and_counted(tmp_path: Path) -> None:
    one_more = grasp("apple", -0.3, 0.2, hammer=other(-0.2, 0.1), mug=other(-0.4, 0.1))
    hammer = grasp("hammer", -0.3, 0.2, apple=other(-0.2, 0.1))
    path = write(tmp_path / "x.json", grasp("apple", -0.3, 0.2), hammer, one_more)
    imported = read_vlatest(path, CATALOGUE)
    assert (imported.read, len(imported.scenes), imported.left_out) == (3, 1, 2)
    assert imported.missing == {"hammer": 2, "mug": 1}


def test_ycb_files_have_meshes_of_their_own(tmp_path: Path) -> None:
    raw = grasp("sponge", -0.3, 0.2, level(0))
    assert read(tmp_path, raw)[0].targets[0].yaw == 180.0
    assert read(tmp_path, raw, name="ycb_t-grasp.json")[0].targets[0].yaw == -90.0


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
        (json.dumps({"0": grasp("apple", -0.3, 0.2, [0.5, 0.5, -0.5, 0.5])}), "0: apple: orientation"),
    ],
)
def test_a_malformed_file_is_a_sentence_with_file_and_key(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "scenes.json"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        read_vlatest(path, CATALOGUE)
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
    (scene,) = original(tmp_path, GRASP)
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
    (scene,) = original(tmp_path, turned(0, 1, "pepsi_can", "bridge_plate_objaverse_larger", "green_cube_3cm"))
    assert (scene.robot, scene.instruction) == ("widowx", "put pepsi can on plate larger")
    assert [placement.scale for placement in scene.placements] == [0.5, 1.0, 1.0]
    (near,) = original(tmp_path, turned(0, 1, "pepsi_can", "apple"))
    assert [placement.scale for placement in near.placements] == [1.0, 1.0]


def test_objects_of_ycb_have_names_of_their_own(tmp_path: Path) -> None:
    raw = turned(0, 1, "apple", "table_cloth_generated", "plate")
    (scene,) = original(tmp_path, raw, name="ycb_t-put-on.json")
    assert names(scene) == ["ycb:apple", "custom:table_cloth_generated", "ycb:plate"]
    assert [placement.scale for placement in scene.placements] == [0.5, 1.0, 0.5]
    assert scene.instruction == "put apple on table cloth"


def test_the_list_is_kept_where_the_targets_are_not_its_first(tmp_path: Path) -> None:
    mixed, plain = original(tmp_path, turned(2, 0, "apple", "orange", "sponge"), turned(0, 1, "apple", "orange"))
    assert names(mixed) == ["custom:sponge", "custom:apple", "custom:orange"]
    assert [placed.listed for placed in mixed.placements] == [2, 0, 1]
    assert Scene.from_json(mixed.to_json()) == mixed
    assert "listed" not in plain.to_json()


@pytest.mark.skipif(not FILES, reason="no VLATest scenes in ../shared/vlatest/scenes")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_of_the_published_files_every_scene_is_read(path: Path) -> None:
    assert len(read_vlatest(path, CATALOGUE, frame="robot").scenes) == json.loads(path.read_text())["num"]
