"""Contrast: whether a policy fails more often in one scene than in another, by a test that may stop early."""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import beta

EFFECT = 0.2  # difference of failure rates that makes a cause: smaller ones few users would act on
LEVEL = 20  # evidence that rejects: at most one true null hypothesis in twenty reaches it (Ville's inequality)
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


def evidence(failures: int, without: int, pairs: int) -> float:
    """The e-value against "the difference of two failure rates is at most ``EFFECT``".

    A mixture of likelihood ratios of alternatives to the closest rates of the null hypothesis. As that is convex, the
    mixture is an e-variable: one may look at it after every pair (Turner, Grünwald 2023
    <https://doi.org/10.1016/j.spl.2023.109836>).

    Args:
        failures: in the first ``pairs`` rollouts of the scene.
        without: failures in as many rollouts of the scene it is compared with.
    """
    weights, alternatives, null = _alternatives()
    counts = np.array([failures, pairs - failures, without, pairs - without])
    ratios = np.log(alternatives) - np.log(null)
    return float(weights @ np.exp(ratios @ counts))


def likely(failures: int, of: int, without: int, of_without: int) -> float:
    """The probability that the difference is above ``EFFECT``, given uniform rates."""
    centres = (np.arange(_CELLS) + 0.5) / _CELLS
    density = beta.pdf(centres, failures + 1, of - failures + 1)
    below = beta.cdf(centres - EFFECT, without + 1, of_without - without + 1)
    return float(density @ below / density.sum())


@cache
def _alternatives() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Weights ``(n,)``, alternatives and null rates ``(n, 4)``: failing and passing, with and without."""
    weighted = [(weight / len(group), pair) for weight, group in _GROUPS for pair in group]
    weights, pairs = np.array([weight for weight, _ in weighted]), [pair for _, pair in weighted]
    nearest = [(rate + EFFECT, rate) for rate in (_nearest(*pair) for pair in pairs)]
    alternatives, null = (np.array([(a, 1 - a, b, 1 - b) for a, b in rates]) for rates in (pairs, nearest))
    return weights, alternatives, null


def _nearest(rate: float, other: float) -> float:
    """The rate without, of the null hypothesis's pair that has the least divergence from an alternative."""

    def divergence(null: float) -> float:
        likelihoods = ((rate, null + EFFECT), (1 - rate, 1 - null - EFFECT), (other, null), (1 - other, 1 - null))
        return float(-sum(weight * np.log(chance) for weight, chance in likelihoods))

    found = minimize_scalar(divergence, bounds=(1e-9, 1 - EFFECT - 1e-9), method="bounded")
    return float(found.x)
