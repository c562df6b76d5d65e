"""Thresholds: where along a path a policy starts to fail, and where beyond it passes; by single rollouts."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from vlafuzz.failures.triage.oracle import Oracle
from vlafuzz.failures.triage.path import Path
from vlafuzz.model.evidence import Rate

PLACES = 7  # along a path, from the reference to the end of the range
NARROW = 2  # grid steps, about the width of a jitter: no interval needs to be narrower,
NARROW_SHARE = 0.15  # nor than this share of the way to the scene that fails
MOST = 12  # rollouts that narrow down a crossing, where the failure rate rises slowly
FEW, SELDOM = 8, 0.25  # outcomes of a run that make a survey superfluous; of those beyond the scene, so few pass
AGREE, DISAGREE = 5, 2  # a surprising answer stands if it comes five times before the other one comes twice
_INTERVAL = (0.025, 0.975)  # 95 %
_LIKELY = (1 / 3, 2 / 3)  # the next rollouts are where the crossing is below with these probabilities
_SLACK = 0.2  # of a step, by which an interval may end beyond the step that it is rounded to
_HALVINGS = 3  # of the gaps between failing ranges
_CELLS = 240  # of the grid over the crossing
_WIDTHS = 9  # of the rise, from far less than a step to half of the path, weighted by their square roots
_SHARPEST = 0.15  # steps
# Failure rates far before and far beyond the crossing, as distances from 0 and 1, with their weights.
_LAPSES, _WEIGHTS = (0.01, 0.06, 0.2), (0.5, 0.3, 0.2)
_MOST_BY_CHANCE = 0.5  # of the background; beyond, the rise is too small to be located


class Located(NamedTuple):
    """Where a path starts to fail, in its steps.

    Attributes:
        crossing: the first step whose failure rate is above one half; the 95 % interval of where the rate crosses one
            half goes from ``low`` to ``high``.
        ranges: the first and the last failing step of each range; no last one where nothing beyond passes.
    """

    crossing: int
    low: int
    high: int
    ranges: tuple[tuple[int, int | None], ...]


class Seen(NamedTuple):
    """Outcomes of a run in scenes in which all else that matters is as in the failing scene, or farther off.

    Attributes:
        outcomes: how far each scene is along the path, in its steps, and whether it failed.
        otherwise: failure rate of scenes that are off in the other direction, or not at all.
    """

    outcomes: Sequence[tuple[float, bool]] = ()
    otherwise: float = 0.0

    def suffices(self, path: Path) -> bool:
        """Whether they show that it mostly fails up to the end of the range."""
        beyond = [failed for step, failed in self.outcomes if step >= path.length]
        return len(self.outcomes) >= FEW and len(beyond) >= 2 and beyond.count(False) <= len(beyond) * SELDOM


UNSEEN = Seen()


def locate(path: Path, oracle: Oracle, first: Rate | None, last: Rate, seen: Seen = UNSEEN) -> Located | None:
    """Find where a path to a failing scene starts to fail.

    First there is one rollout at each of some places, up to the end of the range, unless enough was seen in the run.
    Places that pass beyond a failing one are tried again, which leaves the ranges that fail. Then rollouts near the
    crossing into the first range narrow it down.

    Args:
        first: failure rate of the path's first scene, which passes; None where it still has to be tried.
        last: failure rate of the scene that it leads to.

    Returns:
        None if the first scene does not pass, or there are too few rollouts left.
    """
    survey = _Survey(path, oracle)
    if not path.length or not (first or survey.start_passes()):
        return None
    if not seen.suffices(path):
        survey.look({round(path.end * place / PLACES) for place in range(1, PLACES + 1)} - {0, path.length})
        survey.settle()
    if survey.broke:
        return None
    survey.sharpen()
    (_, until), *others = survey.ranges()
    upper = path.length if until is None else min(until, path.length)
    crossing = Crossing(upper, first.failures / first.rollouts if first and first.rollouts else 0.0)
    known = {0: first, path.length: last}
    counts = [(step, rate.failures, rate.rollouts) for step, rate in known.items() if rate]
    counts += [(step, sum(outcomes), len(outcomes)) for step, outcomes in survey.outcomes.items()]
    for step, failures, rollouts in counts:
        if until is None or step <= until:
            crossing.add(step, failures, rollouts)
    for far, failed in seen.outcomes:
        if far <= (path.end if until is None else until):
            crossing.add(far, int(failed), 1, seen.otherwise)
    survey.narrow(crossing, upper)
    low, high = crossing.quantiles(*_INTERVAL)
    (middle,) = crossing.quantiles(0.5)
    start = max(math.ceil(middle), 1)
    return Located(start, math.floor(low + _SLACK), min(math.ceil(high - _SLACK), upper), ((start, until), *others))


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
        scaled = np.clip((step - self._middle) / self._width, -50.0, 50.0)
        rate = self._low + (self._high - self._low) / (1 + np.exp(-scaled))
        rate = otherwise + (1 - otherwise) * rate
        self._weight *= rate**failures * (1 - rate) ** (rollouts - failures)
        self._weight /= self._weight.sum()

    def quantiles(self, *shares: float) -> list[float]:
        """Steps below which the crossing lies with these probabilities."""
        below = np.concatenate([[0.0], np.cumsum(self._weight.sum(axis=(1, 2, 3)))])
        return [float(step) for step in np.interp(shares, below / below[-1], self._edges)]


class _Survey:
    """Rollouts at steps of a path.

    Attributes:
        outcomes: of the rollouts at each step: whether they failed.
        broke: there were too few rollouts left.
    """

    def __init__(self, path: Path, oracle: Oracle) -> None:
        self.path, self.oracle = path, oracle
        self.outcomes: dict[int, list[bool]] = {}
        self.unfair: set[int] = set()
        self.broke = False

    def look(self, steps: Iterable[int]) -> dict[int, bool]:
        """Roll out once at each step; whether it failed where that could be judged."""
        steps = sorted(set(steps) - self.unfair)
        answers = self.oracle.sample([self.path.at(step) for step in steps])
        judged = {step: fails for step, fails in zip(steps, answers, strict=True) if fails is not None}
        for step, fails in judged.items():
            self.outcomes.setdefault(step, []).append(fails)
        self.broke = len(judged) < len(steps) and not self.oracle.room
        if not self.broke:
            self.unfair |= set(steps) - judged.keys()
        return judged

    def start_passes(self) -> bool:
        """Roll out at the first step until it is clear whether it passes."""
        while (fails := _settled(self.outcomes.get(0, []))) is None and not self.broke and not self.unfair:
            self.look([0])
        return fails is False

    def settle(self) -> None:
        """Try again at every step that is not as a single threshold would have it."""
        while not self.broke and (open_steps := self._surprising()):
            self.look(open_steps)

    def _surprising(self) -> set[int]:
        """Steps that fail before, or pass beyond, a threshold with the fewest such steps."""
        states = self.states()
        surprises = [
            {step for step, fails in states.items() if fails != (step >= start)}
            for start in states
            if 0 < start <= self.path.length
        ]
        fewest = min(map(len, surprises))
        return {
            step
            for steps in surprises
            if len(steps) == fewest
            for step in steps
            if _settled(self.outcomes[step]) is None and step not in self.unfair
        }

    def states(self) -> dict[int, bool]:
        """Whether each step fails, in their order. The first one passes, and the scene itself fails."""
        settled = {step: _settled(outcomes) for step, outcomes in self.outcomes.items()}
        states = {step: self.outcomes[step][0] if fails is None else fails for step, fails in settled.items()}
        return dict(sorted((states | {0: False, self.path.length: True}).items()))

    def ranges(self) -> list[tuple[int, int | None]]:
        """The first and last step of each run of failing steps; no last one at the end of the path."""
        found: list[tuple[int, int | None]] = []
        start: int | None = None
        for (step, fails), (following, follows) in pairwise([*self.states().items(), (-1, False)]):
            if fails and start is None:
                start = step
            if start is not None and not follows:
                found.append((start, None if following == -1 else step))
                start = None
        return found

    def sharpen(self) -> None:
        """Halve the gaps at the ends of failing ranges, but for the first crossing."""
        for _ in range(_HALVINGS):
            gaps = [
                (before, after)
                for (before, fails), (after, follows) in pairwise(self.states().items())
                if fails != follows
            ]
            self.look((before + after) // 2 for before, after in gaps[1:] if after - before > 1)

    def narrow(self, crossing: Crossing, upper: int) -> None:
        """Roll out where the crossing may be, until its interval is narrow."""
        spent = 0
        narrow = max(min(NARROW, max(upper, 3) / 2), NARROW_SHARE * self.path.length)
        while not self.broke and spent < MOST:
            low, high = crossing.quantiles(*_INTERVAL)
            if high - low <= narrow:
                return
            nearby = range(math.floor(low), min(math.ceil(high), upper) + 1)
            fair = [step for step in nearby if step not in self.unfair]
            if not fair:
                return
            before, beyond = crossing.quantiles(*_LIKELY)
            guesses = math.floor(before), math.ceil(beyond)
            answers = self.look(min(fair, key=lambda step: abs(step - guess)) for guess in guesses)
            for step, fails in answers.items():
                crossing.add(step, fails, 1)
            spent += len(answers)


def _settled(outcomes: Sequence[bool]) -> bool | None:
    """Whether a step fails, once its first answer was given often enough or fell; None before."""
    for number in range(1, len(outcomes) + 1):
        same = outcomes[:number].count(outcomes[0])
        if same >= AGREE:
            return outcomes[0]
        if number - same >= DISAGREE:
            return not outcomes[0]
    return None
