#!/usr/bin/env python
"""How often the 95 % intervals of paired runs contain the truth, beside a bootstrap of SciPy's.

For each kind of values and number of pairs: the percentage of intervals that contain the true mean of ours, mean
ratio of means, and of bootstrapped intervals of the ratio; then, of both intervals of the ratio, the median width
(high / low) and the percentage without bounds. One without bounds contains the truth.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.statistics import Estimate, mean_estimate, mean_ratio

Vector = NDArray[np.float64]
Random = np.random.Generator
Shape = tuple[int, int]
Draw = Callable[[Random, Shape], Any]


def _poisson(mean: float) -> Draw:
    return lambda rng, shape: rng.poisson(mean, shape)


def _normal(mean: float, spread: float) -> Draw:
    return lambda rng, shape: np.maximum(rng.normal(mean, spread, shape), 0)


def _lognormal(scale: float, sigma: float) -> Draw:
    return lambda rng, shape: scale * rng.lognormal(0, sigma, shape)


def _geometric(mean: float) -> Draw:
    return lambda rng, shape: rng.geometric(1 / mean, shape)


def _binomial(of: int, share: float) -> Draw:
    return lambda rng, shape: rng.binomial(of, share, shape)


def _often_zero(share: float) -> Draw:
    return lambda rng, shape: (rng.random(shape) < share) * (1 + rng.poisson(4, shape))


# Ours, theirs, and whether a factor that differs from seed to seed is common to both.
KINDS: dict[str, tuple[Draw, Draw, bool]] = {
    "normal, spread 10 %": (_normal(200, 20), _normal(100, 10), False),
    "normal, common factor": (_normal(200, 20), _normal(100, 10), True),
    "counts of 4.5 and 3": (_poisson(4.5), _poisson(3), False),
    "counts, common factor": (_poisson(15), _poisson(10), True),
    "counts of 30 and 15": (_poisson(30), _poisson(15), False),
    "counts of 40 and 2": (_poisson(40), _poisson(2), False),
    "faults, 7.8 and 6.8 of 8": (_binomial(8, 0.97), _binomial(8, 0.85), False),
    "ties, 2.2 and 1.5 of 3": (_binomial(3, 0.75), _binomial(3, 0.5), False),
    "zeros, 25 and 50 %": (_often_zero(0.75), _often_zero(0.5), False),
    "zeros, 50 and 75 %": (_often_zero(0.5), _often_zero(0.25), False),
    "waiting, 10 and 5": (_geometric(10), _geometric(5), False),
    "waiting 50, normal 100": (_geometric(50), _normal(100, 10), False),
    "lognormal, sigma 0.5": (_lognormal(1.5, 0.5), _lognormal(1, 0.5), False),
    "lognormal, sigma 1": (_lognormal(1.5, 1), _lognormal(1, 1), False),
}


def pairs(kind: str, rng: Random, shape: Shape) -> tuple[Vector, Vector]:
    """Values of ours and theirs, for many samples (rows) of some pairs."""
    ours, theirs, common = KINDS[kind]
    factor = rng.gamma(16, 1 / 16, shape) if common else 1.0
    return ours(rng, shape) * factor, theirs(rng, shape) * factor


def bootstrapped(ours: Vector, theirs: Vector, method: str) -> list[Estimate]:
    """Ratios of the means, with SciPy's intervals over pairs."""
    from scipy.stats import bootstrap

    def ratio(mine: Vector, other: Vector, axis: int = -1) -> Vector:
        means = mine.mean(axis=axis), np.maximum(other.mean(axis=axis), 1e-9)
        return np.asarray(means[0] / means[1], np.float64)

    known = bootstrap(
        (ours, theirs), ratio, paired=True, axis=-1, n_resamples=1000, batch=50, method=method, rng=1
    ).confidence_interval
    return [Estimate(*row) for row in zip(ratio(ours, theirs), known.low, known.high, strict=True)]


def coverage(estimates: list[Estimate | None], truth: float) -> float:
    """The percentage that contains the true value, or has no bounds."""
    return 100 - 100 * float(np.mean([_wrong(estimate, truth) for estimate in estimates]))


def _wrong(estimate: Estimate | None, truth: float) -> bool:
    if estimate is None or estimate.low is None or estimate.high is None:
        return False
    return not estimate.low - 1e-9 <= truth <= estimate.high + 1e-9


def width(estimates: list[Estimate | None]) -> str:
    """Median of high / low, and the percentage without bounds."""
    known = [e.high / e.low if e and e.low and e.high and e.high < 1e6 else np.inf for e in estimates]
    return f"{np.median(known):8.2f}{100 * np.mean(np.isinf(known)):6.1f}"


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--samples", type=int, default=4000)
    parser.add_argument("--pairs", nargs="+", type=int, default=[5, 8, 20])
    parser.add_argument("--bootstrap", default="percentile", choices=["percentile", "basic", "BCa"])
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    titles = ("mean", "ratio", options.bootstrap)
    print(f"{'':26}{'pairs':>6}" + "".join(f"{title:>11}" for title in titles) + "   widths, without bounds")
    for number, kind in enumerate(KINDS):
        many, others = (float(values.mean()) for values in pairs(kind, np.random.default_rng(0), (10**6, 1)))
        for size in options.pairs:
            rng = np.random.default_rng([options.seed, number, size])
            ours, theirs = pairs(kind, rng, (options.samples, size))
            ratios = [mean_ratio(*row) for row in zip(ours.tolist(), theirs.tolist(), strict=True)]
            booted = bootstrapped(ours, theirs, options.bootstrap)
            shares = (
                coverage([mean_estimate(row) for row in ours.tolist()], many),
                coverage(ratios, many / others),
                coverage(list(booted), many / others),
            )
            numbers = "".join(f"{share:11.1f}" for share in shares)
            print(f"{kind:26}{size:6}{numbers} {width(ratios)} {width(list(booted))}", flush=True)


if __name__ == "__main__":
    main()
