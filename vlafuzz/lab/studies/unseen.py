"""RQ5: how much of its success with seen objects a policy keeps with unseen ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import fmean, stdev

import numpy as np

from vlafuzz.common.text import Row, percent, points
from vlafuzz.lab.plots import coloured, save
from vlafuzz.lab.studies.sheet import Series, StudyResult, bars, chance, share_panels
from vlafuzz.lab.studies.stages import Standing
from vlafuzz.report.view import Table

ENOUGH = 3  # policies for a test over policies
_RESAMPLES = 10_000


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A policy in a task with seen and with unseen objects.

    Attributes:
        relative: change of success relative to seen objects, (unseen - seen) / seen; None where seen is 0. points:
        unseen - seen, with a 95 % percentile bootstrap interval over the scenes from ``low`` to
            ``high``; the interval is None where neither varies.
        transfer_seen, transfer_unseen: Tr_n: of the scenes that reach stage n - 1 (all for the first), the share that
            reaches stage n; None where there are none.
    """

    task: str
    policy: str
    seen: Standing
    unseen: Standing
    relative: float | None
    points: float | None
    low: float | None
    high: float | None
    transfer_seen: tuple[float | None, ...]
    transfer_unseen: tuple[float | None, ...]


@dataclass(frozen=True)
class PairedTest:
    """A paired t-test over policies, of success with unseen against seen objects.

    Attributes:
        task: ``all`` for each policy's mean over its tasks.
        d: Cohen's for paired samples: mean over standard deviation of the differences. Like ``t`` and ``p`` it is None
            where the differences do not vary.
    """

    task: str
    policies: int
    t: float | None
    p: float | None
    d: float | None


def difference(seen: Standing, unseen: Standing) -> Difference:
    """Compare the two runs of a policy in a task."""
    before, after = _success(seen), _success(unseen)
    both = before is not None and after is not None
    low, high = _bootstrap(seen, unseen) if both else (None, None)
    return Difference(
        task=seen.task,
        policy=seen.policy,
        seen=seen,
        unseen=unseen,
        relative=(after - before) / before if before and after is not None else None,
        points=after - before if before is not None and after is not None else None,
        low=low,
        high=high,
        transfer_seen=transfers(seen),
        transfer_unseen=transfers(unseen),
    )


def transfers(standing: Standing) -> tuple[float | None, ...]:
    """For each stage, the share of the scenes at the stage before that reached it."""
    counts = [standing.judged, *(stage.count for stage in standing.stages)]
    return tuple(after / before if before else None for before, after in pairwise(counts))


def paired_tests(rows: Sequence[Difference]) -> list[PairedTest]:
    """A test for each task with enough policies, and one over all tasks."""
    by_task: dict[str, dict[str, tuple[float, float]]] = {}
    for row in rows:
        before, after = _success(row.seen), _success(row.unseen)
        if before is not None and after is not None:
            by_task.setdefault(row.task, {})[row.policy] = (before, after)
    if len(by_task) > 1:
        common = set.intersection(*(set(table) for table in by_task.values()))
        tables = list(by_task.values())
        by_task["all"] = {
            policy: (fmean(table[policy][0] for table in tables), fmean(table[policy][1] for table in tables))
            for policy in tables[0]
            if policy in common
        }
    return [_test(task, list(table.values())) for task, table in by_task.items() if len(table) >= ENOUGH]


def _test(task: str, pairs: Sequence[tuple[float, float]]) -> PairedTest:
    from scipy.stats import ttest_rel

    before, after = zip(*pairs, strict=True)
    differences = np.subtract(after, before)
    spread = stdev(differences)
    if spread < 1e-12:
        return PairedTest(task, len(pairs), None, None, None)
    t, p = ttest_rel(after, before)
    return PairedTest(task, len(pairs), float(t), float(p), fmean(differences) / spread)


def _bootstrap(seen: Standing, unseen: Standing) -> tuple[float | None, float | None]:
    from scipy.stats import bootstrap

    # 1 for each judged scene that succeeded, else 0
    before, after = (
        np.repeat([1.0, 0.0], [one.stages[-1].count, one.judged - one.stages[-1].count]) for one in (seen, unseen)
    )
    if min(len(before), len(after)) < 2 or (len({*before}) == 1 and len({*after}) == 1):
        return None, None
    bounds = bootstrap(
        (after, before),
        lambda x, y, axis: x.mean(axis=axis) - y.mean(axis=axis),
        n_resamples=_RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(bounds.low), float(bounds.high)


def _success(standing: Standing) -> float | None:
    return standing.stages[-1].share if standing.judged else None


_NOTE = (
    "Success in scenes with seen and with unseen objects, of the scenes that were judged, with "
    "Wilson's 95 % interval. Diff. %: (unseen - seen) / seen. In points: unseen - seen, with a 95 % "
    "percentile bootstrap over the scenes. Tr_n: of the scenes that reach stage n - 1, of all for n = "
    "1, the share that reaches stage n."
)
_TESTED = "The t-test is paired, over policies, which it takes as a sample of many; d is Cohen's, of paired samples."
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

    def sheet(self) -> tuple[list[Table], list[str]]:
        """Success, transfer rates and, over enough policies, the test."""
        tables = [
            Table(f"Success; unseen: {', '.join(self.packs)}", [_row(row) for row in self.differences]),
            *_transfer_tables(self.differences),
            *([Table("Over policies", [_test_row(test) for test in self.tests])] if self.tests else []),
        ]
        return tables, self.noted(_DIFFERS, _NOTE, _TESTED if self.tests else _FEW)

    def draw(self, path: Path) -> None:
        """Stages with seen objects, pale, beside those with unseen ones; a panel per task."""
        tasks = list(dict.fromkeys(row.task for row in self.differences))
        figure, every = share_panels(self.title, tasks, "share of scenes")
        colours = coloured(self.policies)
        for axes, task in zip(every, tasks, strict=True):
            rows = [row for row in self.differences if row.task == task]
            series = [
                Series(f"{row.policy}, {name}", standing.stages, colours[row.policy], alpha)
                for row in rows
                for name, standing, alpha in (("seen", row.seen, 0.4), ("unseen", row.unseen, 1.0))
            ]
            bars(axes, [stage.stage for stage in rows[0].seen.stages], series)
        save(figure, path)


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
        f"Tr_{number}": f"{percent(seen)} > {percent(unseen)}" for number, (seen, unseen) in enumerate(rates, start=1)
    }


def _test_row(test: PairedTest) -> Row:
    return {
        "task": test.task,
        "policies": test.policies,
        "t": None if test.t is None else round(test.t, 2),
        "p": chance(test.p),
        "Cohen's d": None if test.d is None else round(test.d, 2),
    }
