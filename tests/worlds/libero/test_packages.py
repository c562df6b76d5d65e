import pytest

from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.worlds.libero import packages
from vlafuzz.worlds.libero.suites import find_task, find_tasks, initial_states


def test_without_the_extra_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setattr(packages, "_NEEDED", ("no_such_package",))
    with pytest.raises(PrerequisiteError, match="not installed: no_such_package") as raised:
        packages.require()
    assert "scripts/setup-libero" in str(raised.value.hint)


@pytest.mark.libero
def test_a_suite_has_its_tasks_with_instruction_goal_and_initial_states():
    task = find_tasks("libero_object")[0]
    assert str(task) == "libero_object/0"
    assert task.instruction == "pick up the alphabet soup and place it in the basket"
    assert task.goal == (("in", "alphabet_soup_1", "basket_1_contain_region"),)
    assert task.horizon == 280
    assert len(initial_states(task)) == 50


@pytest.mark.libero
@pytest.mark.parametrize(
    ("name", "hint"),
    [("libero_objects/0", "libero_object"), ("libero_object/10", "libero_object/9"), ("libero_object", "/9")],
)
def test_an_unknown_task_is_named_with_a_hint(name, hint):
    with pytest.raises(UsageError) as raised:
        find_task(name)
    assert hint in str(raised.value.hint)
