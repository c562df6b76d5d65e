"""The prompts that there are, and what a scene says with them."""

import pytest

from tests.doubles import failed, passed, scene
from vlafuzz.errors import UsageError
from vlafuzz.lab.studies.runner import Tried
from vlafuzz.lab.studies.sheet import adjusted
from vlafuzz.lab.studies.wordings import Prompt, compared, prompts, reworded, two_steps, variants
from vlafuzz.model.outcome import Outcome
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings

CATALOGUE = load_catalogue()


@pytest.mark.parametrize("task", TASKS)
def test_a_task_has_ten_paraphrases_none_of_them_the_plain_wording(task: str) -> None:
    ways = {way.says for way in prompts("rq6", task)}
    assert len(ways) == 10
    assert (load_wordings()[task][0],) not in ways
    for (way,) in ways:
        assert all(slot in way for slot in ("{a}", "{b}")[: TASKS[task].targets])


def test_tasks_of_two_steps_have_two_prompts_and_the_others_none() -> None:
    assert two_steps() == ["move-near", "put-on", "put-in"]
    assert prompts("prompts", "put-in") == [
        Prompt("two-step", ("pick up {a} and then put {a} into {b}",)),
        Prompt("step-by-step", ("pick up {a}", "put {a} into {b}")),
    ]
    with pytest.raises(UsageError, match="pick-up has one step only"):
        prompts("prompts", "pick-up")


def test_a_prompt_says_the_targets_names_and_changes_nothing_else() -> None:
    said = reworded(scene(light=2.0), Prompt("slow", ("find {a}", "take {a}")), CATALOGUE)
    assert (said.instruction, said.then) == ("find green cube", ("take green cube",))
    assert (said.targets, said.light) == (scene(light=2.0).targets, scene(light=2.0).light)


def test_prompts_are_compared_in_the_scenes_in_which_both_were_judged() -> None:
    ways = [Prompt("one", ("lift {a}",)), Prompt("two", ("raise {a}",))]
    scenes = [scene(x=0.001 * number) for number in range(4)]
    outcomes = [failed(), passed(), Outcome.error("broke"), passed(), failed(), passed(), passed(), passed()]
    results = [Tried(*pair) for pair in zip(variants(scenes, ways, CATALOGUE), outcomes, strict=True)]
    plain, one, two = compared("pick-up", "idle", [passed(), passed(), passed(), failed()], results, ways)
    assert (plain.prompt, plain.stages[-1].count, plain.p) == ("plain", 3, None)
    assert (one.lost, one.gained, one.errors, one.plain.count, one.plain.of) == (2, 1, 1, 2, 3)
    assert (two.lost, two.gained, two.stages[-1].share) == (0, 1, 1.0)
    assert [row.adjusted for row in adjusted([plain, one, two])] == [None, 1.0, 1.0]
