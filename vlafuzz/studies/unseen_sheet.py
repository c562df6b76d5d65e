"""RQ5 on paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vlafuzz.studies import plots
from vlafuzz.studies.sheet import Sheet, StudyResult, Table, chance
from vlafuzz.studies.unseen import ENOUGH, Difference, PairedTest
from vlafuzz.text import Row, percent, points

_NOTE = (
    "Success in scenes with seen and with unseen objects, of the scenes that were judged, with "
    "Wilson's 95 % interval. Diff. %: (unseen - seen) / seen. In points: unseen - seen, with a 95 % "
    "percentile bootstrap over the scenes. Tr_n: of the scenes that reach stage n - 1, of all for n = "
    "1, the share that reaches stage n."
)
_TESTED = (
    "The t-test is paired, over policies, which it takes for a sample of many; d is Cohen's, of paired "
    "samples."
)
_FEW = (
    f"With less than {ENOUGH} policies there is no test over policies: the bootstrap over scenes says "
    "how sure a difference is of these policies, nothing of others."
)
_DIFFERS = (
    "its unseen objects are YCB's, at half size in the put tasks, and 1000 scenes a task; here an "
    "object has one size in all tasks, and what the hand cannot take is no target. Which objects a "
    "policy has seen in training, only who trained it knows."
)


@dataclass(frozen=True)
class UnseenResult(StudyResult):
    """What RQ5 found; ``packs`` are those of the unseen objects."""

    packs: list[str]
    differences: list[Difference]
    tests: list[PairedTest]

    def sheet(self) -> Sheet:
        """Success, transfer rates and, over enough policies, the test."""
        tables = [
            Table(f"Success; unseen: {', '.join(self.packs)}", [_row(each) for each in self.differences]),
            *_transfer_tables(self.differences),
            *([Table("Over policies", [_test_row(each) for each in self.tests])] if self.tests else []),
        ]
        notes = [_NOTE, _TESTED if self.tests else _FEW, *self.gaps]
        return Sheet(self.title, tables, notes, _DIFFERS, self._plot)

    def _plot(self, path: Path) -> None:
        """Stages with seen objects, pale, beside the same with unseen ones; a panel a task."""
        tasks = list(dict.fromkeys(each.task for each in self.differences))
        figure, every = plots.panels(self.title, tasks, "share of scenes")
        colours = plots.coloured(self.policies)
        for axes, task in zip(every, tasks, strict=True):
            its = [each for each in self.differences if each.task == task]
            series = [
                plots.Series(f"{each.policy}, {name}", of.stages, colours[each.policy], alpha)
                for each in its
                for name, of, alpha in (("seen", each.seen, 0.4), ("unseen", each.unseen, 1.0))
            ]
            plots.bars(axes, [stage.stage for stage in its[0].seen.stages], series)
        plots.save(figure, path)


def _row(each: Difference) -> Row:
    bounds = None if each.low is None else f" ({points(each.low)} to {points(each.high)})"
    return {
        "task": each.task,
        "policy": each.policy,
        "seen": str(each.seen.stages[-1]),
        "unseen": str(each.unseen.stages[-1]),
        "Diff. %": points(each.relative),
        "in points": points(each.points) + (bounds or ""),
        "judged": f"{each.seen.judged}, {each.unseen.judged}",
        "invalid": f"{each.seen.invalid}, {each.unseen.invalid}",
        "errors": f"{each.seen.errors}, {each.unseen.errors}",
    }


def _transfer_tables(found: Sequence[Difference]) -> list[Table]:
    """A table for tasks with the same stages."""
    stages = {each.task: tuple(stage.stage for stage in each.seen.stages) for each in found}
    return [
        Table(
            f"Transfer rates, seen > unseen: {' > '.join(names)}",
            [
                {"task": each.task, "policy": each.policy}
                | {
                    f"Tr_{number}": f"{percent(seen)} > {percent(unseen)}"
                    for number, (seen, unseen) in enumerate(
                        zip(each.transfer_seen, each.transfer_unseen, strict=True), start=1
                    )
                }
                for each in found
                if stages[each.task] == names
            ],
        )
        for names in dict.fromkeys(stages.values())
    ]


def _test_row(test: PairedTest) -> Row:
    return {
        "task": test.task,
        "policies": test.policies,
        "t": None if test.t is None else round(test.t, 2),
        "p": chance(test.p),
        "Cohen's d": None if test.d is None else round(test.d, 2),
    }
