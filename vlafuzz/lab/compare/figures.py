"""Figures of a run, and curves over its budget."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from vlafuzz.lab.compare.failures import CountedRun, Failure

POINTS = 50  # of a curve


@dataclass(frozen=True, kw_only=True)
class Figures:
    """A run in numbers; None where there is nothing to measure.

    Attributes:
        causes: distinct certified causes; like all of triage None where none was asked for.
        triage_rollouts: of the policy, beside the ``rollouts`` of the run.
        causes_per_100: rollouts of both.
        triaged: findings, ``confirmed`` and ``certified`` of them; see ``certified.Certified``.
        failures: distinct failing scenes, which lie in ``cells``.
        probability: that the policy fails in a random scene, with its 95 % interval from ``probability_low``
            to ``probability_high`` of this width; None where the strategy does not estimate it.
        coverage: share of the cells in which any run of the comparison failed.
        cid: see ``coverage_inverted_distance``: lower is better.
        severity: mean over the failures.
        first_failure, tenth_failure: rollouts spent when that failure was found.
        valid_share: of the proposals, those of fair scenes.
        rejected: distinct scenes that are not fair.
        seconds: wall time, ``rollout_seconds`` of the rollouts alone, added up over all processes.
        search_seconds: in the strategy's ask and tell, ``search_share`` of the wall time.
        store_seconds: in the store, ``store_share`` of the wall time.
    """

    run: int
    strategy: str
    seed: int
    rollouts: int
    causes: int | None
    triage_rollouts: int | None
    causes_per_100: float | None
    triaged: int | None
    confirmed: int | None
    certified: int | None
    failures: int
    probability: float | None
    probability_low: float | None
    probability_high: float | None
    probability_width: float | None
    cells: int
    coverage: float | None
    cid: float | None
    qd_score: float
    sparseness: float | None
    severity: float | None
    first_failure: int | None
    tenth_failure: int | None
    proposals: int
    valid_share: float | None
    rejected: int
    errors: int
    seconds: float | None
    rollout_seconds: float
    search_seconds: float | None
    search_share: float | None
    store_seconds: float | None
    store_share: float | None


def figures(counted: CountedRun, union: Mapping[str, Failure]) -> Figures:
    """The figures of a run beside the failures of all runs, see ``failures.union``."""
    failures = counted.failures
    cells = {failure.cell for failure in failures}
    fair = counted.judged + counted.rejected
    run, manifest, known, share = counted.run, counted.run.manifest, counted.certified, counted.probability
    return Figures(
        run=run.id,
        strategy=manifest.strategy,
        seed=manifest.seed,
        rollouts=counted.rollouts,
        causes=len(known.causes) if known else None,
        triage_rollouts=known.rollouts if known else None,
        causes_per_100=100 * len(known.causes) / max(1, counted.rollouts + known.rollouts) if known else None,
        triaged=known.triaged if known else None,
        confirmed=known.confirmed if known else None,
        certified=known.certified if known else None,
        failures=len(failures),
        probability=share.value if share else None,
        probability_low=share.low if share else None,
        probability_high=share.high if share else None,
        probability_width=share.high - share.low if share else None,
        cells=len(cells),
        coverage=len(cells) / len(union) if union else None,
        cid=coverage_inverted_distance(failures, list(union.values())),
        qd_score=qd_score(failures),
        sparseness=sparseness(failures),
        severity=fmean(failure.severity for failure in failures) if failures else None,
        first_failure=failures[0].spent if failures else None,
        tenth_failure=failures[9].spent if len(failures) >= 10 else None,
        proposals=counted.proposals,
        valid_share=counted.judged / fair if fair else None,
        rejected=counted.rejected_scenes,
        errors=counted.errors,
        seconds=run.seconds,
        rollout_seconds=counted.rollout_seconds,
        search_seconds=run.search_seconds,
        search_share=_share(run.search_seconds, run.seconds),
        store_seconds=run.store_seconds,
        store_share=_share(run.store_seconds, run.seconds),
    )


def _share(part: float | None, whole: float | None) -> float | None:
    return None if part is None or not whole else part / whole


def coverage_inverted_distance(failures: Sequence[Failure], reference: Sequence[Failure]) -> float | None:
    """CID: the mean distance from each reference failure to the nearest failure.

    Sorokin, Safin, Nejati 2024 <https://arxiv.org/abs/2410.11769>. Theirs is a grid over the inputs; with 20
    and more genes ours is what all strategies together found. Distances are those of scene embeddings: two
    scenes that differ in one operator only are at most 1 apart.
    """
    if not failures or not reference:
        return None
    from scipy.spatial.distance import cdist

    return float(cdist(_points(reference), _points(failures)).min(axis=1).mean())


def qd_score(failures: Sequence[Failure]) -> float:
    """The sum over all cells of the quality of the cell's best failure: Pugh, Soros, Stanley 2016.

    <https://doi.org/10.3389/frobt.2016.00040>. For quality see ``failures.quality``.
    """
    best: dict[str, float] = {}
    for failure in failures:
        best[failure.cell] = max(failure.quality, best.get(failure.cell, 0.0))
    return float(sum(best.values()))


def sparseness(failures: Sequence[Failure]) -> float | None:
    """The mean distance from a failure to the nearest other failure of the run; None with fewer than two."""
    if len(failures) < 2:
        return None
    from scipy.spatial import cKDTree

    points = _points(failures)
    nearest, _ = cKDTree(points).query(points, k=2)
    return float(nearest[:, 1].mean())


def _points(failures: Sequence[Failure]) -> NDArray[np.float64]:
    return np.stack([failure.vector for failure in failures])


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A count as a function of rollouts, over the repeats of a strategy: median and middle half."""

    strategy: str
    what: str
    rollouts: tuple[int, ...]
    median: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


def grid(rollouts: int) -> tuple[int, ...]:
    """The points of a curve: from 0 rollouts to all of them."""
    steps = np.linspace(0, rollouts, min(rollouts, POINTS) + 1)
    return tuple(np.unique(steps.round().astype(int)).tolist())


def curves(strategy: str, runs: Sequence[CountedRun], budget: int, limit: int = 0) -> list[Curve]:
    """The curves of causes, over the rollouts of triage up to its limit, and of failures and cells.

    A run that ended early stays at its last count.
    """
    causes = [list(run.certified.causes.values()) for run in runs if run.certified]
    failures = [[failure.spent for failure in run.failures] for run in runs]
    cells = [sorted(_firsts(run.failures).values()) for run in runs]
    drawn = [_curve(strategy, "causes", causes, limit)] if causes else []
    return [*drawn, _curve(strategy, "failures", failures, budget), _curve(strategy, "cells", cells, budget)]


def _curve(strategy: str, what: str, spent: Sequence[Sequence[int]], rollouts: int) -> Curve:
    """``spent``: of every run, after how many rollouts each came, in order."""
    at = grid(rollouts)
    counts = np.stack([np.searchsorted(np.array(run), at, side="right") for run in spent])
    low, median, high = (tuple(row) for row in np.percentile(counts, [25, 50, 75], axis=0).tolist())
    return Curve(strategy=strategy, what=what, rollouts=at, median=median, low=low, high=high)


def _firsts(failures: Sequence[Failure]) -> dict[str, int]:
    """By cell, rollouts spent when it was first found."""
    return {failure.cell: failure.spent for failure in reversed(failures)}
