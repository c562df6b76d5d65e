"""A scene is a value: written, read and compared without loss."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from vlafuzz.errors import SceneError
from vlafuzz.model import Camera, Light, Placement, Scene
from vlafuzz.model.scene import SCHEMA
from vlafuzz.model.scene_lines import load_scenes, read_scenes, write_scenes
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

NUMBER = st.floats(-1e6, 1e6)
TEXTS = st.text(st.characters(exclude_categories=("Cc", "Cf", "Cs", "Zl", "Zp")))
QUATERNIONS, LISTED = st.none() | st.tuples(*[NUMBER] * 4), st.none() | st.integers(0, 9)
PLACEMENTS = st.builds(Placement, TEXTS, TEXTS, *[NUMBER] * 3, quaternion=QUATERNIONS, scale=NUMBER, listed=LISTED)
SCENES = st.builds(
    Scene,
    task=TEXTS,
    targets=st.lists(PLACEMENTS, min_size=1, max_size=2).map(tuple),
    instruction=TEXTS,
    confounders=st.lists(PLACEMENTS, max_size=4).map(tuple),
    light=st.builds(Light, NUMBER),
    camera=st.builds(Camera, NUMBER, NUMBER, NUMBER, roll=NUMBER, pitch=NUMBER, yaw=NUMBER),
    robot=TEXTS,
)
ONE = Scene(
    "put-on",
    (Placement("apple", "resting", 0.1, -0.2, 30.0), Placement("plate", "flat", -0.05, 0.1)),
    "put apple on plate",
    confounders=(Placement("orange", "resting", -0.15, 0.0, quaternion=(1.0, 0.0, 0.0, 0.0), scale=0.9),),
    light=Light(2.0),
    camera=Camera(0.05, 90.0, 45.0, roll=1.0, pitch=2.0, yaw=3.0),
)
TEXT = ONE.to_json()


@given(SCENES)
def test_what_is_written_is_read_back_equal(scene: Scene):
    again = Scene.from_json(scene.to_json())
    assert (again, again.digest, again.to_json()) == (scene, scene.digest, scene.to_json())


@given(SCENES, SCENES)
def test_scenes_have_equal_digests_exactly_when_they_are_equal(one: Scene, other: Scene):
    assert (one == other) == (one.digest == other.digest)


@pytest.mark.parametrize(
    "changed",
    [
        replace(ONE, task="put-in"),
        replace(ONE, instruction="Put apple on plate"),
        replace(ONE, targets=ONE.targets[::-1]),
        *(
            replace(ONE, targets=(replace(ONE.targets[0], **{name: 0.5}), ONE.targets[1]))
            for name in ("x", "y", "yaw", "scale")
        ),
        replace(ONE, targets=ONE.placements, confounders=()),
        replace(ONE, confounders=(replace(ONE.confounders[0], quaternion=None),)),
        replace(ONE, light=Light(2.0000000001)),
        replace(ONE, camera=replace(ONE.camera, roll=2.0, pitch=1.0)),
        replace(ONE, robot="widowx"),
        replace(ONE, schema=0),
    ],
)
def test_a_digest_sees_everything_that_is_shown(changed):
    assert changed.digest != ONE.digest


def test_whole_numbers_and_minus_zero_are_the_floats_that_they_equal():
    floats = replace(ONE, light=Light(1.0), camera=Camera(0.0))
    for same in (replace(floats, light=Light(1)), *(replace(floats, camera=Camera(x)) for x in (-0.0, 0))):
        assert (same, same.digest, same.to_json()) == (floats, floats.digest, floats.to_json())


def test_the_order_of_keys_and_blanks_in_a_file_do_not_matter():
    shuffled = json.dumps(dict(reversed(json.loads(TEXT).items())), indent=2)
    assert Scene.from_json(shuffled).digest == ONE.digest


def test_a_digest_is_a_constant_of_the_file_format():
    plain = Scene("pick-up", (Placement("green_cube", "flat", -0.05, 0.0),), "pick up green cube")
    assert plain.to_json() == (
        '{"camera":{"azimuth":0.0,"distance":0.0,"elevation":0.0,"pitch":0.0,"roll":0.0,"yaw":0.0},"confounders":[],'
        '"instruction":"pick up green cube","light":{"intensity":1.0},"robot":"panda","schema":1,"targets":'
        '[{"object":"green_cube","quaternion":null,"rest":"flat","scale":1.0,"x":-0.05,"y":0.0,"yaw":0.0}],"task":"pick-up"}'
    )
    assert len(plain.digest) == 32
    assert plain.digest == Scene.from_json(plain.to_json()).digest


@pytest.mark.parametrize(
    ("task", "first", "all_twenty"),
    [
        ("pick-up", "9590ffad21ac7f3edcc428c1f41e3e57", "a3a51155779bad8709ed297720d04e17"),
        ("put-in", "930e0ed434fd5eb139216ee5224d8aac", "d1686796e6ff76b6d601716914d9fa95"),
    ],
)
def test_generated_scenes_and_their_digests_stay_the_same(task: str, first: str, all_twenty: str):
    space = SearchSpace(load_operators(), load_catalogue(), task)
    digests = [space.sample(np.random.default_rng([3, number])).digest for number in range(20)]
    assert digests[0] == first
    assert hashlib.blake2b("".join(digests).encode(), digest_size=16).hexdigest() == all_twenty


def test_what_is_left_out_is_nominal():
    target = '{"object":"a","rest":"b","x":0,"y":0}'
    scene = Scene.from_json(f'{{"task": "pick-up", "instruction": "go", "targets": [{target}]}}')
    known = (scene.light, scene.camera, scene.confounders, scene.robot, scene.schema)
    assert known == (Light(), Camera(), (), "panda", SCHEMA)


@pytest.mark.parametrize(
    ("camera", "offset"),
    [
        (Camera(0.1), (0.1, 0, 0)),
        (Camera(0.1, azimuth=90), (0, 0.1, 0)),
        (Camera(0.1, azimuth=180), (-0.1, 0, 0)),
        (Camera(0.1, elevation=90), (0, 0, 0.1)),
        (Camera(0.1, azimuth=90, elevation=-30), (0, 0.0866025, -0.05)),
        (Camera(0.0, azimuth=12, elevation=34), (0, 0, 0)),
    ],
)
def test_a_cameras_offset_has_its_distance_and_direction(camera, offset):
    assert camera.offset == pytest.approx(offset, abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"task":', '"tsak":', "task: field required"),
        ('"intensity":', '"brightness":2.0,"intensity":', "light.brightness: "),
        ('"robot":', '"weather":"fine","robot":', "weather: "),
        ('"yaw":30.0', '"yaw":"north"', "targets.0.yaw: "),
        ('"yaw":30.0', '"yaw":NaN', "targets.0.yaw: input should be a finite number"),
        ('"x":-0.15', '"x":1e999', "confounders.0.x: "),
        ('"x":-0.15', '"x":null', "confounders.0.x: "),
        ('"quaternion":[1.0,0.0,0.0,0.0]', '"quaternion":[1.0,0.0,0.0]', "confounders.0.quaternion"),
        ('"task":"put-on"', '"task":7', "task: input should be a valid string, got 7"),
        ('"schema":1', '"schema":2', "schema: version 2 of this scene is newer than 1"),
        ('"schema":1', '"schema":"one"', "schema: "),
    ],
)
def test_what_is_no_scene_is_refused_with_its_key(old, new, says):
    assert old in TEXT
    with pytest.raises(SceneError) as caught:
        Scene.from_json(TEXT.replace(old, new, 1))
    assert caught.value.message.startswith(says)
    assert caught.value.hint


LONG = TEXT.replace('"task":"put-on"', '"task":' + json.dumps(["very long"] * 100))


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '"scene"', b"\xff\xfe", LONG])
def test_what_is_no_json_object_is_refused_in_a_short_message(text):
    with pytest.raises(SceneError) as caught:
        Scene.from_json(text)
    assert len(caught.value.message) < 140


def test_a_file_of_scenes_is_read_back(tmp_path: Path):
    path = tmp_path / "scenes.jsonl"
    write_scenes(path, [ONE, replace(ONE, light=Light(3.0))])
    assert load_scenes(path) == [ONE, replace(ONE, light=Light(3.0))]
    assert [path.name for path in tmp_path.iterdir()] == ["scenes.jsonl"]


def test_a_broken_line_is_named_and_blank_ones_are_passed_over(tmp_path: Path):
    path = tmp_path / "scenes.jsonl"
    path.write_text(f"{TEXT}\n\n{TEXT[:-9]}\n{TEXT}\n")
    with pytest.raises(SceneError) as caught:
        load_scenes(path)
    assert caught.value.message.startswith(f"{path}:3: ")
    read = dict(read_scenes(path))
    assert (read[1], read[4], list(read)) == (ONE, ONE, [1, 3, 4])
    assert isinstance(read[3], SceneError)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "no scenes in it"),
        (b"\n \n", "no scenes in it"),
        (b"\xff\xfe\x00", "not UTF-8 text"),
        (None, "cannot be read"),
    ],
)
def test_a_file_without_scenes_is_refused(tmp_path: Path, content: bytes | None, says: str):
    path = tmp_path / "scenes.jsonl"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SceneError, match=says):
        load_scenes(path)


def test_what_came_later_is_not_in_the_json_of_what_is_without():
    """Digests of scenes that are older stay as they are."""
    assert "listed" not in TEXT
    changed = replace(ONE, targets=(replace(ONE.targets[0], listed=1), *ONE.targets[1:]))
    assert '"listed":1' in changed.to_json()
    assert ONE.digest == "f885afad8c551c3bfdf5aefef426fac6"
