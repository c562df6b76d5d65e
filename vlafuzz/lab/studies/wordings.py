"""RQ6 and the prompts of the paper's discussion: the same scenes with other instructions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

import yaml

from vlafuzz.common.statistics import Share, sign_test
from vlafuzz.common.text import Row, points
from vlafuzz.errors import UsageError
from vlafuzz.lab.plots import coloured, save
from vlafuzz.lab.studies.runner import Tried, Variant
from vlafuzz.lab.studies.sheet import Series, StudyResult, Tested, bars, chance, share_panels
from vlafuzz.lab.studies.stages import Reached, reached
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.report.view import Table
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.tasks import load_wordings, say

Study = Literal["rq6", "prompts"]
PLAIN = "plain"
TWO_STEP, STEP_BY_STEP = "two-step", "step-by-step"


class Prompt(NamedTuple):
    """A wording of a task: the instruction, and those that replace it as stages are reached."""

    name: str
    says: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Reworded(Tested):
    """A policy's outcomes in the same scenes with another wording.

    Attributes:
        prompt: ``plain``, or the prompt's name.
        stages: of the scenes that were judged; the last one is success.
        plain: success with the plain wording in those scenes; ``lost`` of them fail with this wording only, ``gained``
            with the plain one only.
        p: of the sign test on lost and gained (McNemar's, exact); None for ``plain``.
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


@dataclass(frozen=True)
class Together:
    """Success of a policy in a task with the plain wording, and with all prompts of a study together."""

    task: str
    policy: str
    plain: Share
    prompts: Share


def prompts(study: Study, task: str) -> list[Prompt]:
    """Ten paraphrases in RQ6; else two prompts for a task of two steps.

    Raises:
        UsageError: the task has one step only.
    """
    paraphrases, two_step, step_by_step = (_file()[kind] for kind in ("paraphrases", TWO_STEP, STEP_BY_STEP))
    if study == "rq6":
        wordings = [*load_wordings()[task][1:], paraphrases[task]]
        return [Prompt(f"paraphrase {number}", (text,)) for number, text in enumerate(wordings, start=1)]
    if task not in two_step:
        raise UsageError(f"prompts: {task} has one step only", hint="tasks of two steps: " + ", ".join(two_step))
    return [Prompt(TWO_STEP, (two_step[task],)), Prompt(STEP_BY_STEP, tuple(step_by_step[task]))]


def two_steps() -> list[str]:
    """The tasks that have two steps."""
    return list(_file()[TWO_STEP])


def reworded(scene: Scene, prompt: Prompt, catalogue: Catalogue) -> Scene:
    """The scene with the instructions of a prompt."""
    spoken = [catalogue[target.object].spoken for target in scene.targets]
    first, *then = (say(text, spoken) for text in prompt.says)
    return replace(scene, instruction=first, then=tuple(then))


def variants(scenes: Sequence[Scene], prompts: Sequence[Prompt], catalogue: Catalogue) -> list[Variant]:
    """Every scene with every prompt."""
    return [
        Variant(reworded(scene, prompt, catalogue), origin, prompt.name)
        for origin, scene in enumerate(scenes)
        for prompt in prompts
    ]


def compared(
    task: str, policy: str, plain: Sequence[Outcome], tried: Sequence[Tried], prompts: Sequence[Prompt]
) -> list[Reworded]:
    """The plain wording, then each prompt compared with it in the scenes in which the prompt was judged.

    The variants were made from the scenes of the ``plain`` outcomes, all of which were judged.
    """
    rows = []
    for prompt in [Prompt(PLAIN, (load_wordings()[task][0],)), *prompts]:
        results = [result for result in tried if result.variant.arm == prompt.name]
        outcomes = {result.variant.origin: result.outcome for result in results if result.judged}
        if prompt.name == PLAIN:
            outcomes = dict(enumerate(plain))
        pairs = [
            (plain[origin].verdict is Verdict.PASSED, now.verdict is Verdict.PASSED) for origin, now in outcomes.items()
        ]
        lost, gained = pairs.count((True, False)), pairs.count((False, True))
        row = Reworded(
            task=task,
            policy=policy,
            prompt=prompt.name,
            says=prompt.says,
            stages=reached(task, list(outcomes.values())),
            plain=Share.of_counts(sum(was for was, _ in pairs), len(pairs)),
            lost=lost,
            gained=gained,
            errors=sum(result.outcome.verdict is Verdict.ERROR for result in results),
            p=None if prompt.name == PLAIN else sign_test(lost, gained),
        )
        rows.append(row)
    return rows


def together(task: str, policy: str, plain: Sequence[Outcome], tried: Sequence[Tried]) -> Together:
    """All prompts taken as one; see ``compared`` for the arguments."""
    cases = [(result.variant.origin, result.passed) for result in tried if result.judged]
    passed = [outcome.verdict is Verdict.PASSED for outcome in plain]
    return Together(task, policy, Share.of_counts(sum(passed), len(passed)), Share.grouped(cases))


@cache
def _file() -> dict[str, dict[str, Any]]:
    """By kind of prompt, the wordings by task."""
    text = (Path(__file__).parent / "prompts.yaml").read_text(encoding="utf-8")
    return cast(dict[str, dict[str, Any]], yaml.safe_load(text))


_NOTE = (
    "Every prompt is given in the scenes in which the plain wording was judged; shares are of the "
    "scenes that were judged with it, with Wilson's 95 % interval. Net: success minus that of the "
    "plain wording in the same scenes, in points; lost: passed with the plain wording only, gained: "
    "with this one only. p: sign test on these (McNemar's, exact), in parentheses corrected for the "
    "number of tests by Holm's method."
)
_DIFFERS = {
    "rq6": "it gives each scene one of ten wordings, drawn without a seed, and one of its ten for pick-up is "
    "the plain wording; here every scene is given all ten, in our words, none of them the plain one.",
    "prompts": "it tries only the two-step prompt, which is not in its code; in step-by-step, the second "
    "instruction replaces the first one once the grasp is reached, which the simulator knows and a real "
    "robot would not.",
}


@dataclass(frozen=True)
class WordingResult(StudyResult):
    """The result of RQ6 or of the prompts."""

    together: list[Together]
    prompts: list[Reworded]

    def sheet(self) -> tuple[list[Table], list[str]]:
        """All prompts together, then one table per task."""
        tables = [
            Table("Success, all prompts together", [_row_together(row) for row in self.together]),
            *(Table(task, [_row(row) for row in self.prompts if row.task == task]) for task in self._tasks()),
        ]
        return tables, self.noted(_DIFFERS[self.study], _NOTE)

    def draw(self, path: Path) -> None:
        """Success with each prompt, a panel per task."""
        many = self.study == "rq6"
        columns, width = (2, 6.0) if many else (4, 3.2)
        figure, every = share_panels(self.title, self._tasks(), "success", columns=columns, width=width)
        colours = coloured(self.policies)
        for axes, task in zip(every, self._tasks(), strict=True):
            rows = {(row.prompt, row.policy): row for row in self.prompts if row.task == task}
            prompts = list(dict.fromkeys(prompt for prompt, _ in rows))
            series = [
                Series(policy, [rows[name, policy].stages[-1] for name in prompts], colours[policy])
                for policy in dict.fromkeys(policy for _, policy in rows)
            ]
            bars(axes, [name.removeprefix("paraphrase ") for name in prompts], series)
            axes.set_xlabel("paraphrase" if many else "")
        save(figure, path)

    def _tasks(self) -> list[str]:
        return list(dict.fromkeys(row.task for row in self.prompts))


def _row_together(row: Together) -> Row:
    both = row.plain.of and row.prompts.of
    return {
        "task": row.task,
        "policy": row.policy,
        "plain": str(row.plain),
        "prompts": str(row.prompts),
        "net": points(row.prompts.share - row.plain.share) if both else None,
    }


def _row(row: Reworded) -> Row:
    *_, success = row.stages
    tested = row.p is not None
    return {
        "policy": row.policy,
        "prompt": " / ".join(row.says),
        **{stage.stage: str(stage) for stage in row.stages},
        "net": points(success.share - row.plain.share) if tested and success.of else None,
        "lost": row.lost if tested else None,
        "gained": row.gained if tested else None,
        "p (Holm)": chance(row.p, row.adjusted),
        "errors": row.errors,
    }
