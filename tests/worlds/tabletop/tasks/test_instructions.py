import pytest

from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings, say


def test_the_nominal_wording_of_each_task_is_the_papers():
    first = {name: wordings[0] for name, wordings in load_wordings().items()}
    assert first == {
        "pick-up": "pick up {a}",
        "move-near": "move {a} near {b}",
        "put-on": "put {a} on {b}",
        "put-in": "put {a} into {b}",
    }


@pytest.mark.parametrize("task", TASKS)
def test_there_are_ten_different_wordings_a_task_that_name_all_targets(task):
    wordings = set(load_wordings()[task])
    assert len(wordings) >= 10
    assert all("{a}" in wording and ("{b}" in wording) is (TASKS[task].targets > 1) for wording in wordings)


def test_saying_fills_in_the_names():
    assert say("let the {b} carry the {a}", ["green cube", "plate"]) == "let the plate carry the green cube"
    assert say("pick up {a}", ["apple"]) == "pick up apple"
