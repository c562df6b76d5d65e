"""Arms: what is compared on worlds with planted faults, strategies with what makes causes of their failures.

- the name of a strategy that reports causes itself, such as ``causes``;
- ``random + triage``: a strategy with a share of the budget, the split, then triage of its failures with the rest. With
  ``shrinking`` instead, certificates and thresholds are free, and need not hold;
- ``random + attribution``: random scenes, then the attribution of ``causes``; with the split 0, as they come.

A strategy's runs of several budgets are one run, as far as its beginning does not depend on the budget.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import lru_cache, partial

from strategies.courses import Course, Verdict, judge, touched
from strategies.faults import World, space_of
from strategies.search import search
from strategies.triaged import Triages
from vlafuzz.search import registry
from vlafuzz.search.base import Source, Strategy, said_by
from vlafuzz.search.causes.strategy import Causes

HUNTING = "causes"
ATTRIBUTION, TRIAGE, SHRINKING = "random + attribution", "triage", "shrinking"
RANDOM_TRIAGE = f"random + {TRIAGE}"
SPLITS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7)  # shares of a budget that search takes
Setting = tuple[int, float]  # budget and split
Courses = dict[Setting, Course]
Play = Callable[[World, Sequence[Setting]], Courses]


class Later(Causes):
    """Attributes failures of random scenes only, and only once so many have been drawn."""

    def __init__(self, space: Source, seed: int, draws: int) -> None:
        super().__init__(space, seed)
        self._first, self._alone = draws, deque()
        self._draws.due = lambda asked: True  # type: ignore[method-assign]

    def _begin(self) -> None:
        if self._asked >= self._first:
            super()._begin()


def hunt(world: World, strategy: Strategy, budget: int) -> Course:
    """The course of a strategy that reports causes."""
    space, course, spent = space_of(world.task), Course(), 0
    verdicts: dict[tuple[bytes, tuple[str, ...]], Verdict] = {}
    for tried in search(space, world.evaluate, strategy, budget):
        spent += len(tried)
        course.touched.append((spent, touched(world, tried)))
        reported = [(cause.genome.tobytes(), cause.operators) for cause in said_by(strategy, "causes", ())]
        for key, cause in zip(reported, said_by(strategy, "causes", ()), strict=True):
            if key not in verdicts:
                verdicts[key] = judge(world, space.decode(cause.genome), cause.operators)
        course.report(spent, [verdicts[key] for key in reported])
    return course


def splits_of(arm: str, splits: Sequence[float]) -> Sequence[float]:
    """The splits that make a difference to an arm."""
    if arm == HUNTING:
        return (0.0,)
    return (0.0, *splits) if arm == ATTRIBUTION else splits


def arms() -> dict[str, Play]:
    """What may be compared, by name."""
    searching = [name for name in registry.STRATEGIES if name != HUNTING]
    return {
        HUNTING: partial(_hunt, HUNTING),
        ATTRIBUTION: _attribute,
        **{
            f"{name} + {kind}": partial(_triage, name, certified=kind == TRIAGE)
            for kind in (TRIAGE, SHRINKING)
            for name in searching
        },
    }


def _hunt(name: str, world: World, settings: Sequence[Setting]) -> Courses:
    longest = max(budget for budget, _ in settings)
    course = hunt(world, registry.strategy_factory(name)(space_of(world.task), world.seed, longest), longest)
    return dict.fromkeys(settings, course)


def _attribute(world: World, settings: Sequence[Setting]) -> Courses:
    """Random scenes and then attribution: settings with as many random scenes have one run."""
    draws = {setting: round(setting[0] * setting[1]) for setting in settings}
    courses = {
        number: hunt(
            world,
            Later(space_of(world.task), world.seed, number),
            max(budget for budget, split in settings if round(budget * split) == number),
        )
        for number in set(draws.values())
    }
    return {setting: courses[number] for setting, number in draws.items()}


def _triage(name: str, world: World, settings: Sequence[Setting], *, certified: bool) -> Courses:
    searched = {setting: round(setting[0] * setting[1]) for setting in settings}
    longest = max(searched.values())
    return {
        (budget, split): _triages(world, name, rollouts if name == "nsga2" else longest).course(
            split, budget, certified=certified
        )
        for (budget, split), rollouts in searched.items()
    }


@lru_cache(64)
def _triages(world: World, name: str, rollouts: int) -> Triages:
    """Of the failures of a strategy's run, shared by its arms."""
    space = space_of(world.task)
    strategy = registry.strategy_factory(name)(space, world.seed, rollouts)
    batches = search(space, world.evaluate, strategy, rollouts)
    return Triages(world, [pair for batch in batches for pair in batch])
