"""The failures of a run, when each was found, and the run in numbers."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.statistics import Share
from vlafuzz.errors import UsageError
from vlafuzz.failures.triage.pipeline import findings_in_order
from vlafuzz.lab.compare.certified import Certified, certified, known_results
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store

Embed = Callable[[Scene], NDArray[np.float64]]
Figures = Mapping[str, Any]
"""A run in numbers by name, and its strategy; None where there is nothing to measure. See ``figures``."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Failure:
    """A failing scene of a run; for its cell and quality see ``scoring.cell`` and ``quality``.

    Attributes:
        severity: its distance from nominal, the sum over the operators.
        spent: rollouts of the run when it was found, its own included.
        vector: embedding of the scene, in which distance means difference.
    """

    digest: str
    cell: str
    severity: float
    quality: float
    spent: int
    vector: NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class CountedRun:
    """The counts of a run.

    Attributes:
        rollouts: of the policy; ``rollout_seconds`` is their duration, summed over all processes. verdicts: of all
        proposals.
        rejected: distinct invalid scenes; they cost no rollout.
        failures: in the order in which they were found.
        probability: that the policy fails in a random scene; None where the strategy does not tell. certified: None
        without triage.
    """

    run: Run
    rollouts: int
    rollout_seconds: float
    verdicts: Mapping[Verdict, int]
    rejected: int
    failures: Sequence[Failure]
    probability: Probability | None = None
    certified: Certified | None = None


def quality(severity: float, progress: float, operators: int) -> float:
    """The quality of a failure, in [0, 1]: 1 for a failure in the nominal scene without any progress.

    The mean of two shares: how near to nominal it is (1 - the mean severity of the operators that vary), and how early
    the policy fails (1 - progress).
    """
    return (max(0.0, 1.0 - severity / operators) + 1.0 - progress) / 2.0


def count_run(store: Store, run: Run, embed: Embed) -> CountedRun:
    """Count a stored run.

    Raises:
        UsageError: it reused outcomes of other runs, so that its budget does not compare.
    """
    operators = max(1, len(json.loads(run.manifest.operators).get("varied", ())))
    verdicts = dict.fromkeys(Verdict, 0)
    failures: dict[str, Failure] = {}
    rejected, own, reused = set[str](), set[str](), set[str]()
    spent, seconds = 0, 0.0
    for trial in store.trials(run.id):
        digest, outcome = trial.scene.digest, trial.outcome
        verdicts[outcome.verdict] += 1
        (reused if trial.duplicate else own).add(digest)
        if not trial.duplicate:
            spent += len(outcome.rollouts)
            seconds += sum(rollout.seconds for rollout in outcome.rollouts)
        if outcome.verdict is Verdict.INVALID:
            rejected.add(digest)
        if outcome.verdict is Verdict.FAILED and digest not in failures:
            failures[digest] = Failure(
                digest=digest,
                cell=trial.cell or "",
                severity=trial.severity,
                quality=quality(trial.severity, outcome.progress, operators),
                spent=spent,
                vector=embed(trial.scene),
            )
    # A duplicate may precede the trial of its batch that was rolled out, so this waits for all of them.
    if borrowed := len(reused - own):
        raise UsageError(
            f"{store.path}: run {run.id} reused {borrowed} outcomes of other runs, at no cost",
            hint="compare only runs that `vlafuzz compare` did from start to end: give another --store",
        )
    return CountedRun(
        run=run,
        rollouts=spent,
        rollout_seconds=seconds,
        verdicts=verdicts,
        rejected=len(rejected),
        failures=list(failures.values()),
        probability=_probability(store, run, verdicts),
    )


def _probability(store: Store, run: Run, verdicts: Mapping[Verdict, int]) -> Probability | None:
    """The strategy's own estimate; independent random scenes give it, too."""
    if found := store.causes(run.id):
        return found.probability
    failed = verdicts[Verdict.FAILED]
    share = Share.of_counts(failed, failed + verdicts[Verdict.PASSED])
    random = run.manifest.strategy == "random" and share.of
    return Probability(share.share, share.low, share.high) if random else None


