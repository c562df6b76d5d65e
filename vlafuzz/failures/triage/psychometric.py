"""Crossing: where along a path a failure rate crosses one half, from single rollouts at chosen steps."""

import numpy as np
from numpy.typing import NDArray

_CELLS = 240  # of the grid over the crossing
_WIDTHS = 9  # of the rise, from far less than a step to half of the path, weighted by their square roots
_SHARPEST = 0.15  # steps
# Failure rates far before and far beyond the crossing, as distances from 0 and 1, with their weights.
_LAPSES, _WEIGHTS = (0.01, 0.06, 0.2), (0.5, 0.3, 0.2)
_MOST_BY_CHANCE = 0.5  # of the background; beyond, the rise is too small to be located


class Crossing:
    """The posterior of the step at which the failure rate is one half, somewhere between 0 and ``upper``.

    The rate rises as a logistic function between two asymptotes, as in fits of psychometric functions (Kontsevich,
    Tyler 1999 <https://doi.org/10.1016/S0042-6989(98)00285-5>). Its width and both asymptotes are unknown, too, and
    integrated out on a grid. Where a policy fails by chance, it is half the rise.

    Args:
        background: failure rate at the beginning.
    """

    def __init__(self, upper: float, background: float = 0.0) -> None:
        edges = np.linspace(0.0, upper, _CELLS + 1)
        widths = np.geomspace(_SHARPEST, max(upper / 2, 2 * _SHARPEST), _WIDTHS)
        chance = min(background, _MOST_BY_CHANCE) if background > max(_LAPSES) else 0.0
        low, high = chance + (1 - chance) * np.array(_LAPSES), 1 - np.array(_LAPSES)
        self._edges = edges
        centres, self._width, self._low, self._high = np.meshgrid(
            (edges[:-1] + edges[1:]) / 2, widths, low, high, indexing="ij"
        )
        half = (max(0.5, chance + (1 - chance) / 2) - self._low) / (self._high - self._low)  # of the rise
        self._middle = centres - self._width * np.log(half / (1 - half))
        self._weight = np.sqrt(self._width) * np.multiply.outer(_WEIGHTS, _WEIGHTS)
        self._weight /= self._weight.sum()

    def add(self, step: float, failures: int, rollouts: int, otherwise: float = 0.0) -> None:
        """Take the outcomes of rollouts at one step into account.

        Args:
            otherwise: probability that such a rollout fails for another reason.
        """
        rate = self._low + (self._high - self._low) / (1 + np.exp(-self._scaled(step)))
        rate = otherwise + (1 - otherwise) * rate
        self._weight *= rate**failures * (1 - rate) ** (rollouts - failures)
        self._weight /= self._weight.sum()

    def quantiles(self, *shares: float) -> list[float]:
        """Steps below which the crossing lies with these probabilities."""
        below = np.concatenate([[0.0], np.cumsum(self._weight.sum(axis=(1, 2, 3)))])
        return [float(step) for step in np.interp(shares, below / below[-1], self._edges)]

    def _scaled(self, step: float) -> NDArray[np.float64]:
        scaled: NDArray[np.float64] = np.clip((step - self._middle) / self._width, -50.0, 50.0)
        return scaled
