"""RQ5: how much of what a policy does with known objects it still does with others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, stdev

import numpy as np

from vlafuzz.statistics import Interval
from vlafuzz.studies.stages import Standing

ENOUGH = 3  # policies for a test over policies
_RESAMPLES = 10_000


@dataclass(frozen=True)
class Difference:
    """A policy in a task with seen and with unseen objects.

    Attributes:
        relative: of the success with seen objects, what is gained or lost with unseen ones: (unseen - seen) /
            seen; None where seen is 0.
        points: unseen - seen, with a 95 % interval from ``low`` to ``high``: percentile bootstrap over the
            scenes of each; None where neither varies.
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
        d: Cohen's, of paired samples: mean over standard deviation of the differences. Like ``t`` and ``p``
            None where these do not vary.
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
    """Of the scenes that reached the stage before, the share that reached the next one, for each stage."""
    counts = [standing.judged, *(stage.count for stage in standing.stages)]
    return tuple(now / was if was else None for was, now in pairwise(counts))


def paired_tests(found: Sequence[Difference]) -> list[PairedTest]:
    """A test for each task that enough policies did, and one over all tasks."""
    pairs: dict[str, dict[str, tuple[float, float]]] = {}
    for each in found:
        before, after = _success(each.seen), _success(each.unseen)
        if before is not None and after is not None:
            pairs.setdefault(each.task, {})[each.policy] = (before, after)
    common = [name for name in next(iter(pairs.values()), ()) if all(name in its for its in pairs.values())]
    means = {
        name: (fmean(its[name][0] for its in pairs.values()), fmean(its[name][1] for its in pairs.values()))
        for name in common
    }
    tables = [*pairs.items(), *([("all", means)] if len(pairs) > 1 else [])]
    return [_test(task, list(its.values())) for task, its in tables if len(its) >= ENOUGH]


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

    before, after = (np.repeat([1.0, 0.0], [each.stages[-1].count, each.judged - each.stages[-1].count])
                     for each in (seen, unseen))  # fmt: skip
    if min(len(before), len(after)) < 2 or (len({*before}) == 1 and len({*after}) == 1):
        return None
    found = bootstrap(
        (after, before),
        lambda x, y, axis: x.mean(axis=axis) - y.mean(axis=axis),
        n_resamples=_RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Interval(float(found.low), float(found.high))


def _success(standing: Standing) -> float | None:
    return standing.stages[-1].share if standing.judged else None
