"""Mechanisms: causes that act through one quantity of the scene are one.

A tilted camera, a lower one and a target that is nearer may all do the same: the target appears lower in the picture.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vlafuzz.common.arrays import Array, Mask
from vlafuzz.common.statistics import wilson
from vlafuzz.failures.triage.path import direction
from vlafuzz.model import Mechanism, Scene, Space, Verdict
from vlafuzz.search.base import Cause
from vlafuzz.search.causes.units import CONFOUNDERS, Units
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import Trial

# Chosen by bench_mechanisms.py with seeds that it does not report.
PENALTY = 5.0  # log likelihood that a row has to be worth: a threshold, and a choice of one in a dozen
MARGIN, ALONE = 3.0, 10.0  # by which a quantity has to be better than the rows that it replaces, or than one row
ENDS = np.linspace(0.3, 1.0, 15)  # where a row may begin, as a share of the way to its own scene
INSIDE, OUTSIDE = (6.0, 1.0), (0.5, 2.0)  # failures and passes that priors are worth: in causes, and by chance
REPEATED = 2  # rollouts of an operator alone beyond a threshold that a swap test takes
HARDLY = 0.1  # severity up to which other operators may be off
SEVERAL = 30  # scenes of which it is looked whether two operators cancel each other


@dataclass(frozen=True)
class Merged:
    """Causes that act through one quantity, by index; ``share``: of random scenes that fail by it, None without any."""

    mechanism: Mechanism
    members: tuple[int, ...]
    share: Probability | None


def mechanisms(
    space: Space, causes: Sequence[Cause], trials: Sequence[Trial], at_random: Collection[int] = ()
) -> list[Merged]:
    """The causes of a run that are one, in the order in which they were found; fewer rows explain its outcomes as well.

    Causes are merged if each one's scene lies beyond a threshold of a quantity, and no longer does so with some of its
    operators reset; and if the quantity explains the run's outcomes better than they do, by a likelihood with failures
    by chance and a penalty for each row. One alone is renamed if the quantity does so by far.

    Args:
        at_random: the proposals that are random scenes.
    """
    if not causes or not space.quantities:
        return []
    judged = (trial for trial in trials if trial.outcome.judged)
    run = _Run(space, causes, [trial for trial in judged if not trial.duplicate and trial.genome is not None])
    found, left = list[Merged](), frozenset(range(len(causes)))
    explained = np.zeros(len(run.failed), dtype=bool)
    while (best := _best(run, left, explained)) is not None:
        found.append(_merged(run, best, at_random))
        left, explained = left - set(best.members), explained | best.beyond
    return found


class _Run:
    """A run's scenes, which failed, and how far they deviate as each cause does."""

    def __init__(self, space: Space, causes: Sequence[Cause], trials: Sequence[Trial]) -> None:
        self.space, self.trials = space, trials
        self.failed = np.array([trial.outcome.verdict is Verdict.FAILED for trial in trials], dtype=bool)
        self.rows = [_Row(space, space.decode(cause.genome), cause.operators) for cause in causes]
        units = Units(space.genes)
        genomes = [trial.genome for trial in trials if trial.genome is not None]
        scenes = units.deviations(np.array([units.levels(genome) for genome in genomes]))
        own = units.deviations(np.array([units.levels(cause.genome) for cause in causes]))
        pairs = zip(causes, own, strict=True)
        self.doses = np.array([units.doses(cause.operators, scenes, one) for cause, one in pairs])

    @cached_property
    def usual(self) -> Mapping[str, float]:
        return self.space.measured(self.space.nominal())

    @cached_property
    def values(self) -> Mapping[str, Array]:
        """Measure the scenes: for each quantity, its ``(n,)`` values."""
        measured = [self.space.measured(trial.scene) for trial in self.trials]
        return {name: np.array([one[name] for one in measured]) for name in self.space.quantities}

    def ranges(self, rows: Collection[int], explained: Mask) -> Mask:
        """``(rows, n)`` which scenes lie in the range of each row, as wide as explains the outcomes best."""
        doses, ends = self.doses[list(rows)], np.full(len(rows), 1.0)
        inside = doses >= ends[:, None]
        for _ in range(2):
            for index in range(len(rows)):
                others = explained | np.delete(inside, index, axis=0).any(axis=0)
                tried = doses[index] >= ENDS[:, None]
                best = int(np.argmax(likelihood(tried | others, self.failed)))
                inside[index] = tried[best]
        return np.asarray(inside)


