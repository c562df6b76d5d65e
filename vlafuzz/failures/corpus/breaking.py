"""Which of several checkpoints broke first, as probabilities, from their outcomes in the same scenes.

In a scene, all working checkpoints pass with the same probability, as the baseline does. Over scenes, this
probability has a beta distribution, anything from "the same in every scene" to "always or never". A broken
checkpoint passes less often in every scene, by a factor of its own, and loses at least 15 points on average.
All checkpoints before the first broken one work, and none after it does.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln, logsumexp

Floats = NDArray[np.float64]

LOSS = 0.15  # of the pass rate, at least
FACTORS = np.arange(10) / 9  # between that and everything, of a broken checkpoint
ALIKE = (
    0.1,
    1.0,
    10.0,
    100.0,
)  # concentrations of the beta distribution: from "always or never" to "the same"
RATES = (np.arange(9) + 0.5) / 9  # quantiles of the pass rate, given the baseline's outcomes


def first_broken(baseline: Floats, outcomes: Floats) -> Floats:
    """The probability of each checkpoint to be the first broken one, given that the last one is broken.

    Args:
        baseline: 1 where the baseline passed, 0 where it failed, NaN where that is not known: (scenes,).
        outcomes: likewise those of the checkpoints, in order: (checkpoints, scenes).

    Returns:
        Probabilities whose sum is 1, before the data equal: (checkpoints,).
    """
    ran = [row for row in range(len(outcomes)) if not np.isnan(outcomes[row]).all()]
    patterns, counts = np.unique(
        np.nan_to_num(np.vstack([baseline, outcomes[ran]]), nan=-1.0), axis=1, return_counts=True
    )
    rates = _rates(int((baseline == 1).sum()), int((baseline == 0).sum()))
    # Outcomes do not distinguish the checkpoints between two that were run.
    working = np.searchsorted(ran, np.arange(len(outcomes)))
    by_working = {int(number): _log_likelihood(patterns, counts, number, rates) for number in set(working)}
    logs = np.array([by_working[int(number)] for number in working])
    return np.asarray(np.exp(logs - logsumexp(logs)), dtype=np.float64)


@cache
def _rates(passed: int, failed: int) -> Floats:
    """Equally likely values of the mean pass rate of what works (Jeffreys' prior)."""
    from scipy.stats import beta

    return np.asarray(beta.ppf(RATES, passed + 0.5, failed + 0.5), dtype=np.float64)


def _log_likelihood(patterns: Floats, counts: NDArray[np.int64], working: int, rates: Floats) -> float:
    """Of the outcomes of the checkpoints given the baseline's, if the first ``working`` of them work.

    Args:
        patterns: distinct columns of outcomes, the baseline's first, -1 where not run; ``counts``: how often.
    """
    good, bad = patterns[: working + 1], patterns[working + 1 :]
    concentrations = np.array(ALIKE)[:, None, None]
    a, b = concentrations * rates[:, None], concentrations * (1 - rates[:, None])  # (alike, rates, 1)
    passes, fails = (good == 1).sum(0), (good == 0).sum(0)
    alone = betaln(a + (good[0] == 1), b + (good[0] == 0))
    together = ((betaln(a + passes, b + fails) - alone) * counts).sum(-1)  # (alike, rates)
    if len(bad):
        expected = (a + passes) / (a + b + passes + fails)
        least = np.minimum(LOSS / rates, 1.0)[:, None]  # as a fraction of the passes
        kept = (1 - least) * FACTORS[:, None, None, None]
        together = together + sum(_lossy(row, counts, kept * expected + 1e-9) for row in bad)
    return float(logsumexp(together))


def _lossy(row: Floats, counts: NDArray[np.int64], passing: Floats) -> Floats:
    """Log-likelihood of a broken checkpoint's outcomes, the mean over its possible losses.

    Args:
        passing: how often it is expected to pass, for each loss.
    """
    logs = np.where(row == 1, np.log(passing), np.where(row == 0, np.log1p(-passing), 0.0))
    return np.asarray(logsumexp((logs * counts).sum(-1), axis=0) - np.log(len(FACTORS)), dtype=np.float64)


def likeliest(probabilities: Sequence[float], share: float) -> tuple[int, ...]:
    """The fewest checkpoints, by index, that have this share of the probability; the likeliest first."""
    order = np.argsort(-np.asarray(probabilities), kind="stable")
    enough = int(np.searchsorted(np.cumsum(np.asarray(probabilities)[order]), share - 1e-12)) + 1
    return tuple(int(index) for index in order[:enough])
