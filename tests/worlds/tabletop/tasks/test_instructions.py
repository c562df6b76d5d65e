from pathlib import Path

import pytest

from vlafuzz.errors import CatalogueError
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings, say

GOOD = "pick-up: ['take {a}']\nmove-near: ['{a} to {b}']\nput-on: ['{a} on {b}']\nput-in: ['{a} in {b}']\n"


def test_the_nominal_wording_of_each_task_is_the_papers():
    first = {name: wordings[0] for name, wordings in load_wordings().items()}
    assert first == {
        "pick-up": "pick up {a}",
        "move-near": "move {a} near {b}",
        "put-on": "put {a} on {b}",
        "put-in": "put {a} into {b}",
    }


@pytest.mark.parametrize("task", TASKS)
def test_there_are_ten_different_wordings_a_task(task):
    assert len(set(load_wordings()[task])) >= 10


def test_saying_fills_in_the_names():
    assert say("let the {b} carry the {a}", ["green cube", "plate"]) == "let the plate carry the green cube"
    assert say("pick up {a}", ["apple"]) == "pick up apple"


def test_ones_own_wordings_are_read(tmp_path: Path):
    path = tmp_path / "own.yaml"
    path.write_text(GOOD)
    assert load_wordings(path)["pick-up"] == ("take {a}",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (GOOD.replace("'{a} on {b}'", "'put {a} down'"), "put-on: 'put {a} down' does not say {b}"),
        (GOOD.replace("'take {a}'", "'take it'"), "pick-up: 'take it' does not say {a}"),
        (GOOD.replace("put-in:", "put-inn:"), "put-in: '' does not say {a}"),
        (GOOD.replace("['take {a}']", "[]"), "pick-up: '' does not say {a}"),
        (GOOD.replace("['take {a}']", "take {a}"), "pick-up: input should be a valid list"),
        ("- a\n- b\n", "input should be a valid dictionary"),
    ],
)
def test_a_broken_file_is_refused_with_its_name_and_the_reason(tmp_path: Path, text: str, says: str):
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    with pytest.raises(CatalogueError) as caught:
        load_wordings(path)
    assert caught.value.message.startswith(f"{path}: ")
    assert says in caught.value.message
    assert caught.value.hint
