"""Shrink: remove from a failing scene everything that does not matter, until each operator is necessary.

What is removed becomes as in the reference: the nominal scene, or where that fails, another one that passes.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import permutations
from typing import NamedTuple, TypeVar

import numpy as np

from vlafuzz.failures.triage.contrast import EFFECT
from vlafuzz.failures.triage.oracle import LEAD, Answer, Oracle
from vlafuzz.failures.triage.path import Path, deviating, free_genes, start_values
from vlafuzz.model import Gene, Scene, Space
from vlafuzz.model.space import CONFOUNDERS

K = TypeVar("K")
SURE = 2  # rollouts that fail in a scene, before others are tried from there
_ROUNDING = 1e-12  # severities are sums of square roots
BACKGROUND = 8  # rollouts of the nominal scene where a policy may fail by chance
FREQUENT = 0.3  # share of them that fail, or rollouts of the finding that pass, from which on cheap answers would err
LEAST = 0.3  # above the background, that a failing scene is taken to fail: less than 0.2 makes no cause
SUREST = 0.98  # rate of a scene that failed whenever it was tried
NEAREST = 6  # passing scenes that are tried where the nominal one fails


class Reference(NamedTuple):
    """Where shrinking goes.

    Attributes:
        scene: that passes; None for the nominal one.
        stages: those of which none is lost there: all, or those up to the finding's.
    """

    scene: Scene | None
    stages: tuple[str, ...]


def find_reference(scene: Scene, oracle: Oracle, space: Space, passing: Iterable[Scene]) -> Reference | None:
    """The nominal scene of the same targets if it passes, else the nearest scene known to pass.

    If there is none, but the nominal scene fails at a later stage than the finding, the nominal scene serves, since
    what makes the policy fail earlier is a cause of its own. Else there is no reference: the finding has no cause.

    Args:
        passing: scenes in which the policy has passed; those of other targets are tried with the finding's.
    """
    usual = Reference(None, oracle.stages)
    nominal = space.nominal(like=scene)
    if oracle.lead > 1 and _expect_background(scene, nominal, oracle):
        return usual
    answer = oracle.answers([nominal], oracle.stages, lead=LEAD)[0]
    if answer in (Answer.PASSES, Answer.UNTRIED):
        return usual
    for candidate in _nearest(scene, space, passing)[:NEAREST]:
        if oracle.answers([candidate], oracle.stages, lead=LEAD)[0] is Answer.PASSES:
            return Reference(candidate, oracle.stages)
    if answer is not Answer.FAILS:
        return usual  # whose operators may still be reset one by one
    later = oracle.answers([nominal])[0] is Answer.PASSES
    return Reference(None, oracle.counted) if later else None


def _expect_background(scene: Scene, nominal: Scene, oracle: Oracle) -> bool:
    """Let the oracle expect failures of the nominal scene, or passes of the finding, where this has clearly more."""
    usual, found = oracle.repeated(nominal, BACKGROUND, oracle.stages), oracle.rate(scene).share
    if (usual.share < FREQUENT and found > 1 - FREQUENT) or found - usual.share < EFFECT:
        return False
    oracle.expect(usual.share, min(max(found, usual.share + LEAST), SUREST))
    return True


def _nearest(scene: Scene, space: Space, passing: Iterable[Scene]) -> Sequence[Scene]:
    """The passing scenes with the targets of another one, the most similar to it first."""
    values, place = space.values(scene), space.embed(scene)
    targets = {gene.path: values[gene.path] for gene in space.genes if gene.operator == space.subject}
    composed = set()
    for candidate in passing:
        known = space.values(candidate)
        if candidate.task == scene.task and not any(map(math.isnan, known.values())):
            composed.add(space.compose(known | targets))
    distances = {other: float(np.linalg.norm(space.embed(other) - place)) for other in composed - {scene}}
    return sorted(distances, key=lambda other: (distances[other], other.digest))


@dataclass
class Shrinker:
    """Resets in a failing scene what can be reset while it still fails; the targets' types are kept.

    The answers on the way are cheap ones: the last scene is yet to be certified.

    Attributes:
        way: failing scenes, from the finding to the last and simplest one, the ``best`` so far.
        reference: a scene of the same targets to which it is reset; None for the nominal one.
        sure: rollouts that have to fail in a scene to go on from it, see ``Oracle.holds``.
        values: reset single values, too, not operators and confounders alone.
    """

    space: Space
    oracle: Oracle
    way: list[Scene]
    reference: Scene | None = None
    sure: int = SURE
    values: bool = True

    @property
    def best(self) -> Scene:
        return self.way[-1]

    def shrink(self) -> list[Scene]:
        """Reset all operators, confounders and values that do not matter; returns the way."""
        while self._drop_operators() and self._is_blocked():
            pass  # an object that was in the way of a fair scene may be gone
        if self._is_blocked() and CONFOUNDERS in self._left():
            places = self._reset(self.space.blocking)  # what may stand in each other's way, together
            if self._fails([places])[0]:
                self._go_to(places)
        while True:
            self.drop_confounders()
            if self.values:
                self.drop_values()
            if not self._drop_operators() and not (self.values and self._make_way()):
                return self.way

    def drop_confounders(self) -> None:
        """Take away the confounders that do not matter."""
        self._drop(range(len(self.space.things(self.best))), self._without_confounders)

    def _drop_operators(self) -> bool:
        return self._drop(
            self._left(), lambda names: self._reset([operator for name in names for operator in self.space.group(name)])
        )

    def _is_blocked(self) -> bool:
        """Whether an operator is left only because the scene without it is not fair."""
        return not {None, Answer.UNFAIR}.isdisjoint(self._without_one())

    def _without_one(self) -> list[Answer | None]:
        """What the scenes without one of the operators left are known to do."""
        return [self.oracle.known(self._reset(self.space.group(name))) for name in self._left()]

    def _make_way(self) -> bool:
        """Move confounders that keep a target from its place as near as they still fail; whether any could be."""
        before = self.best
        if CONFOUNDERS in self._left() and Answer.UNFAIR in self._without_one():
            for gene in self._free(self.space.group(CONFOUNDERS)):
                path = Path(self.space, self.best, [gene], self.reference)
                passes, fails = 0, path.length
                while fails - passes > 1 and self.oracle.room:
                    middle = (passes + fails) // 2
                    passes, fails = (passes, middle) if self._fails([path.at(middle)])[0] else (middle, fails)
                self._go_to(path.at(fails))
        return self.best != before

    def drop_values(self) -> None:
        """Reset values one by one; the confounders' by operator first, as they have twenty values."""
        left = self._left()
        if CONFOUNDERS in left:
            counts = {gene.operator for gene in self.space.by_path.values() if gene.kind == "count"}
            parts = [name for name in self.space.group(CONFOUNDERS) if name not in counts]
            self._drop([name for name in parts if self._reset([name]) != self.best], self._reset)
        operators = [operator for name in left for operator in self.space.group(name)]
        genes = self._free(operators)
        self._drop([gene for gene in genes if gene.kind != "count"], self._without_values)
        for name in self._left():
            axes = self.space.axes(self.best, name, self._start)
            if len(axes) > 1:  # the one that is left says where to it has to go
                without = partial(self.space.without_axes, self.best, name, start=self._start)
                self._drop(list(axes), without)

    def _drop(self, keys: Sequence[K], without: Callable[[Sequence[K]], Scene]) -> bool:
        """Remove all keys that can go; returns whether there were any.

        Each is tried alone first, in one batch; then all that could go alone at once, else one by one, those that
        deviate least first.
        """
        failing = self._fails([without([key]) for key in keys])
        loose = [key for key, still in zip(keys, failing, strict=True) if still]
        if not loose:
            return False
        gone = list[K]()
        if self._holds(without(loose)):
            gone = loose
        elif len(loose) > 1:
            for key in sorted(loose, key=lambda key: -self._distance(without([key]))):
                if self._holds(without([*gone, key])):
                    gone.append(key)
        self._go_to(without(gone))
        return bool(gone)

    def _holds(self, scene: Scene) -> bool:
        return self._is_nearer(scene) and self.oracle.holds(scene, self.sure)

    def _fails(self, scenes: Sequence[Scene]) -> list[bool]:
        """Whether each still fails and is no farther from the reference than the best so far."""
        nearer = list(filter(self._is_nearer, scenes))
        failing = dict(zip(nearer, self.oracle.fails(nearer), strict=True))
        return [failing.get(scene, False) for scene in scenes]

    def _is_nearer(self, scene: Scene) -> bool:
        return self._distance(scene) <= self._distance(self.best) + _ROUNDING

    def _distance(self, scene: Scene) -> float:
        if self.reference is None:
            return self.space.severity(scene)
        return float(np.linalg.norm(self.space.embed(scene) - self.space.embed(self.reference)))

    def _left(self) -> list[str]:
        return deviating(self.space, self.best, self.reference)

    def _free(self, operators: Sequence[str]) -> list[Gene]:
        return free_genes(self.space, self.best, operators, self.reference)

    def _reset(self, operators: Sequence[str]) -> Scene:
        return self.space.reset(self.best, operators, self.reference)

    def _go_to(self, scene: Scene) -> None:
        if scene != self.best:
            self.way.append(scene)

    def _without_confounders(self, gone: Sequence[int]) -> Scene:
        """The scene with the other confounders moved up, reordered if they are nearer then."""
        kept = [thing for index, thing in enumerate(self.space.things(self.best)) if index not in gone]
        orders = (self.space.with_things(self.best, order) for order in permutations(kept))
        first = next(orders)
        if self._distance(first) <= self._distance(self.best):
            return first
        return min(orders, key=self._distance, default=first)

    @property
    def _start(self) -> Scene:
        return self.space.nominal(like=self.best) if self.reference is None else self.reference

    def _without_values(self, genes: Sequence[Gene]) -> Scene:
        start = start_values(self.space, self.reference)
        reset = {gene.path: start[gene.path] for gene in genes}
        return self.space.compose(self.space.values(self.best) | reset)
