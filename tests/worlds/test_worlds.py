"""Worlds: which one a task is of, how users name them, and what they refuse."""

import pytest

from tests.cli.typed import typed
from vlafuzz.errors import UsageError
from vlafuzz.worlds import known_worlds, task_of, world_of


def test_a_tasks_name_says_which_world_it_is_of():
    assert world_of("pick-up") is known_worlds()["tabletop"]
    assert world_of("libero_object/0") is known_worlds()["libero"]
    assert [world.usual for world in known_worlds().values()] == [True, False, False]


@pytest.mark.parametrize(
    ("world", "task", "named"),
    [
        (None, None, None),
        (None, "put-on", "put-on"),
        ("tabletop", None, None),
        ("tabletop", "put-on", "put-on"),
        ("tabletop:put-on", None, "put-on"),
        ("libero:libero_object/0", None, "libero_object/0"),
        ("tabletop-mujoco", "put-on", "tabletop-mujoco/put-on"),
        ("tabletop-mujoco:tabletop-mujoco/put-on", None, "tabletop-mujoco/put-on"),
        ("libero:libero_object/0", "libero_object/0", "libero_object/0"),
    ],
)
def test_a_world_or_a_task_is_named(world: str | None, task: str | None, named: str | None):
    assert task_of(world, task) == named


@pytest.mark.parametrize(
    ("world", "task", "problem"),
    [
        ("moon", None, "unknown world 'moon'"),
        ("libero", None, "--world libero: names no task"),
        ("libero:object", None, "--world libero: no task 'object'"),
        ("libero:libero_object/0", "pick-up", "--world libero:libero_object/0, --task pick-up: two tasks"),
    ],
)
def test_what_names_no_task_is_refused(world: str, task: str | None, problem: str):
    with pytest.raises(UsageError, match=problem):
        task_of(world, task)


def test_an_operator_that_has_nothing_to_vary_on_the_tabletop_is_refused():
    with pytest.raises(UsageError, match="exposure: it follows the light, which does not vary"):
        world_of("pick-up").space("pick-up", "panda", vary=["exposure"])
    with pytest.raises(UsageError, match="initial-state: nothing of pick-up varies so"):
        world_of("pick-up").space("pick-up", "panda", vary=["initial-state"])


def test_the_first_robot_of_a_world_is_its_default_one():
    assert [next(iter(world.robots)) for world in known_worlds().values()] == ["panda", "libero", "panda"]


def test_without_the_packages_of_a_world_one_sentence_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr("vlafuzz.worlds.libero.packages._NEEDED", ("no_such_package",))
    said = typed(capsys, "run --world libero:libero_goal/9 --policy libero-expert --budget 1", code=3).err
    assert "not installed: no_such_package" in said
    assert "scripts/setup-libero" in said
