"""Our own numbers in VLATest's format; the published files are read where they are available."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from scipy.spatial.transform import Rotation

from vlafuzz.errors import SceneError
from vlafuzz.model.scene import Scene
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.vlatest.read import read_vlatest

CATALOGUE = load_catalogue()
UPRIGHT = [0.7071067811865476, 0.7071067811865475, 0.0, 0.0]
REAL = Path(__file__).resolve().parents[4].parent / "shared" / "vlatest" / "scenes"


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


def write(folder: Path, *scenes: Any, name: str = "scenes.json") -> Path:
    path = folder / name
    path.write_text(
        json.dumps({str(i): scene for i, scene in enumerate(scenes)} | {"seed": 1, "num": len(scenes)})
    )
    return path


def read(folder: Path, *scenes: Any, name: str = "scenes.json", **more: Any) -> tuple[Scene, ...]:
    return read_vlatest(write(folder, *scenes, name=name), CATALOGUE, **more).scenes


def test_a_grasp_scene(tmp_path: Path) -> None:
    (scene,) = read(tmp_path, grasp("opened_coke_can", -0.3, 0.2, orange=other(-0.4, 0.3, level(20))))
    assert (scene.task, scene.instruction) == ("pick-up", "pick up coke can")
    (target,), (confounder,) = scene.targets, scene.confounders
    assert (target.object, target.rest, target.x, target.y) == ("coke_can", "standing", -0.04, 0.0)
    assert (confounder.object, confounder.rest, confounder.x, confounder.y) == (
        "orange",
        "resting",
        0.04,
        -0.125,
    )


def test_near_and_far_left_and_right_are_as_its_robot_sees_them(tmp_path: Path) -> None:
    near_left, far_right = read(tmp_path, grasp("apple", -0.1, 0.0), grasp("apple", -0.5, 0.4))
    assert (near_left.targets[0].x, near_left.targets[0].y) == (-0.2, 0.25)
    assert (far_right.targets[0].x, far_right.targets[0].y) == (0.12, -0.25)


def test_keep_keeps_distances(tmp_path: Path) -> None:
    a, b = read(tmp_path, grasp("apple", -0.1, 0.0), grasp("apple", -0.5, 0.4), frame="keep")
    assert a.targets[0].x - b.targets[0].x == pytest.approx(-0.4)
    assert a.targets[0].y - b.targets[0].y == pytest.approx(0.4)


def test_a_lying_cans_top_points_where_it_did_after_half_a_turn(tmp_path: Path) -> None:
    for angle in (0.0, 100.0, -90.0, 90.0, 180.0):
        (scene,) = read(tmp_path, grasp("pepsi_can", -0.3, 0.2, level(angle)))
        target = scene.targets[0]
        assert target.rest == "lying"
        rest = Rotation.from_quat(CATALOGUE["pepsi_can"].stable_pose("lying").quaternion, scalar_first=True)
        ours = (Rotation.from_euler("z", target.yaw, degrees=True) * rest).apply(
            [0, 0, 1]
        )  # z is up in our cans
        theirs = Rotation.from_euler("z", angle, degrees=True).apply([0, 1, 0])  # y is up in theirs
        assert ours == pytest.approx(-theirs, abs=1e-3)


@pytest.mark.parametrize(
    ("model", "turned", "flat"),
    [
        ("sponge", ("on_edge", 180.0), ("flat", -160.0)),
        ("bridge_spoon_generated_modified", ("lying", 180.0), ("lying", -160.0)),
        ("bridge_carrot_generated_modified", ("lying", 0.0), ("lying", 20.0)),
        ("green_cube_3cm", ("flat", 180.0), ("flat", -160.0)),
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


def test_the_second_target_says_the_task(tmp_path: Path) -> None:
    on = two(0, 1, apple=other(-0.2, 0.0), table_cloth_generated=other(-0.1, 0.1, level(0)))
    into = two(0, 1, apple=other(-0.15, 0.15), dummy_sink_target_plane=other(-0.125, 0.025, level(0)))
    scenes = read(tmp_path, on, into)
    assert [scene.instruction for scene in scenes] == ["put apple on table cloth", "put apple into basket"]


def test_the_file_name_decides_what_the_content_leaves_open(tmp_path: Path) -> None:
    raw = two(0, 1, apple=other(-0.2, 0.0), sponge=other(-0.1, 0.1))
    assert read(tmp_path, raw)[0].task == "move-near"
    assert read(tmp_path, raw, name="t-put-on_n-1.json")[0].task == "put-on"
    assert read(tmp_path, raw, name="t-grasp_n-1.json")[0].task == "move-near"


def test_scenes_without_a_counterpart_are_left_out_and_counted(tmp_path: Path) -> None:
    path = write(tmp_path, grasp("apple", -0.3, 0.2), grasp("hammer", -0.3, 0.2, apple=other(-0.2, 0.1)),
                 grasp("apple", -0.3, 0.2, hammer=other(-0.2, 0.1), mug=other(-0.4, 0.1)))  # fmt: skip
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
        ("{", "not JSON"),
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
        (
            json.dumps({"0": two(0, 7, apple=other(0, 0))}),
            "0: target_obj_id: 7 is not the index of one of 1 objects",
        ),
        (
            json.dumps({"0": two(0, 1, apple=other(0, 0)) | {"model_ids": ["mug"]}}),
            "0: there are no options for 'mug'",
        ),
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


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"nowhere\.json: cannot be read: no such file"):
        read_vlatest(tmp_path / "nowhere.json", CATALOGUE)


@pytest.mark.skipif(not REAL.is_dir(), reason="no VLATest scenes in ../shared/vlatest/scenes")
@pytest.mark.parametrize(
    ("pattern", "task", "written"),
    [
        ("t-grasp_n-100_o-3_*", "pick-up", 100),
        ("t-move_n-100_o-1_*", "move-near", 100),
        ("t-put-on_n-100_o-0_*", "put-on", 100),
        ("t-put-in_n-100_o-2_*", "put-in", 100),
        ("ycb_t-put-on_*", "put-on", 24),
    ],
)
def test_the_published_files(pattern: str, task: str, written: int) -> None:
    (path,) = REAL.glob(pattern)
    imported = read_vlatest(path, CATALOGUE)
    assert len(imported.scenes) == written
    assert {scene.task for scene in imported.scenes} == {task}
    assert all(Scene.from_json(scene.to_json()) == scene for scene in imported.scenes)
