"""Shrink: remove from a failing scene everything that does not matter, until each operator is necessary."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from typing import TypeVar

from vlafuzz.outcome import Verdict
from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.space.operators import EXTRAS, ConfounderCount, ConfounderPosition, TargetPosition
from vlafuzz.space.params import Gene
from vlafuzz.triage.oracle import BudgetedOracle, Judged
from vlafuzz.triage.path import CONFOUNDERS, GROUPS, PathToNominal, deviating, free_genes

K = TypeVar("K")
BEYOND = 2  # grid steps past its threshold at which a value stops, so that no finding sits on an edge
_ROUNDING = 1e-12  # severities are sums of square roots


@dataclass(frozen=True, kw_only=True)
class Shrunk:
    """A failing scene after shrinking.

    Attributes:
        operators: those left, the confounders' as one.
        counterparts: by operator, the scene without it, in which the policy passes.
        unresolved: operators left that have no counterpart, with the outcome of the scene without them.
        base: the nominal scene of the same objects fails, too; nothing was shrunk.
        complete: the limit on rollouts cut nothing short.
    """

    scene: Scene
    lost: str
    operators: tuple[str, ...]
    counterparts: Mapping[str, Scene] = field(default_factory=dict)
    unresolved: Mapping[str, str] = field(default_factory=dict)
    base: bool = False
    complete: bool = True

    @property
    def minimal(self) -> bool:
        """Whether every operator left is shown to be necessary."""
        return bool(self.operators) and not self.base and not self.unresolved


def shrink(scene: Scene, oracle: BudgetedOracle, space: SearchSpace) -> Shrunk:
    """Make a failing scene as nominal as possible while it still fails; the targets' types are kept."""
    nominal = space.nominal(like=scene)
    judged = oracle.ask([nominal])[0]
    if judged is not None and judged.lost is not None:
        return Shrunk(scene=nominal, lost=judged.lost, operators=(), base=True)
    shrinker = _Shrinker(space, oracle, scene)
    shrinker.run()
    return shrinker.result()


