"""Pairs of strategies, measure by measure: effect size, interval, corrected p-value, and a sentence."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from vlafuzz.compare.figures import Figures
from vlafuzz.statistics import a12, holm, mann_whitney, ratio, ratio_interval, repeats_needed, smallest_p

ALPHA = 0.05


@dataclass(frozen=True)
class Measure:
    """A field of ``Figures`` by which strategies are compared, in words, and whether more is better."""

    name: str
    says: str
    most: bool


MEASURES = (
    Measure("cells", "distinct cells", most=True),
    Measure("failures", "failures", most=True),
    Measure("cid", "CID", most=False),
    Measure("qd_score", "QD-score", most=True),
    Measure("sparseness", "sparseness", most=True),
    Measure("first_failure", "rollouts to the first failure", most=False),
    Measure("tenth_failure", "rollouts to the tenth failure", most=False),
)


@dataclass(frozen=True, kw_only=True)
class Pair:
    """One strategy beside another, in one measure.

    Attributes:
        ratio: of the means, with the 95 % interval from ``low`` to ``high``; None where undefined.
        a12: probability that a run of ours has more of it than one of theirs; ties count half.
        p: two-sided, Mann-Whitney; ``p_holm`` corrected over all pairs of the same measure in ``of``.
        of: the family, ``reference`` (all against it) or ``all`` (every pair).
        tells: whether so few repeats could show a difference at all.
    """

    strategy: str
    other: str
    measure: str
    ratio: float | None
    low: float | None
    high: float | None
    a12: float
    p: float
    p_holm: float
    of: str
    tells: bool
    verdict: str


Runs = Mapping[str, Sequence[Figures]]
"""By strategy, its runs in the order of their seeds."""


def against(runs: Runs, reference: str) -> list[Pair]:
    """Every strategy against the reference."""
    return _pairs(runs, [(name, reference) for name in runs if name != reference], "reference")


def each_pair(runs: Runs) -> list[Pair]:
    """Every strategy against every other."""
    return _pairs(runs, [(ours, theirs) for theirs, ours in combinations(runs, 2)], "all")


def _pairs(runs: Runs, names: Sequence[tuple[str, str]], of: str) -> list[Pair]:
    pairs = []
    for measure in MEASURES:
        values = {name: [_value(run, measure) for run in figures] for name, figures in runs.items()}
        p_values = [mann_whitney(values[ours], values[theirs]) for ours, theirs in names]
        pairs += [
            _pair(pair, [values[name] for name in pair], measure, p, p_holm, of, len(names))
            for pair, p, p_holm in zip(names, p_values, holm(p_values), strict=True)
        ]
    return pairs


def _value(figures: Figures, measure: Measure) -> float:
    """A figure as a number; None, of a run without such failures, is worse than any number."""
    value = getattr(figures, measure.name)
    worst = -math.inf if measure.most else math.inf
    return worst if value is None else float(value)


def _pair(
    names: tuple[str, str],
    values: Sequence[Sequence[float]],
    measure: Measure,
    p: float,
    p_holm: float,
    of: str,
    tests: int,
) -> Pair:
    ours, theirs = values
    interval = ratio_interval(ours, theirs)
    pair = Pair(
        strategy=names[0],
        other=names[1],
        measure=measure.name,
        ratio=ratio(ours, theirs),
        low=interval.low if interval else None,
        high=interval.high if interval else None,
        a12=a12(ours, theirs),
        p=p,
        p_holm=p_holm,
        of=of,
        tells=tests * smallest_p(len(ours), len(theirs)) <= ALPHA,
        verdict="",
    )
    return replace(pair, verdict=_sentence(pair, measure, len(ours), tests))


def _sentence(pair: Pair, measure: Measure, repeats: int, tests: int) -> str:
    numbers = f"{_times(pair)}A12 {pair.a12:.2f}, p {_shown(pair.p_holm)}"
    numbers += " after Holm" if tests > 1 else ""
    if not pair.tells:
        least = _shown(min(1.0, tests * smallest_p(repeats, repeats)))
        need = repeats_needed(tests, ALPHA)
        few = f"{repeats} repeats are too few to tell, p is never below {least}; {need} could"
        return f"{measure.says} beside {pair.other}: {few} ({_times(pair)}A12 {pair.a12:.2f})"
    if pair.p_holm > ALPHA:
        return f"no difference shown from {pair.other} in {measure.says}: {numbers}"
    more = pair.a12 > 0.5
    kind = "" if more == measure.most else ", which is worse"
    return f"{'more' if more else 'fewer'} {measure.says} than {pair.other}: {numbers}{kind}"


def _times(pair: Pair) -> str:
    if pair.ratio is None:
        return ""
    interval = "no bound" if pair.low is None else f"{pair.low:.2g} to {pair.high:.2g}"
    return f"{pair.ratio:.2g}x ({interval}), "


def _shown(p: float) -> str:
    return "below 0.0001" if p < 0.0001 else f"{p:.2g}"