class _Row:
    """A cause with its scene, and what resetting each of its operators does to the quantities."""

    def __init__(self, space: Space, scene: Scene, operators: tuple[str, ...]) -> None:
        self._space, self.scene, self.operators = space, scene, operators

    @cached_property
    def here(self) -> Mapping[str, float]:
        return self._space.measured(self.scene)

    @cached_property
    def without(self) -> Mapping[str, Mapping[str, float]]:
        """The quantities of the scene with each of its operators reset."""
        return {name: self._space.measured(reset(self._space, self.scene, name)) for name in self.operators}

    def brought_by(self, name: str, sign: int, threshold: float) -> list[str]:
        """The operators without which its scene is not beyond a threshold any more; none if it never was."""
        if not sign * self.here[name] >= threshold:
            return []
        return [operator for operator, values in self.without.items() if sign * values[name] < threshold]


def reset(space: Space, scene: Scene, operator: str) -> Scene:
    """The scene with an operator, or a group of them, nominal."""
    return space.reset(scene, space.groups.get(operator, (operator,)))


def likelihood(inside: Mask, failed: Mask) -> Array:
    """``(m,)`` log likelihoods of outcomes if scenes in a range fail at one rate, and others at another, by chance.

    Both rates are unknown: it is integrated over them.

    Args:
        inside: ``(m, n)`` of each range, the scenes in it.
    """
    from scipy.special import betaln

    total = np.zeros(len(inside))
    for within, (failures, passes) in ((inside, INSIDE), (~inside, OUTSIDE)):
        failing = (within & failed).sum(axis=1)
        total += betaln(failing + failures, within.sum(axis=1) - failing + passes) - betaln(failures, passes)
    return total


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A threshold of a quantity, in the direction of a sign, and the rows that it may replace."""

    name: str
    sign: int
    threshold: float  # times the sign
    members: tuple[int, ...]
    beyond: Mask
    score: float


def _best(run: _Run, left: Collection[int], explained: Mask) -> _Candidate | None:
    """The quantity that explains the outcomes best in place of some rows; None if the rows do that better."""
    if not left:
        return None
    rows = sorted(left)
    ranges = run.ranges(rows, explained)
    plain = float(likelihood((explained | ranges.any(axis=0))[None], run.failed)[0]) - PENALTY * len(rows)
    candidates = (
        _candidate(run, name, sign, threshold, rows, ranges, explained)
        for name, quantity in run.space.quantities.items()
        for sign in (1, -1)
        for threshold in _thresholds(run, name, sign, quantity.step, rows)
    )
    margins = {True: MARGIN, False: ALONE}  # by whether there are several rows
    better = [one for one in candidates if one is not None and one.score > plain + margins[len(one.members) > 1]]
    return max(better, key=lambda one: one.score, default=None)


def _thresholds(run: _Run, name: str, sign: int, step: float, rows: Sequence[int]) -> list[float]:
    """Multiples of a step beyond the nominal value, up to the farthest cause."""
    usual = sign * run.usual[name]
    values = [sign * run.rows[row].here[name] for row in rows]
    reached = sorted(value for value in values if np.isfinite(value) and value > usual)
    if not reached:
        return []
    first = np.floor((usual if np.isfinite(usual) else reached[0] - step) / step) + 1
    return [round(float(step * number), 6) for number in np.arange(first, np.floor(reached[-1] / step) + 1)]


def _candidate(
    run: _Run, name: str, sign: int, threshold: float, rows: Sequence[int], ranges: Mask, explained: Mask
) -> _Candidate | None:
    members = [index for index, row in enumerate(rows) if run.rows[row].brought_by(name, sign, threshold)]
    if not members:
        return None
    beyond = sign * run.values[name] >= threshold
    others = [index for index in range(len(rows)) if index not in members]
    inside = explained | beyond | ranges[others].any(axis=0)
    score = float(likelihood(inside[None], run.failed)[0]) - PENALTY * (len(others) + 1)
    return _Candidate(name, sign, threshold, tuple(rows[index] for index in members), beyond, score)


def _merged(run: _Run, best: _Candidate, at_random: Collection[int]) -> Merged:
    rows = [run.rows[member] for member in best.members]
    brought = [(row.scene, name) for row in rows for name in row.brought_by(best.name, best.sign, best.threshold)]
    ways = dict.fromkeys(_way(run.space, scene, operator, best.name) for scene, operator in brought)
    swapped = _swapped(run, best, {name for _, name in brought})
    mechanism = Mechanism(best.name, best.sign * best.threshold, best.sign > 0, tuple(ways), swapped)
    drawn = np.array([trial.proposal in at_random for trial in run.trials], dtype=bool)
    failing, scenes = int((best.beyond & run.failed & drawn).sum()), int(drawn.sum())
    return Merged(mechanism, best.members, Probability(failing / scenes, *wilson(failing, scenes)) if scenes else None)


def _way(space: Space, scene: Scene, operator: str, quantity: str) -> str:
    """An operator with its direction, if it has one: of a displacement along the axis that matters most."""
    if operator not in space.groups or operator == CONFOUNDERS:
        return operator
    start, here = space.nominal(like=scene), space.measured(scene)[quantity]
    axes = space.axes(scene, operator, start)
    if len(axes) > 1:
        without = {axis: space.without_axes(scene, operator, [axis], start) for axis in axes}
        most = max(axes, key=lambda axis: abs(space.measured(without[axis])[quantity] - here))
        scene = space.without_axes(scene, operator, axes.keys() - {most}, start)
    return f"{operator} {direction(space, scene, operator, start)}"


def _swapped(run: _Run, best: _Candidate, operators: set[str]) -> bool:
    """Whether two operators, each without the other, were tried beyond the threshold, and the policy mostly failed.

    Where two of them cancel each other, it must mostly have passed.
    """
    alone = {operator: list[bool]() for operator in operators}
    for trial, beyond, failed in zip(run.trials, best.beyond, run.failed, strict=True):
        deviating = _deviating(run.space, trial.scene) & operators if beyond else set[str]()
        if len(deviating) == 1:
            alone[deviating.pop()].append(bool(failed))
    shown = [one for one in alone.values() if len(one) >= REPEATED and sum(one) > len(one) / 2]
    return len(shown) > 1 and not _fails_cancelled(run, best, operators)


def _deviating(space: Space, scene: Scene) -> set[str]:
    severities = space.severities(scene)
    groups = {**{name: (name,) for name in severities}, **space.groups}
    return {name for name, members in groups.items() if any(severities.get(each, 0) > HARDLY for each in members)}


def _fails_cancelled(run: _Run, best: _Candidate, operators: set[str]) -> bool:
    """Whether the policy mostly fails where an operator would bring the quantity about if another did not undo it."""
    outcomes = list[bool]()
    for trial, beyond, failed in zip(run.trials, best.beyond, run.failed, strict=True):
        deviating = set[str]() if beyond else _deviating(run.space, trial.scene) & operators
        if len(deviating) < 2 or len(outcomes) == SEVERAL:
            continue
        values = (run.space.measured(reset(run.space, trial.scene, name))[best.name] for name in deviating)
        if any(best.sign * value >= best.threshold for value in values):
            outcomes.append(bool(failed))
    return len(outcomes) >= REPEATED and sum(outcomes) > len(outcomes) / 2
