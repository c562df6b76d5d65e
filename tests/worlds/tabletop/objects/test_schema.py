import re
from pathlib import Path

import pytest
import yaml

from vlafuzz.errors import CatalogueError
from vlafuzz.worlds.tabletop.objects import load_catalogue

APPLE = {
    "role": "graspable",
    "mass": 0.2,
    "colour": [0.6, 0.1, 0.1],
    "shape": {"kind": "ball", "diameter": 0.07, "height": 0.066},
    "look": {"pattern": "fruit"},
    "rests": {"resting": {"up": [0, 0, 1]}},
}


def write(folder: Path, text: str = "", **changes: object) -> Path:
    file = folder / "mine.yaml"
    file.write_text(text or yaml.safe_dump({"objects": {"apple": APPLE | changes}}))
    return file


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mas": 1}, "objects.apple.mas: extra inputs are not permitted"),
        ({"mass": -1}, "objects.apple.mass: input should be greater than 0, got -1"),
        ({"mass": float("nan")}, "objects.apple.mass: input should be a finite number, got nan"),
        ({"role": "grasable"}, "objects.apple.role: input should be 'graspable' or 'place'"),
        ({"rests": {}}, "objects.apple.rests: dictionary should have at least 1 item"),
        ({"shape": {"kind": "bal"}}, "objects.apple.shape: input tag 'bal' found using 'kind' does not match"),
        ({"shape": {"kind": "ball", "height": 1}}, "objects.apple.shape.ball.diameter: field required"),
    ],
)
def test_a_wrong_value_is_named_with_file_and_key(tmp_path, changes, message):
    file = write(tmp_path, **changes)
    with pytest.raises(CatalogueError, match=re.escape(f"{file}: {message}")) as caught:
        load_catalogue(file)
    assert "\n" not in caught.value.message


@pytest.mark.parametrize(
    ("text", "message"),
    [("objects: [", "not YAML"), ("objects:\n  Big Apple: {}\n", "Big Apple"), ("objekts: {}\n", "objects: ")],
)
def test_a_file_of_the_wrong_form_is_named(tmp_path, text, message):
    file = write(tmp_path, text)
    with pytest.raises(CatalogueError, match=re.escape(str(file))) as caught:
        load_catalogue(file)
    assert message in caught.value.message


def test_the_digest_changes_with_any_value_and_only_then(tmp_path):
    before = load_catalogue(write(tmp_path)).digest
    assert load_catalogue(write(tmp_path)).digest == before
    assert load_catalogue(write(tmp_path, mass=0.21)).digest != before
    assert load_catalogue(write(tmp_path, look={"pattern": "peel"})).digest != before
    assert load_catalogue(write(tmp_path, friction=0.7)).digest != before


def test_a_pose_that_is_not_stable_is_refused(tmp_path):
    egg = {"kind": "egg", "length": 0.08, "radius": 0.02, "tip": 0.012}
    file = write(tmp_path, shape=egg, rests={"upright": {"up": [1, 0, 0]}})
    with pytest.raises(CatalogueError, match=r"objects\.apple\.rests\.upright: no stable face near this pose"):
        load_catalogue(file)["apple"]


def test_an_object_that_does_not_fit_into_the_gripper_is_refused(tmp_path):
    file = write(tmp_path, shape={"kind": "ball", "diameter": 0.09, "height": 0.09})
    with pytest.raises(CatalogueError, match=r"objects\.apple\.rests\.resting: nothing that the gripper"):
        load_catalogue(file)["apple"]