def with_causes(store: Store, runs: Sequence[CountedRun], limit: int) -> list[CountedRun]:
    """The runs with what their triage has come to; as they are with a limit of 0 rollouts."""
    if not limit:
        return list(runs)
    known = known_results(store)
    return [replace(one, certified=certified(findings_in_order(store, one.run.id), known, limit)) for one in runs]


def union(runs: Sequence[CountedRun]) -> dict[str, Failure]:
    """For every cell in which some run failed, its most central failure: the one nearest to their mean.

    One per cell, so that many similar failures do not count for more.
    """
    cells: dict[str, dict[str, Failure]] = {}
    for failure in chain.from_iterable(run.failures for run in runs):
        cells.setdefault(failure.cell, {})[failure.digest] = failure
    central: dict[str, Failure] = {}
    for cell, members in sorted(cells.items()):
        ordered = [members[digest] for digest in sorted(members)]
        points = _points(ordered)
        central[cell] = ordered[int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmin())]
    return central


def figures(counted: CountedRun, union: Mapping[str, Failure]) -> Figures:
    """The figures of a run beside the failures of all runs, see ``union``."""
    failures, share = counted.failures, counted.probability
    cells = {failure.cell for failure in failures}
    judged = counted.verdicts[Verdict.PASSED] + counted.verdicts[Verdict.FAILED]
    fair = judged + counted.verdicts[Verdict.INVALID]
    run = counted.run
    return {
        "run": run.id,
        "strategy": run.manifest.strategy,
        "seed": run.manifest.seed,
        "rollouts": counted.rollouts,
        **_of_triage(counted.certified, counted.rollouts),
        "failures": len(failures),  # distinct failing scenes
        "probability": share.value if share else None,  # of a failure in a random scene
        "probability_low": share.low if share else None,
        "probability_high": share.high if share else None,
        "probability_width": share.high - share.low if share else None,
        "cells": len(cells),
        "coverage": len(cells) / len(union) if union else None,
        "cid": coverage_inverted_distance(failures, list(union.values())),
        "qd_score": qd_score(failures),
        "sparseness": sparseness(failures),
        "severity": fmean(failure.severity for failure in failures) if failures else None,
        "first_failure": failures[0].spent if failures else None,
        "tenth_failure": failures[9].spent if len(failures) >= 10 else None,
        "proposals": sum(counted.verdicts.values()),
        "valid_share": judged / fair if fair else None,
        "rejected": counted.rejected,
        "errors": counted.verdicts[Verdict.ERROR],
        "seconds": run.seconds,
        "rollout_seconds": counted.rollout_seconds,
        "search_seconds": run.search_seconds,  # in the strategy's ask and tell
        "search_share": _share(run.search_seconds, run.seconds),
        "store_seconds": run.store_seconds,
        "store_share": _share(run.store_seconds, run.seconds),
    }


def _of_triage(known: Certified | None, rollouts: int) -> Figures:
    """What triage made of a run; ``causes_per_100`` counts the rollouts of search and triage together."""
    if known is None:
        names = ("causes", "triage_rollouts", "causes_per_100", "triaged", "confirmed", "certified")
        return dict.fromkeys(names)
    return {
        "causes": len(known.causes),
        "triage_rollouts": known.rollouts,
        "causes_per_100": 100 * len(known.causes) / max(1, rollouts + known.rollouts),
        "triaged": known.triaged,
        "confirmed": known.confirmed,
        "certified": known.certified,
    }


def _share(part: float | None, whole: float | None) -> float | None:
    return None if part is None or not whole else part / whole


def coverage_inverted_distance(failures: Sequence[Failure], reference: Sequence[Failure]) -> float | None:
    """CID: the mean distance from each reference failure to the nearest failure; lower is better.

    Sorokin, Safin, Nejati 2024 <https://arxiv.org/abs/2410.11769>. Theirs is a grid over the inputs; with 20 and more
    genes ours is what all strategies together found. Distances are those of scene embeddings: two scenes that differ in
    one operator only are at most 1 apart.
    """
    if not failures or not reference:
        return None
    from scipy.spatial.distance import cdist

    return float(cdist(_points(reference), _points(failures)).min(axis=1).mean())


def qd_score(failures: Sequence[Failure]) -> float:
    """The sum over all cells of the quality of the cell's best failure: Pugh, Soros, Stanley 2016.

    <https://doi.org/10.3389/frobt.2016.00040>.
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
