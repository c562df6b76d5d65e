"""Strategies against a reference, measure by measure: effect, interval, corrected p-value, and a sentence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from vlafuzz.common.statistics import (
    Estimate,
    SignedRank,
    holm,
    mean_difference,
    mean_ratio,
    pairs_needed,
    signed_rank,
    smallest_p,
)
from vlafuzz.lab.compare.figures import Figures

ALPHA = 0.05


@dataclass(frozen=True)
class Measure:
    """A figure by which strategies are compared, in words, and whether more is better."""

    says: str
    most: bool = True
    more: str = "more"
    fewer: str = "fewer"


# In the order in which they judge. All else is shown, not tested: each test costs the others of their power.
MEASURES = {
    "causes": Measure("certified causes"),
    "failures": Measure("failures"),
    "probability_width": Measure("interval of the failure probability", most=False, more="wider", fewer="narrower"),
}


@dataclass(frozen=True, kw_only=True)
class Pair:
    """One strategy against another in one measure; the n-th runs of both have the same seed and are a pair.

    Attributes:
        ratio, difference: of the means, with 95 % intervals; None where undefined.
        p_holm: corrected over all ``tests`` that are shown together.
    """

    strategy: str
    other: str
    measure: str
    ratio: Estimate | None
    difference: Estimate | None
    test: SignedRank
    repeats: int
    p_holm: float = 1.0
    tests: int = 1
    verdict: str = ""

    @property
    def tells(self) -> bool:
        """Whether so few repeats could show a difference at all."""
        return self.tests * smallest_p(self.repeats) <= ALPHA


def against(runs: Mapping[str, Sequence[Figures]], reference: str) -> list[Pair]:
    """Compare every strategy with the reference in every measure that all runs of both have.

    Args:
        runs: by strategy, its runs in the order of their seeds.
    """
    pairs = []
    for measure in MEASURES:
        theirs = [run[measure] for run in runs[reference]]
        for name in runs:
            ours = [run[measure] for run in runs[name]]
            if name == reference or None in (*ours, *theirs):
                continue
            pair = Pair(
                strategy=name,
                other=reference,
                measure=measure,
                ratio=mean_ratio(ours, theirs),
                difference=mean_difference(ours, theirs),
                test=signed_rank(ours, theirs),
                repeats=len(ours),
            )
            pairs.append(pair)
    return corrected(pairs)


def corrected(pairs: Sequence[Pair]) -> list[Pair]:
    """All pairs that are shown together, with Holm's correction for as many tests, and verdicts."""
    adjusted = holm([pair.test.p for pair in pairs])
    pairs = [replace(pair, p_holm=p, tests=len(pairs)) for pair, p in zip(pairs, adjusted, strict=True)]
    return [replace(pair, verdict=_sentence(pair)) for pair in pairs]


def _sentence(pair: Pair) -> str:
    measure = MEASURES[pair.measure]
    more, fewer = f"{measure.more} in {pair.test.more}", f"{measure.fewer} in {pair.test.fewer}"
    size = f"{_size(pair)}{more} and {fewer} of {pair.repeats} pairs"
    if not pair.tells:
        least, need = min(1.0, pair.tests * smallest_p(pair.repeats)), pairs_needed(pair.tests, ALPHA)
        few = f"{pair.repeats} repeats are too few to tell, p is never below {_shown(least)}; {need} could"
        return f"{measure.says} beside {pair.other}: {few} ({size})"
    numbers = f"{size}, p {_shown(pair.p_holm)} after Holm over {pair.tests} tests"
    if pair.p_holm > ALPHA:
        return f"no difference shown from {pair.other} in {measure.says}: {numbers}"
    larger = pair.test.effect > 0
    kind = "" if larger == measure.most else ", which is worse"
    word = measure.more if larger else measure.fewer
    return f"{word} {measure.says} than {pair.other}: {numbers}{kind}"


def _size(pair: Pair) -> str:
    """The ratio of the means; their difference where the ratio has no bounds."""
    ratio, difference = pair.ratio, pair.difference
    if ratio and ratio.low is not None:
        return f"{ratio.value:.2g}x ({ratio.low:.2g} to {ratio.high:.2g}), "
    return f"mean difference {difference}, " if difference else ""


def _shown(p: float) -> str:
    return "below 0.0001" if p < 0.0001 else f"{p:.2g}"
