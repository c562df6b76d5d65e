"""Whether the tasks of a suite can be believed: their words beside their scenes, and what a still policy solves."""

import re
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.common.plugins import OBJECT
from vlafuzz.common.text import plural
from vlafuzz.errors import VlafuzzError
from vlafuzz.model import Verdict
from vlafuzz.policies.base import ActionSpec, PolicySpec
from vlafuzz.policies.controls import Player
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds import world_of
from vlafuzz.worlds.base import Prompt

# A name of a file or of a thing, a letter with digits behind it, a number at the end: no person says these.
IDENTIFIER = re.compile(r"\S*_\S*|\b[a-z]+\d+\b|\b\d+$|\b\d+(?=\W*$)", re.IGNORECASE)
COMMON = ("the", "and", "pick", "put", "place")  # words that may be part of a thing's name by chance


class Problem(NamedTuple):
    """A sentence says what is wrong; ``check`` is ``words``, ``scene``, ``duplicate``, ``goal`` or ``still``."""

    task: str
    check: str
    found: str


def of_words(prompts: Sequence[Prompt]) -> Iterator[Problem]:
    """Return what is wrong with the words of tasks, compared with their scenes and with one another."""
    known = {thing for prompt in prompts for thing in prompt.things}
    first = dict[tuple[str, tuple[str, ...]], Prompt]()
    for prompt in prompts:
        words, says = " ".join(prompt.words.lower().split()), repr(prompt.words)
        if not words:
            yield Problem(prompt.task, "words", "its instruction is empty")
            continue
        if found := IDENTIFIER.search(words):
            yield Problem(prompt.task, "words", f"{found[0]!r} in {says} is an identifier")
        for thing in sorted(known):
            if re.search(rf"\b{re.escape(thing)}\b", words) and thing not in " / ".join(prompt.things):
                yield Problem(prompt.task, "scene", f"{says} names the {thing}, which is not in the scene")
        said = [word for word in re.findall(r"\w{3,}", words) if word not in COMMON]
        if unsaid := [thing for thing in prompt.wanted if not any(word in thing for word in said)]:
            yield Problem(prompt.task, "goal", f"{says} does not name the {unsaid[0]}, which its goal is about")
        before = first.setdefault((words, prompt.things), prompt)
        if before.goal != prompt.goal:
            yield Problem(prompt.task, "duplicate", f"{says} is {before.task}'s in the same scene, with another goal")
    if len({prompt.goal for prompt in prompts}) == 1 < len(first):
        yield Problem(prompts[0].task, "goal", f"all {len(prompts)} tasks have the same goal, in other words")


def when_still(task: str) -> Iterator[Problem]:
    """Whether the nominal scene of a task is solved by doing nothing, in one rollout."""
    world = world_of(task)
    policy = Player(PolicySpec("still", action=ActionSpec(width=world.action_width)))  # of no actions
    try:
        planned = plan(RunConfig(task=task, policy=f"{OBJECT}still", store=Path("unused.db")), policy=policy)
        with closing(make_evaluator(planned.manifest, policy, checked=False)) as evaluator:
            (outcome,) = evaluator.evaluate([world.space(task, planned.manifest.robot).nominal()])
    except VlafuzzError as error:
        yield Problem(task, "still", f"it cannot be tried: {error.message}")
        return
    if outcome.verdict is Verdict.PASSED:
        steps = int(np.argmax(outcome.rollouts[0].trace >= 1.0)) + 1
        yield Problem(task, "still", f"solved by doing nothing, after {plural(steps, 'control step')}")
    elif outcome.verdict is not Verdict.FAILED:
        yield Problem(task, "still", f"it cannot be tried: {outcome.detail}")
