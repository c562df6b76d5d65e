"""RQ5: how much of its success with seen objects a policy keeps with unseen ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, stdev

import numpy as np
from numpy.typing import NDArray

from vlafuzz.statistics import Interval
from vlafuzz.studies.stages import Standing

ENOUGH = 3  # policies for a test over policies
_RESAMPLES = 10_000


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A policy in a task with seen and with unseen objects.

    Attributes:
        relative: change of success relative to seen objects, (unseen - seen) / seen; None where seen is 0.
        points: unseen - seen, with a 95 % percentile bootstrap interval over the scenes from ``low`` to
            ``high``; the interval is None where neither varies.
        transfer_seen, transfer_unseen: Tr_n: of the scenes that reach stage n - 1 (all for the first), the
            share that reaches stage n; None where there are none.
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
        d: Cohen's for paired samples: mean over standard deviation of the differences. Like ``t`` and ``p``
            it is None where the differences do not vary.
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
    interval = _bootstrap(seen, unseen) if both else None
    return Difference(
        task=seen.task,
        policy=seen.policy,
        seen=seen,
        unseen=unseen,
        relative=(after - before) / before if before and after is not None else None,
        points=after - before if before is not None and after is not None else None,
        low=interval.low if interval else None,
        high=interval.high if interval else None,
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
    tables = list(by_task.values())
    common = [policy for policy in next(iter(tables), ()) if all(policy in table for table in tables)]
    means = {
        policy: (fmean(table[policy][0] for table in tables), fmean(table[policy][1] for table in tables))
        for policy in common
    }
    named = [*by_task.items(), *([("all", means)] if len(tables) > 1 else [])]
    return [_test(task, list(table.values())) for task, table in named if len(table) >= ENOUGH]


def _test(task: str, pairs: Sequence[tuple[float, float]]) -> PairedTest:
    from scipy.stats import ttest_rel

    before, after = zip(*pairs, strict=True)
    differences = np.subtract(after, before)
    spread = stdev(differences)
    if spread < 1e-12:
        return PairedTest(task, len(pairs), None, None, None)
    result = ttest_rel(after, before)
    return PairedTest(
        task, len(pairs), float(result.statistic), float(result.pvalue), fmean(differences) / spread
    )


def _bootstrap(seen: Standing, unseen: Standing) -> Interval | None:
    from scipy.stats import bootstrap

    before, after = _successes(seen), _successes(unseen)
    if min(len(before), len(after)) < 2 or (len({*before}) == 1 and len({*after}) == 1):
        return None
    bounds = bootstrap(
        (after, before),
        lambda x, y, axis: x.mean(axis=axis) - y.mean(axis=axis),
        n_resamples=_RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Interval(float(bounds.low), float(bounds.high))


def _successes(standing: Standing) -> NDArray[np.float64]:
    """1 for each judged scene that succeeded, else 0."""
    count = standing.stages[-1].count
    return np.repeat([1.0, 0.0], [count, standing.judged - count])


def _success(standing: Standing) -> float | None:
    return standing.stages[-1].share if standing.judged else None
