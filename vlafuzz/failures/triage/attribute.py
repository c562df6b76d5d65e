"""Attribute: which operators a failure needs, and from which values on; by intervention.

A threshold is where along a path a policy starts to fail, and where beyond it passes: found by single rollouts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlafuzz.failures.mechanisms import HARDLY
from vlafuzz.failures.triage.certify import Shrunk
from vlafuzz.failures.triage.oracle import Oracle
from vlafuzz.failures.triage.path import Path, direction, free_genes, steps
from vlafuzz.model import Causes, Gene, Rate, Scene, Space, Threshold
from vlafuzz.model.evidence import Values
from vlafuzz.model.space import CONFOUNDERS

NARROW = 1  # grid step: no interval needs to be narrower,
NARROW_SHARE = 0.15  # nor than this share of the way to the scene that fails
MOST = 10  # rollouts that narrow down a crossing: with 16 or 8, as large a share of the intervals holds
FEW, SELDOM = 8, 0.25  # outcomes of a run that say how it is beyond the scene; of those there, so few pass
CLEAR = 2  # failures more than passes at one place, or the reverse, that say how it is there
_INTERVAL = (0.025, 0.975)  # 95 %
_LIKELY = (0.4, 0.6)  # the next rollouts are where the crossing is below with these probabilities
_SLACK = 0.2  # of a step, by which an interval may end beyond the step that it is rounded to
_CELLS = 240  # of the grid over the crossing
_WIDTHS = 9  # of the rise, from far less than a step to half of the path, weighted by their square roots
_SHARPEST = 0.15  # steps
# Failure rates far before the crossing, with their weights, which up to 12 rollouts in nominal scenes say where one of
# them failed; and pass rates far beyond it, with their weights. Without one of 0.4, 82 % instead of 93 % of the
# intervals held where a policy passes 30 % beyond the threshold.
_BEFORE, _SELDOM, _ENOUGH = np.array([0.01, 0.06, 0.2, 0.4, 0.6]), np.array([0.5, 0.3, 0.2, 0, 0]), 12
_BEYOND = {0.01: 0.5, 0.06: 0.25, 0.2: 0.15, 0.4: 0.1}


class Located(NamedTuple):
    """Where a path starts to fail, in its steps.

    Attributes:
        crossing: the first step at which the failure rate has risen by half; the 95 % interval of where it has goes
            from ``low`` to ``high``.
        until: the last step that is known to fail; None where nothing beyond passes.
    """

    crossing: int
    low: int
    high: int
    until: int | None


class Seen(NamedTuple):
    """Outcomes of a run in scenes in which all else that matters is as in the failing scene, or farther off.

    Attributes:
        outcomes: how far each scene is along the path, in its steps, and whether it failed.
        otherwise: failure rate of scenes that are off in the other direction, or not at all.
        spared: pass rate beyond the failing scene, where something else in a scene prevents the failure.
        usual: whether the policy failed in nominal scenes, if the path starts there.
    """

    outcomes: Sequence[tuple[float, bool]] = ()
    otherwise: float = 0.0
    spared: float = 0.0
    usual: Sequence[bool] = ()

    def suffices(self, path: Path) -> bool:
        """Whether they show that it mostly fails up to the end of the range."""
        beyond = [failed for step, failed in self.outcomes if step >= path.length]
        return len(self.outcomes) >= FEW and len(beyond) >= 2 and beyond.count(False) <= len(beyond) * SELDOM


UNSEEN = Seen()


def attribute(
    shrunk: Shrunk, oracle: Oracle, space: Space, trials: Sequence[tuple[Scene, bool]] = (), *, located: bool = False
) -> Causes:
    """The causes of a shrunk failure, from the oracle that it was shrunk with.

    Args:
        trials: scenes of the run, and whether each failed.
        located: the thresholds of this cause are known, and left out here.
    """
    left = shrunk.operators
    numeric = [name for name in left if name != CONFOUNDERS] if shrunk.minimal and not located else []
    thresholds = [_threshold(shrunk, name, oracle, space, trials) for name in numeric]
    return Causes(
        tuple(shrunk.counterparts),
        left if len(left) == 1 else (),  # of several that are all necessary none is enough
        tuple(filter(None, thresholds)),
    )


def _threshold(
    shrunk: Shrunk, name: str, oracle: Oracle, space: Space, trials: Sequence[tuple[Scene, bool]]
) -> Threshold | None:
    scene, start = shrunk.scene, shrunk.reference or space.nominal(like=shrunk.scene)
    genes = [gene for gene in free_genes(space, scene, space.group(name), start) if gene.kind != "category"]
    path = Path(space, scene, genes, start)
    first = shrunk.rates.get(name) if path.at(0) == shrunk.counterparts.get(name) else None
    nominal = trials if shrunk.reference is None else ()
    usual = [failed for each, failed in nominal if max(space.severities(each).values(), default=0.0) <= HARDLY]
    seen = _seen(shrunk, genes, start, space, trials)._replace(usual=usual)
    located = locate(path, oracle, first, shrunk.rate, seen)
    if located is None:
        return None

    def values(step: int | None) -> Values:
        at = {} if step is None else space.values(path.at(step))
        return tuple((gene.path, at[gene.path]) for gene in genes if at)

    return Threshold(
        name,
        values(located.crossing),
        located.crossing / path.length,
        low=values(located.low),
        high=values(located.high),
        direction=direction(space, scene, name, start),
        ranges=((values(located.crossing), values(located.until)),),
    )


def _seen(
    shrunk: Shrunk, genes: Sequence[Gene], start: Scene, space: Space, trials: Sequence[tuple[Scene, bool]]
) -> Seen:
    """The outcomes of a run that tell where a single number starts to make the policy fail."""
    if len(genes) != 1 or CONFOUNDERS in shrunk.operators:  # scenes with fewer confounders lack values
        return UNSEEN
    others = [one for name in shrunk.operators if name != genes[0].operator for one in space.group(name)]
    taken = free_genes(space, shrunk.scene, others, start)
    if not {gene.kind for gene in (*genes, *taken)} <= {"real", "angle"}:
        return UNSEEN
    usual = space.values(start)

    def away(scene: Scene) -> NDArray[np.float64]:
        values = space.values(scene)
        return np.array([steps(gene, usual[gene.path], values[gene.path]) for gene in (*genes, *taken)], dtype=float)

    whole, outcomes, elsewhere = away(shrunk.scene), list[tuple[float, bool]](), list[bool]()
    for scene, failed in trials:
        along, *beside = away(scene) / whole
        if along <= 0:
            elsewhere.append(failed)
        elif min(beside, default=1.0) >= 1:
            outcomes.append((along * abs(whole[0]), failed))
    beyond = [failed for step, failed in outcomes if step >= abs(whole[0])]
    return Seen(outcomes, (sum(elsewhere) + 1) / (len(elsewhere) + 2), beyond.count(False) / (len(beyond) + 2))


def locate(path: Path, oracle: Oracle, first: Rate | None, last: Rate, seen: Seen = UNSEEN) -> Located | None:
    """Find where a path to a failing scene starts to fail, by a fit to all that is known and to a few more rollouts.

    Args:
        first: failure rate of the path's first scene, which passes; None where it still has to be tried.
        last: failure rate of the scene that it leads to.

    Returns:
        None if the first scene does not pass, or there are too few rollouts left.
    """
    if not path.length or not (first or _fails(path, oracle, 0) is False):
        return None
    on = path.end == path.length or seen.suffices(path) or _fails(path, oracle, path.end) is not False
    failures, rollouts = (first.failures, first.rollouts) if first else (0, CLEAR)
    crossing = Crossing(path.length, seen.usual or [number < failures for number in range(rollouts)])
    if seen.usual or not failures:  # else they have said the rate before the crossing
        crossing.add(0, failures, rollouts)
    crossing.add(path.length, last.failures, last.rollouts)
    for far, failed in seen.outcomes:
        if far <= (path.end if on else path.length):
            crossing.add(far, int(failed), 1, seen.otherwise, seen.spared)
    if not _narrow(path, oracle, crossing):
        return None
    low, middle, high = crossing.quantiles(_INTERVAL[0], 0.5, _INTERVAL[1])
    end = min(math.ceil(high - _SLACK), path.length)
    return Located(max(math.ceil(middle), 1), math.floor(low + _SLACK), end, None if on else path.length)


def _fails(path: Path, oracle: Oracle, step: int) -> bool | None:
    """Whether the policy fails at a step; None where that cannot be judged."""
    ahead = 0
    while abs(ahead) < CLEAR:
        (fails,) = oracle.sample([path.at(step)])
        if fails is None:
            return None
        ahead += 1 if fails else -1
    return ahead > 0


def _narrow(path: Path, oracle: Oracle, crossing: Crossing) -> bool:
    """Roll out where the crossing may be, until its interval is narrow; whether there were enough rollouts left."""
    spent, unfair = 0, set[int]()
    narrow = max(NARROW, NARROW_SHARE * path.length)
    while spent < MOST:
        low, high = crossing.quantiles(*_INTERVAL)
        fair = [step for step in range(math.floor(low), math.ceil(high) + 1) if step not in unfair]
        if high - low <= narrow or not fair:
            break
        before, beyond = crossing.quantiles(*_LIKELY)
        guesses = math.floor(before), math.ceil(beyond)
        steps = sorted({min(fair, key=lambda step: abs(step - guess)) for guess in guesses})
        for step, fails in zip(steps, oracle.sample([path.at(step) for step in steps]), strict=True):
            if fails is not None:
                crossing.add(step, fails, 1)
                spent += 1
            elif not oracle.room:
                return False
            else:
                unfair.add(step)
    return True


class Crossing:
    """The posterior of the step at which the failure rate has risen by half, somewhere between 0 and ``upper``.

    The rate rises as a logistic function between two asymptotes, as in fits of psychometric functions (Kontsevich,
    Tyler 1999 <https://doi.org/10.1016/S0042-6989(98)00285-5>). Its width and both asymptotes are unknown, too, and
    integrated out on a grid; the first one is near the share of ``usual``.
    """

    def __init__(self, upper: float, usual: Sequence[bool] = ()) -> None:
        self._edges = np.linspace(0.0, upper, _CELLS + 1)
        widths = np.geomspace(_SHARPEST, max(upper / 2, 2 * _SHARPEST), _WIDTHS)
        middles = (self._edges[:-1] + self._edges[1:]) / 2
        self._middle, self._width, self._low, passing = np.meshgrid(middles, widths, _BEFORE, [*_BEYOND], indexing="ij")
        self._by_chance = self._low if any(usual) else 0 * self._low
        self._high = 1 - (1 - self._by_chance) * passing
        share = sum(usual) / max(len(usual), 1)
        before = (_BEFORE**share * (1 - _BEFORE) ** (1 - share)) ** min(len(usual), _ENOUGH) if share else _SELDOM
        self._weight = np.sqrt(self._width) * np.multiply.outer(before, [*_BEYOND.values()])
        self._weight /= self._weight.sum()

    def add(self, step: float, failures: int, rollouts: int, otherwise: float = 0.0, spared: float = 0.0) -> None:
        """Add rollouts at a step; for another reason they fail with probability ``otherwise``, or pass (``spared``)."""
        scaled = np.clip((step - self._middle) / self._width, -50.0, 50.0)
        rate = self._low + (self._high - self._low) / (1 + np.exp(-scaled))
        others = np.maximum(0.0, 1 - (1 - otherwise) / (1 - self._by_chance))  # without those that fail by chance
        rate = others + (1 - others) * (1 - spared) * rate
        self._weight *= rate**failures * (1 - rate) ** (rollouts - failures)
        self._weight /= self._weight.sum()

    def quantiles(self, *shares: float) -> list[float]:
        """Steps below which the crossing lies with these probabilities."""
        below = np.concatenate([[0.0], np.cumsum(self._weight.sum(axis=(1, 2, 3)))])
        return [float(step) for step in np.interp(shares, below / below[-1], self._edges)]
