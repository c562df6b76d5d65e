"""The tables and the plot of RQ5."""

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
    "The t-test is paired, over policies, which it takes as a sample of many; d is Cohen's, of paired "
    "samples."
)
_FEW = (
    f"With fewer than {ENOUGH} policies there is no test over policies: the bootstrap over scenes says "
    "how certain the difference is for these policies, nothing about others."
)
_DIFFERS = (
    "its unseen objects are YCB's, at half size in the put tasks, with 1000 scenes per task; here an "
    "object has the same size in all tasks, and what the gripper cannot grasp is no target. Only those "
    "who trained a policy know which objects it has seen."
)


@dataclass(frozen=True)
class UnseenResult(StudyResult):
    """The result of RQ5; ``packs`` are those of the unseen objects."""

    packs: list[str]
    differences: list[Difference]
    tests: list[PairedTest]

    def sheet(self) -> Sheet:
        """Success, transfer rates and, over enough policies, the test."""
        tables = [
            Table(f"Success; unseen: {', '.join(self.packs)}", [_row(row) for row in self.differences]),
            *_transfer_tables(self.differences),
            *([Table("Over policies", [_test_row(test) for test in self.tests])] if self.tests else []),
        ]
        notes = [_NOTE, _TESTED if self.tests else _FEW, *self.gaps]
        return Sheet(self.title, tables, notes, _DIFFERS, self._plot)

    def _plot(self, path: Path) -> None:
        """Stages with seen objects, pale, beside those with unseen ones; a panel per task."""
        tasks = list(dict.fromkeys(row.task for row in self.differences))
        figure, every = plots.panels(self.title, tasks, "share of scenes")
        colours = plots.coloured(self.policies)
        for axes, task in zip(every, tasks, strict=True):
            rows = [row for row in self.differences if row.task == task]
            series = [
                plots.Series(f"{row.policy}, {name}", standing.stages, colours[row.policy], alpha)
                for row in rows
                for name, standing, alpha in (("seen", row.seen, 0.4), ("unseen", row.unseen, 1.0))
            ]
            plots.bars(axes, [stage.stage for stage in rows[0].seen.stages], series)
        plots.save(figure, path)


def _row(row: Difference) -> Row:
    bounds = None if row.low is None else f" ({points(row.low)} to {points(row.high)})"
    return {
        "task": row.task,
        "policy": row.policy,
        "seen": str(row.seen.stages[-1]),
        "unseen": str(row.unseen.stages[-1]),
        "Diff. %": points(row.relative),
        "in points": points(row.points) + (bounds or ""),
        "judged": f"{row.seen.judged}, {row.unseen.judged}",
        "invalid": f"{row.seen.invalid}, {row.unseen.invalid}",
        "errors": f"{row.seen.errors}, {row.unseen.errors}",
    }


def _transfer_tables(rows: Sequence[Difference]) -> list[Table]:
    """One table for all tasks with the same stages."""
    by_stages: dict[tuple[str, ...], list[Difference]] = {}
    for row in rows:
        by_stages.setdefault(tuple(stage.stage for stage in row.seen.stages), []).append(row)
    return [
        Table(f"Transfer rates, seen > unseen: {' > '.join(stages)}", [_transfer_row(row) for row in alike])
        for stages, alike in by_stages.items()
    ]


def _transfer_row(row: Difference) -> Row:
    rates = zip(row.transfer_seen, row.transfer_unseen, strict=True)
    return {"task": row.task, "policy": row.policy} | {
        f"Tr_{number}": f"{percent(seen)} > {percent(unseen)}"
        for number, (seen, unseen) in enumerate(rates, start=1)
    }


def _test_row(test: PairedTest) -> Row:
    return {
        "task": test.task,
        "policies": test.policies,
        "t": None if test.t is None else round(test.t, 2),
        "p": chance(test.p),
        "Cohen's d": None if test.d is None else round(test.d, 2),
    }
