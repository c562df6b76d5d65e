"""Comparison: the figures, curves and tests of several strategies, from their counted runs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from statistics import fmean

import numpy as np

from vlafuzz.common.statistics import Estimate, mean_estimate
from vlafuzz.lab.compare.figures import CountedRun, Figures, figures, union
from vlafuzz.lab.compare.verdicts import Pair, against

MEANS = ("causes", "triage_rollouts", "causes_per_100", "failures")
SPREAD = (
    "cells", "coverage", "cid", "qd_score", "sparseness", "severity", "first_failure",
    "tenth_failure", "valid_share", "rejected", "rollouts", "seconds", "rollout_seconds",
    "search_seconds", "search_share", "store_seconds", "store_share",
)  # fmt: skip
_NEVER = 1e300  # practically infinite, but quantiles between two of them are numbers
# A run without a figure ranks last: rollouts to a failure that was never found exceed any number.
_WITHOUT = {"cid": _NEVER, "sparseness": -_NEVER, "first_failure": _NEVER, "tenth_failure": _NEVER}
_POINTS = 50  # of a curve


@dataclass(frozen=True)
class Spread:
    """Median and middle half of a figure that ``runs`` of the repeats have; None where most lack it."""

    median: float | None
    low: float | None
    high: float | None
    runs: int


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A count as a function of rollouts, over the repeats of a strategy: median and middle half."""

    strategy: str
    what: str
    rollouts: tuple[int, ...]
    median: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Triage:
    """What triage made of all repeats of a strategy together.

    Attributes:
        triaged: findings, counted for every run; ``confirmed`` and ``certified`` of them.
        causes: signatures, each with the number of runs in which it was certified.
        only: causes that no other strategy found.
    """

    triaged: int
    confirmed: int
    certified: int
    causes: Mapping[str, int]
    only: int


@dataclass(frozen=True, kw_only=True)
class Standing:
    """The results of a strategy over its repeats.

    Attributes:
        means: of the figures that are compared first, by name; None where a run lacks it. probability: of a failure in
        a random scene as one run tells it: means of the runs' estimates and of
            the bounds of their 95 % intervals.
        triage: None if nothing was triaged.
        figures: all others, by name.
    """

    strategy: str
    means: Mapping[str, Estimate | None]
    probability: Estimate | None
    triage: Triage | None
    figures: Mapping[str, Spread]


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """The result of ``vlafuzz compare``; the JSON of ``--json``.

    Attributes:
        budget: rollouts of each run; ``triage_rollouts`` is the limit for its triage.
    """

    task: str
    policy: str
    budget: int
    triage_rollouts: int
    repeats: int
    seeds: tuple[int, ...]
    reference: str
    union_cells: int
    standings: tuple[Standing, ...]
    against: tuple[Pair, ...]
    curves: tuple[Curve, ...]
    runs: tuple[Figures, ...]
    store: str


def compare_runs(
    counted: Mapping[str, Sequence[CountedRun]], reference: str, *, store: str, limit: int = 0
) -> Comparison:
    """All figures, curves and tests.

    Args:
        counted: by strategy, its runs in the order of their seeds.
        reference: the strategy that the others are compared with.
        limit: rollouts for the triage of each run.
    """
    all_runs = list(chain.from_iterable(counted.values()))
    reached = union(all_runs)
    runs = {name: [figures(run, reached) for run in repeats] for name, repeats in counted.items()}
    manifest = all_runs[0].run.manifest
    triage = _triage(counted)
    standings = (
        Standing(
            strategy=name,
            means={figure: _mean([run[figure] for run in repeats]) for figure in MEANS},
            probability=_probability(counted[name]),
            triage=triage.get(name),
            figures={figure: spread([run[figure] for run in repeats], _WITHOUT.get(figure)) for figure in SPREAD},
        )
        for name, repeats in runs.items()
    )
    drawn = (curves(name, repeats, manifest.budget, limit) for name, repeats in counted.items())
    return Comparison(
        task=manifest.task,
        policy=manifest.policy,
        budget=manifest.budget,
        triage_rollouts=limit,
        repeats=len(counted[reference]),
        seeds=tuple(run.run.manifest.seed for run in counted[reference]),
        reference=reference,
        union_cells=len(reached),
        standings=tuple(standings),
        against=tuple(against(runs, reference)),
        curves=tuple(chain.from_iterable(drawn)),
        runs=tuple(chain.from_iterable(runs.values())),
        store=store,
    )


def _triage(counted: Mapping[str, Sequence[CountedRun]]) -> dict[str, Triage]:
    """By strategy, the causes of all its runs; without triage none."""
    known = {name: [run.certified for run in runs if run.certified] for name, runs in counted.items()}
    causes = {name: Counter(chain.from_iterable(one.causes for one in all_)) for name, all_ in known.items()}
    finders = Counter(chain.from_iterable(causes.values()))
    return {
        name: Triage(
            triaged=sum(one.triaged for one in runs),
            confirmed=sum(one.confirmed for one in runs),
            certified=sum(one.certified for one in runs),
            causes=dict(causes[name].most_common()),
            only=sum(finders[cause] == 1 for cause in causes[name]),
        )
        for name, runs in known.items()
        if runs
    }


def _mean(values: Sequence[float | None]) -> Estimate | None:
    known = [value for value in values if value is not None]
    return mean_estimate(known) if len(known) == len(values) else None


def _probability(runs: Sequence[CountedRun]) -> Estimate | None:
    known = [run.probability for run in runs if run.probability]
    return Estimate(*map(fmean, zip(*known, strict=True))) if len(known) == len(runs) else None


def spread(values: Sequence[float | None], without: float | None = None) -> Spread:
    """Median and middle half; a quantile among runs without the figure is None.

    Args:
        without: the rank of a run without the figure; None to leave such runs out.
    """
    filled = [without if value is None else value for value in values]
    ranked = [value for value in filled if value is not None]
    if not ranked:
        return Spread(None, None, None, 0)
    low, middle, high = (
        float(quantile) if abs(quantile) < np.sqrt(_NEVER) else None for quantile in np.percentile(ranked, [25, 50, 75])
    )
    return Spread(middle, low, high, sum(value is not None for value in values))


def curves(strategy: str, runs: Sequence[CountedRun], budget: int, limit: int = 0) -> list[Curve]:
    """The curves of causes, over the rollouts of triage up to its limit, and of failures and cells.

    A run that ended early stays at its last count.
    """
    causes = [list(run.certified.causes.values()) for run in runs if run.certified]
    failures = [[failure.spent for failure in run.failures] for run in runs]
    # Of the failures of a cell, the first one counts.
    cells = [sorted({one.cell: one.spent for one in reversed(run.failures)}.values()) for run in runs]
    drawn = [_curve(strategy, "causes", causes, limit)] if causes else []
    return [*drawn, _curve(strategy, "failures", failures, budget), _curve(strategy, "cells", cells, budget)]


def _curve(strategy: str, what: str, spent: Sequence[Sequence[int]], rollouts: int) -> Curve:
    """``spent``: of every run, after how many rollouts each came, in order."""
    steps = np.linspace(0, rollouts, min(rollouts, _POINTS) + 1)
    at = tuple(np.unique(steps.round().astype(int)).tolist())
    counts = np.stack([np.searchsorted(np.array(run), at, side="right") for run in spent])
    low, median, high = (tuple(row) for row in np.percentile(counts, [25, 50, 75], axis=0).tolist())
    return Curve(strategy=strategy, what=what, rollouts=at, median=median, low=low, high=high)
