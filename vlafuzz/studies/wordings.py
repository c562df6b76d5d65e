"""RQ6 and the paper's discussion: the same scenes with other instructions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple

import yaml
from pydantic import BaseModel, ConfigDict

from vlafuzz.errors import UsageError
from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.scene import Scene
from vlafuzz.statistics import Share, holm
from vlafuzz.studies.stages import Reached, reached
from vlafuzz.studies.variants import Tried, Variant
from vlafuzz.tasks.instructions import load_wordings, say

Study = Literal["rq6", "prompts"]
PLAIN = "plain"
TWO_STEP, STEP_BY_STEP = "two-step", "step-by-step"


class Prompt(NamedTuple):
    """A way to say a task: the instruction, and those that take its place as stages are reached."""

    name: str
    says: tuple[str, ...]


@dataclass(frozen=True)
class Reworded:
    """What a policy does in the same scenes when they are said in another way.

    Attributes:
        prompt: ``plain``, or the prompt's name.
        stages: of the scenes that were judged; the last one is success.
        plain: success with the plain wording in those scenes; ``lost`` of them fail with this one, and
            ``gained`` fail with the plain one only.
        p: of the sign test on lost and gained (McNemar's, exact), ``adjusted`` for the number of tests by
            Holm's method; None for ``plain``.
    """

    task: str
    policy: str
    prompt: str
    says: tuple[str, ...]
    stages: tuple[Reached, ...]
    plain: Share
    lost: int
    gained: int
    errors: int
    p: float | None
    adjusted: float | None = None


@dataclass(frozen=True)
class Together:
    """Success of a policy in a task with all prompts of a study taken together, beside the plain wording."""

    task: str
    policy: str
    plain: Share
    prompts: Share


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    paraphrases: dict[str, str]
    two_step: dict[str, str]
    step_by_step: dict[str, list[str]]


def prompts(study: Study, task: str) -> list[Prompt]:
    """Ten paraphrases in RQ6; else two ways to tell a task of two steps.

    Raises:
        UsageError: the task has one step only.
    """
    file = _file()
    if study == "rq6":
        ways = [*load_wordings()[task][1:], file.paraphrases[task]]
        return [Prompt(f"paraphrase {number}", (way,)) for number, way in enumerate(ways, start=1)]
    if task not in file.two_step:
        raise UsageError(f"prompts: {task} has one step only", hint="for: " + ", ".join(file.two_step))
    two, steps = file.two_step[task], file.step_by_step[task]
    return [Prompt(TWO_STEP, (two,)), Prompt(STEP_BY_STEP, tuple(steps))]


def two_steps() -> list[str]:
    """The tasks that have two steps."""
    return list(_file().two_step)


def reworded(scene: Scene, prompt: Prompt, catalogue: Catalogue) -> Scene:
    """The scene, said so."""
    spoken = [catalogue[target.object].spoken for target in scene.targets]
    first, *then = (say(way, spoken) for way in prompt.says)
    return replace(scene, instruction=first, then=tuple(then))


def variants(scenes: Sequence[Scene], ways: Sequence[Prompt], catalogue: Catalogue) -> list[Variant]:
    """Every scene with every prompt."""
    return [
        Variant(reworded(scene, way, catalogue), origin, way.name)
        for origin, scene in enumerate(scenes)
        for way in ways
    ]


def compared(
    task: str, policy: str, plain: Sequence[Outcome], found: Sequence[Tried], ways: Sequence[Prompt]
) -> list[Reworded]:
    """The plain wording, then each prompt beside it in those scenes in which it was judged.

    Args:
        plain: outcomes of the scenes from which the variants were made, all of them judged.
    """
    own = Prompt(PLAIN, (load_wordings()[task][0],))
    every = {PLAIN: dict(enumerate(plain))} | {way.name: {} for way in ways}
    errors = dict.fromkeys(every, 0)
    for each in found:
        if each.judged:
            every[each.variant.arm][each.variant.origin] = each.outcome
        errors[each.variant.arm] += each.outcome.verdict is Verdict.ERROR
    return [_reworded(task, policy, way, plain, every[way.name], errors[way.name]) for way in (own, *ways)]


def together(task: str, policy: str, plain: Sequence[Outcome], found: Sequence[Tried]) -> Together:
    """See ``compared``."""
    cases = [(each.variant.origin, each.passed) for each in found if each.judged]
    passed = [outcome.verdict is Verdict.PASSED for outcome in plain]
    return Together(task, policy, Share.of_counts(sum(passed), len(passed)), Share.grouped(cases))


def adjusted(found: Sequence[Reworded]) -> list[Reworded]:
    """With p-values for as many tests as there are."""
    values = iter(holm([each.p for each in found if each.p is not None]))
    return [each if each.p is None else replace(each, adjusted=next(values)) for each in found]


def _reworded(
    task: str,
    policy: str,
    way: Prompt,
    plain: Sequence[Outcome],
    outcomes: Mapping[int, Outcome],
    errors: int,
) -> Reworded:
    before = [plain[origin].verdict is Verdict.PASSED for origin in outcomes]
    after = [outcome.verdict is Verdict.PASSED for outcome in outcomes.values()]
    lost = sum(was and not now for was, now in zip(before, after, strict=True))
    gained = sum(now and not was for was, now in zip(before, after, strict=True))
    return Reworded(
        task=task,
        policy=policy,
        prompt=way.name,
        says=way.says,
        stages=reached(task, list(outcomes.values())),
        plain=Share.of_counts(sum(before), len(before)),
        lost=lost,
        gained=gained,
        errors=errors,
        p=None if way.name == PLAIN else _sign_test(lost, gained),
    )


def _sign_test(lost: int, gained: int) -> float:
    from scipy.stats import binomtest

    return float(binomtest(lost, lost + gained).pvalue) if lost + gained else 1.0


@cache
def _file() -> _File:
    text = (Path(__file__).parent / "prompts.yaml").read_text(encoding="utf-8")
    return _File.model_validate({key.replace("-", "_"): value for key, value in yaml.safe_load(text).items()})
