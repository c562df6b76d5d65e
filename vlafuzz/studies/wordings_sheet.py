"""RQ6 and the prompts of the paper's discussion on paper."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vlafuzz.studies import plots
from vlafuzz.studies.sheet import Sheet, StudyResult, Table, chance
from vlafuzz.studies.wordings import Reworded, Together
from vlafuzz.text import Row, points

_NOTE = (
    "Every prompt is said in the scenes in which the plain wording was judged; shares are of the "
    "scenes that were judged with it, with Wilson's 95 % interval. Net: success less that of the "
    "plain wording in the same scenes, in points; lost: passed with the plain wording only, gained: "
    "with this one only. p: sign test on these (McNemar's, exact), in parentheses by Holm's method "
    "for as many tests."
)
_DIFFERS = {
    "rq6": "it says each scene in one of ten ways, drawn without a seed, and one of its ten for pick-up is "
    "the plain wording; here every scene is said in all ten, in our words, none of them the plain "
    "one.",
    "prompts": "it tries the two-step prompt alone, and its code has none; the second instruction of step-by-"
    "step takes the first one's place once the grasp is reached, which the simulator says and no "
    "robot would.",
}


@dataclass(frozen=True)
class WordingResult(StudyResult):
    """What RQ6 or the prompts found."""

    together: list[Together]
    prompts: list[Reworded]

    def sheet(self) -> Sheet:
        """All prompts together, then a table a task."""
        tables = [Table("Success, all prompts together", [_row_together(each) for each in self.together])] + [
            Table(task, [_row(each) for each in self.prompts if each.task == task]) for task in self._tasks()
        ]
        return Sheet(self.title, tables, [_NOTE, *self.gaps], _DIFFERS[self.study], self._plot)

    def _plot(self, path: Path) -> None:
        """Success with each prompt, a panel a task."""
        many = self.study == "rq6"
        figure, every = plots.panels(
            self.title,
            self._tasks(),
            "success",
            columns=2 if many else 4,
            width=6 if many else 3.2,
        )
        colours = plots.coloured(self.policies)
        for axes, task in zip(every, self._tasks(), strict=True):
            its = {(each.prompt, each.policy): each for each in self.prompts if each.task == task}
            names = list(dict.fromkeys(prompt for prompt, _ in its))
            series = [
                plots.Series(policy, [its[name, policy].stages[-1] for name in names], colours[policy])
                for policy in dict.fromkeys(policy for _, policy in its)
            ]
            plots.bars(axes, [name.removeprefix("paraphrase ") for name in names], series)
            axes.set_xlabel("paraphrase" if many else "")
        plots.save(figure, path)

    def _tasks(self) -> list[str]:
        return list(dict.fromkeys(each.task for each in self.prompts))


def _row_together(each: Together) -> Row:
    both = each.plain.of and each.prompts.of
    return {
        "task": each.task,
        "policy": each.policy,
        "plain": str(each.plain),
        "prompts": str(each.prompts),
        "net": points(each.prompts.share - each.plain.share) if both else None,
    }


def _row(each: Reworded) -> Row:
    *_, success = each.stages
    tested = each.p is not None
    return {
        "policy": each.policy,
        "prompt": " / ".join(each.says),
        **{stage.stage: str(stage) for stage in each.stages},
        "net": points(success.share - each.plain.share) if tested and success.of else None,
        "lost": each.lost if tested else None,
        "gained": each.gained if tested else None,
        "p (Holm)": chance(each.p, each.adjusted),
        "errors": each.errors,
    }
