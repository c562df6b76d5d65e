"""The tables and the plot of RQ6 and of the prompts of the paper's discussion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vlafuzz.studies import plots
from vlafuzz.studies.sheet import Sheet, StudyResult, Table, chance
from vlafuzz.studies.wordings import Reworded, Together
from vlafuzz.text import Row, points

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

    def sheet(self) -> Sheet:
        """All prompts together, then one table per task."""
        tables = [
            Table("Success, all prompts together", [_row_together(row) for row in self.together]),
            *(Table(task, [_row(row) for row in self.prompts if row.task == task]) for task in self._tasks()),
        ]
        return Sheet(self.title, tables, [_NOTE, *self.gaps], _DIFFERS[self.study], self._plot)

    def _plot(self, path: Path) -> None:
        """Success with each prompt, a panel per task."""
        many = self.study == "rq6"
        columns, width = (2, 6.0) if many else (4, 3.2)
        figure, every = plots.panels(self.title, self._tasks(), "success", columns=columns, width=width)
        colours = plots.coloured(self.policies)
        for axes, task in zip(every, self._tasks(), strict=True):
            rows = {(row.prompt, row.policy): row for row in self.prompts if row.task == task}
            prompts = list(dict.fromkeys(prompt for prompt, _ in rows))
            series = [
                plots.Series(policy, [rows[name, policy].stages[-1] for name in prompts], colours[policy])
                for policy in dict.fromkeys(policy for _, policy in rows)
            ]
            plots.bars(axes, [name.removeprefix("paraphrase ") for name in prompts], series)
            axes.set_xlabel("paraphrase" if many else "")
        plots.save(figure, path)

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
