"""Contrast: whether a policy fails more often in one scene than in another, by a test that may stop early."""

from functools import cache
from itertools import count

import numpy as np
import scipy  # its parts are loaded when they are used
from numpy.typing import NDArray

EFFECT = 0.2  # difference of failure rates that makes a cause: smaller ones few users would act on
LEVEL = 20  # evidence that rejects: at most one true null hypothesis in twenty reaches it (Ville's inequality)
LIKELY = 0.95  # probability of an effect, given uniform rates, that a certificate takes, too
HOPELESS = 0.1  # probability of an effect, given uniform rates, below which a comparison is given up
# Failure rates that the test is made for, with and without what may be a cause, by the weight of the group: a
# policy that never fails by chance (four pairs that all differ suffice), one that does, causes that at times
# have no effect.
_GROUPS = (
    (0.35, ((0.999, 0.001),)),
    (0.40, ((0.98, 0.1), (0.98, 0.25), (0.98, 0.4))),
    (0.25, ((0.85, 0.05), (0.85, 0.2), (0.85, 0.4), (0.65, 0.05), (0.65, 0.2), (0.5, 0.05), (0.98, 0.6))),
)
_CELLS = 50  # of the grid over each rate


def shown(failures: int, without: int, pairs: int) -> bool:
    """Whether a scene is shown to fail more often than another one, and most likely by more than ``EFFECT``.

    The first part bounds the error: of scenes without any difference at most one in twenty is ever shown to have one.
    The second one leaves small differences out. Together they take half as many rollouts as rejecting every difference
    up to ``EFFECT`` would, and where a policy fails in 82 and 40 % they show that in 82 % of the cases instead of 39.

    Args:
        failures: in the first ``pairs`` rollouts of the scene.
        without: failures in as many rollouts of the scene it is compared with.
    """
    return evidence(failures, without, pairs) >= LEVEL and likely(failures, pairs, without, pairs) >= LIKELY


@cache
def missing(failures: int, without: int, pairs: int) -> int:
    """The fewest further pairs after which it may be shown: if the scene fails in all of them, and the other passes."""
    return next(more for more in count(1) if shown(failures + more, without, pairs + more))


def evidence(failures: int, without: int, pairs: int) -> float:
    """The e-value against "the scene fails no more often than the other one".

    A mixture of likelihood ratios of alternatives to the closest rates of the null hypothesis. As that is convex, the
    mixture is an e-variable: one may look at it after every pair (Turner, Grünwald 2023
    <https://doi.org/10.1016/j.spl.2023.109836>). Arguments: see ``shown``.
    """
    weights, alternatives, null = _alternatives()
    counts = np.array([failures, pairs - failures, without, pairs - without])
    ratios = np.log(alternatives) - np.log(null)
    return float(weights @ np.exp(ratios @ counts))


@cache
def likely(failures: int, of: int, without: int, of_without: int) -> float:
    """The probability that the difference is above ``EFFECT``, given uniform rates."""
    centres = (np.arange(_CELLS) + 0.5) / _CELLS
    powers = failures * np.log(centres) + (of - failures) * np.log1p(-centres)
    density = np.exp(powers - powers.max())
    below = scipy.special.betainc(without + 1, of_without - without + 1, (centres - EFFECT).clip(0))
    return float(density @ below / density.sum())


@cache
def _alternatives() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Weights ``(n,)``, alternatives and null rates ``(n, 4)``: failing and passing, with and without."""
    weighted = [(weight / len(group), pair) for weight, group in _GROUPS for pair in group]
    weights, pairs = np.array([weight for weight, _ in weighted]), [pair for _, pair in weighted]
    # For so many pairs of each, the null hypothesis's closest rate is the mean of the two.
    means = [(rate + other) / 2 for rate, other in pairs]
    alternatives = np.array([(a, 1 - a, b, 1 - b) for a, b in pairs])
    return weights, alternatives, np.array([(mean, 1 - mean, mean, 1 - mean) for mean in means])
