"""Words and goals of tasks that nobody should be tested in."""

import pytest

from tests.cli.typed import told, typed
from vlafuzz.doctor.suites import of_words
from vlafuzz.worlds.base import Prompt

WORDS, THINGS = "pick up the alphabet soup", ("alphabet soup", "basket")
SOUP = Prompt(task="s/0", words=WORDS, things=THINGS, wanted=("alphabet soup",), goal="soup")


def prompt(words: str, **changed) -> Prompt:
    return Prompt(**{**vars(SOUP), "task": "s/1", "words": words, **changed})


@pytest.mark.parametrize(
    ("other", "check", "says"),
    [
        (prompt("pick up the alphabet soup level2"), "words", "'level2' in"),
        (prompt("pick up the alphabet soup table 7"), "words", "'7' in"),
        (prompt("pick up alphabet_soup_1 soup"), "words", "'alphabet_soup_1' in"),
        (prompt(" "), "words", "its instruction is empty"),
        (prompt("pick up the alphabet soup", things=("butter", "soup"), wanted=()), "scene", "names the alphabet soup"),
        (prompt("pick up the milk"), "goal", "does not name the alphabet soup, which its goal is"),
        (prompt("Pick up the  alphabet soup", goal="basket"), "duplicate", "s/0's in the same scene"),
    ],
)
def test_words_that_mislead_are_a_sentence(other: Prompt, check: str, says: str):
    different = Prompt(task="s/2", words="open the drawer", goal="open")
    (problem,) = of_words([SOUP, other, different])
    assert (problem.task, problem.check) == ("s/1", check)
    assert says in problem.found


def test_tasks_with_words_of_their_own_and_one_goal_for_all_are_said_at_once():
    found = [one.found for one in of_words([SOUP, prompt("take the soup")])]
    assert found == ["all 2 tasks have the same goal, in other words"]


def test_lint_tries_whether_a_task_is_solved_by_doing_nothing(capsys):
    (row,) = told(capsys, ["lint", "--json", "python:tests.worlds.carts:Solved"], code=1)
    assert (row["check"], row["found"]) == ("still", "solved by doing nothing, after 1 control step")
    assert "0 tasks of 1 with a problem" in typed(capsys, ["lint", "python:tests.worlds.carts:Carts"]).err