@dataclass
class _Shrinker:
    space: SearchSpace
    oracle: BudgetedOracle
    best: Scene

    def __post_init__(self) -> None:
        """Keep scenes for the last step, which shows each operator to be necessary."""
        extras = EXTRAS - set(deviating(self.space, self.best))
        self.kept = len(GROUPS.keys() - extras)

    def run(self) -> None:
        while self._drop_operators() and self._is_blocked():
            pass  # an object that was in the way of a fair scene may be gone
        if self._is_blocked():
            self._unblock()
        while True:
            before = self.best
            self._drop(range(len(self.best.confounders)), self._without_confounders)
            self._drop_values()
            for name in deviating(self.space, self.best):
                for gene in free_genes(self.space, self.best, GROUPS[name]):
                    self._lessen(gene)
            if not self._drop_operators() and (self.best == before or not self._is_blocked()):
                return

    def result(self) -> Shrunk:
        left = deviating(self.space, self.best)
        without = {name: self.space.reset(self.best, GROUPS[name]) for name in left}
        judged = dict(zip(left, self.oracle.ask(list(without.values())), strict=True))
        passing = {name for name, answer in judged.items() if answer and answer.verdict is Verdict.PASSED}
        return Shrunk(
            scene=self.best,
            lost=self.oracle.lost(self.best),
            operators=tuple(left),
            counterparts={name: without[name] for name in left if name in passing},
            unresolved={name: _outcome(answer) for name, answer in judged.items() if name not in passing},
            complete=not self.oracle.exhausted,
        )

    def _drop_operators(self) -> bool:
        return self._drop(
            deviating(self.space, self.best),
            lambda names: self._reset([operator for name in names for operator in GROUPS[name]]),
        )

    def _is_blocked(self) -> bool:
        """Whether an operator is left only because the scene without it is not fair."""
        without = [self._reset(GROUPS[name]) for name in deviating(self.space, self.best)]
        known = [self.oracle.known(scene) for scene in without]
        return any(judged is None or judged.verdict is Verdict.INVALID for judged in known)

    def _unblock(self) -> None:
        """A confounder may stand where a target belongs, and the target where that confounder does."""
        if CONFOUNDERS in deviating(self.space, self.best):
            places = self._reset([TargetPosition.name, ConfounderPosition.name])
            if self._fails([places])[0]:
                self.best = places

    def _drop_values(self) -> None:
        """Reset values one by one; the confounders' by operator first, as they have twenty values."""
        left = deviating(self.space, self.best)
        if CONFOUNDERS in left:
            parts = [name for name in GROUPS[CONFOUNDERS] if name != ConfounderCount.name]
            self._drop([name for name in parts if self._reset([name]) != self.best], self._reset)
        operators = [operator for name in left for operator in GROUPS[name]]
        genes = free_genes(self.space, self.best, operators)
        self._drop([gene for gene in genes if gene.kind != "count"], self._without_values)

    def _lessen(self, gene: Gene) -> None:
        """Move a value to two steps past the threshold of the failure."""
        path = PathToNominal(self.space, self.best, [gene])
        if gene.kind == "count" or path.length <= 1:
            return
        passes, fails = 0, path.length
        while fails - passes > 1 and self.oracle.room > self.kept:
            middle = (passes + fails) // 2
            if self._fails([path.at(middle)])[0]:
                fails = middle
            else:
                passes = middle
        beyond = min(fails + BEYOND, path.length)
        if fails - passes == 1 and self._fails([path.at(beyond)])[0]:
            fails = beyond
        self.best = path.at(fails)

    def _drop(self, keys: Sequence[K], without: Callable[[Sequence[K]], Scene]) -> bool:
        """Remove all keys that can go; returns whether there were any.

        Each is tried alone first, in one batch; then all that could go alone at once, else one by one.
        """
        failing = self._fails([without([key]) for key in keys])
        loose = [key for key, still in zip(keys, failing, strict=True) if still]
        if not loose:
            return False
        gone = loose
        if not self._fails([without(loose)])[0]:
            gone = loose[:1]
            for key in loose[1:]:
                if self._fails([without([*gone, key])])[0]:
                    gone.append(key)
        self.best = without(gone)
        return True

    def _fails(self, scenes: Sequence[Scene]) -> list[bool]:
        """Whether each still fails and is no more severe than the best so far."""
        severity = self.space.severity(self.best) + _ROUNDING
        milder = [scene for scene in scenes if self.space.severity(scene) <= severity]
        failing = dict(zip(milder, self.oracle.fails(milder, self.kept), strict=True))
        return [failing.get(scene, False) for scene in scenes]

    def _reset(self, operators: Sequence[str]) -> Scene:
        return self.space.reset(self.best, operators)

    def _without_confounders(self, gone: Sequence[int]) -> Scene:
        """The scene with the other confounders moved up, reordered if that makes it more severe."""
        kept = [placed for index, placed in enumerate(self.best.confounders) if index not in gone]
        orders = (replace(self.best, confounders=order) for order in permutations(kept))
        severity, first = self.space.severity(self.best), next(orders)
        if self.space.severity(first) <= severity:
            return first
        return min(orders, key=self.space.severity, default=first)

    def _without_values(self, genes: Sequence[Gene]) -> Scene:
        nominal = {gene.path: gene.grid.nominal for gene in genes}
        return self.space.composer.compose(self.space.values(self.best) | nominal)


def _outcome(judged: Judged | None) -> str:
    """The outcome of a scene that did not pass, in words."""
    if judged is None:
        return "was not tried"
    unjudged = {Verdict.INVALID: "is not fair", Verdict.ERROR: "crashed"}
    return unjudged.get(judged.verdict, f"fails at {judged.lost}" if judged.lost else "fails at times")
