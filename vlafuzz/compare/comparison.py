"""Comparison: the figures, curves and tests of several strategies, from their counted runs."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from vlafuzz.compare.failures import CountedRun, union
from vlafuzz.compare.figures import Curve, Figures, curves, figures
from vlafuzz.compare.samples import Evidence, Solvable
from vlafuzz.compare.verdicts import MEASURES, Pair, Runs, against

SPREAD = (
    "failures", "cells", "coverage", "cid", "qd_score", "sparseness", "severity", "first_failure",
    "tenth_failure", "valid_share", "rejected", "rollouts", "seconds", "rollout_seconds",
    "search_seconds", "search_share", "store_seconds", "store_share",
)  # fmt: skip
_NEVER = 1e300  # practically infinite, but quantiles between two of them are numbers
# A run without a figure ranks last: rollouts to a failure that was never found exceed any number.
_WITHOUT = {measure.name: -_NEVER if measure.most else _NEVER for measure in MEASURES}


@dataclass(frozen=True)
class Spread:
    """Median and middle half of a figure that ``runs`` of the repeats have; None where most lack it."""

    median: float | None
    low: float | None
    high: float | None
    runs: int


@dataclass(frozen=True, kw_only=True)
class Standing:
    """The results of a strategy over its repeats.

    Attributes:
        figures: by name.
        failures, cells: distinct failing scenes and cells of all repeats together.
        coverage: share of the cells in which any run of any strategy failed, of all repeats together.
        only: cells that no other strategy found.
        solvable: None if no failures were sampled; ``evidence`` is None if none were triaged.
    """

    strategy: str
    figures: Mapping[str, Spread]
    failures: int
    cells: int
    coverage: float | None
    only: int
    solvable: Solvable | None
    evidence: Evidence | None


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """The result of ``vlafuzz compare``; the JSON of ``--json``."""

    task: str
    policy: str
    budget: int
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
    counted: Mapping[str, Sequence[CountedRun]],
    reference: str,
    *,
    store: str,
    solvable: Mapping[str, Solvable | None] | None = None,
    evidence: Mapping[str, Evidence | None] | None = None,
) -> Comparison:
    """All figures, curves and tests.

    Args:
        counted: by strategy, its runs in the order of their seeds.
        reference: the strategy that the others are compared with.
        solvable, evidence: by strategy, the results of the expert's attempts and of triage.
    """
    all_runs = list(chain.from_iterable(counted.values()))
    reached = union(all_runs)
    runs: Runs = {name: [figures(run, reached) for run in repeats] for name, repeats in counted.items()}
    manifest = all_runs[0].run.manifest
    cells = {
        name: {failure.cell for run in repeats for failure in run.failures}
        for name, repeats in counted.items()
    }
    finders = Counter(chain.from_iterable(cells.values()))
    return Comparison(
        task=manifest.task,
        policy=manifest.policy,
        budget=manifest.budget,
        repeats=len(counted[reference]),
        seeds=tuple(run.run.manifest.seed for run in counted[reference]),
        reference=reference,
        union_cells=len(reached),
        standings=tuple(
            Standing(
                strategy=name,
                figures={
                    figure: spread([getattr(run, figure) for run in runs[name]], _WITHOUT.get(figure))
                    for figure in SPREAD
                },
                failures=len({failure.scene.digest for run in repeats for failure in run.failures}),
                cells=len(cells[name]),
                coverage=len(cells[name]) / len(reached) if reached else None,
                only=sum(finders[cell] == 1 for cell in cells[name]),
                solvable=(solvable or {}).get(name),
                evidence=(evidence or {}).get(name),
            )
            for name, repeats in counted.items()
        ),
        against=tuple(against(runs, reference)),
        curves=tuple(
            chain.from_iterable(curves(name, repeats, manifest.budget) for name, repeats in counted.items())
        ),
        runs=tuple(chain.from_iterable(runs.values())),
        store=store,
    )


def spread(values: Sequence[float | None], without: float | None = None) -> Spread:
    """Median and middle half; a quantile among runs without the figure is None.

    Args:
        without: the rank of a run without the figure; None to leave such runs out.
    """
    known = [value for value in values if value is not None]
    filled = (without if value is None else value for value in values)
    ranked = [value for value in filled if value is not None]
    if not ranked:
        return Spread(None, None, None, 0)
    low, middle, high = np.percentile(ranked, [25, 50, 75])
    return Spread(_known(middle), _known(low), _known(high), len(known))


def _known(quantile: float) -> float | None:
    return float(quantile) if abs(quantile) < math.sqrt(_NEVER) else None
