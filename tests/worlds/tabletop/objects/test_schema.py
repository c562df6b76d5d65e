import re
from pathlib import Path

import pytest
import yaml

from vlafuzz.common import assets
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
    ("changes", "message", "hint"),
    [
        ({"mas": 1}, "objects.apple.mas: unknown key", "did you mean 'mass'?"),
        ({"mass": -1}, "objects.apple.mass: input should be greater than 0, got -1", None),
        ({"mass": float("nan")}, "objects.apple.mass: input should be a finite number, got nan", None),
        ({"role": "grasable"}, "objects.apple.role: unknown value 'grasable'", "did you mean 'graspable'?"),
        (
            {"colour": [0, 0, 2]},
            "objects.apple.colour.2: input should be less than or equal to 1, got 2",
            None,
        ),
        ({"rests": {}}, "objects.apple.rests: dictionary should have at least 1 item", None),
        ({"rests": {"r": {"up": [0, 0, 0]}}}, "objects.apple.rests.r.up: must not be zero", None),
        (
            {"rests": {"r": {"up": [0, 0, 1], "roll": True}}},
            "objects.apple.rests.r.roll: unknown key",
            "'rolls'",
        ),
        ({"look": {"pattern": "checks"}}, "objects.apple.look: a ball can be painted plain, label", None),
        ({"look": {"pattern": "plain", "words": "x"}}, "objects.apple.look.words: unknown key", "'word'"),
        ({"shape": {"kind": "bal"}}, "objects.apple.shape: unknown value 'bal'", "did you mean 'ball'?"),
        ({"shape": {"kind": "ball", "height": 1}}, "objects.apple.shape.diameter: missing", None),
        (
            {"shape": APPLE["shape"] | {"hight": 1}},
            "objects.apple.shape.hight: unknown key",
            "did you mean 'height'?",
        ),
        (
            {"shape": {"kind": "egg", "length": 0.05, "radius": 0.03, "tip": 0.01}},
            "objects.apple.shape: these lengths do not fit together, got {'length': 0.05",
            None,
        ),
    ],
)
def test_a_wrong_value_is_named_with_file_and_key(tmp_path, changes, message, hint):
    file = write(tmp_path, **changes)
    with pytest.raises(CatalogueError, match=re.escape(f"{file}: {message}")) as caught:
        load_catalogue(file)
    assert (hint or "") in (caught.value.hint or "")
    assert "\n" not in caught.value.message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("objects: [", "not YAML"),
        ("just words", "input should be"),
        ("objects:\n  Big Apple: {}\n", "Big Apple"),
        ("objekts: {}\n", "objects: missing"),
    ],
)
def test_a_file_of_the_wrong_form_is_named(tmp_path, text, message):
    file = write(tmp_path, text)
    with pytest.raises(CatalogueError, match=re.escape(str(file))) as caught:
        load_catalogue(file)
    assert message in caught.value.message


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CatalogueError, match=r"nowhere\.yaml: cannot be read: no such file"):
        load_catalogue(tmp_path / "nowhere.yaml")


def test_files_merge_unless_they_share_a_name(tmp_path):
    builtin = assets.operators_dir() / "objects" / "builtin.yaml"
    mine = tmp_path / "mine.yaml"
    mine.write_text(yaml.safe_dump({"objects": {"pear": APPLE}}))
    assert load_catalogue(builtin, mine).names() == (*load_catalogue().names(), "pear")
    with pytest.raises(CatalogueError, match=re.escape(f"objects.apple: already in {builtin}")):
        load_catalogue(builtin, write(tmp_path))


def test_the_digest_changes_with_any_value_and_only_then(tmp_path):
    before = load_catalogue(write(tmp_path)).digest
    assert load_catalogue(write(tmp_path)).digest == before
    assert load_catalogue(write(tmp_path, mass=0.21)).digest != before
    assert load_catalogue(write(tmp_path, look={"pattern": "peel"})).digest != before
    assert load_catalogue(write(tmp_path, friction=0.7)).digest != before


def test_a_pose_that_is_not_stable_is_refused(tmp_path):
    egg = {"kind": "egg", "length": 0.08, "radius": 0.02, "tip": 0.012}
    file = write(tmp_path, shape=egg, rests={"upright": {"up": [1, 0, 0]}})
    with pytest.raises(
        CatalogueError, match=r"objects\.apple\.rests\.upright: no stable face near this pose"
    ):
        load_catalogue(file)["apple"]


def test_an_object_that_does_not_fit_into_the_gripper_is_refused(tmp_path):
    file = write(tmp_path, shape={"kind": "ball", "diameter": 0.09, "height": 0.09})
    with pytest.raises(CatalogueError, match=r"objects\.apple\.rests\.resting: nothing that the gripper"):
        load_catalogue(file)["apple"]
