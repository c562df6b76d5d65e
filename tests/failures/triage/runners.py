"""A desk without a simulator: a planted policy, an expert that solves all but some scenes, and stores of findings."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from unittest import mock

import numpy as np

from tests.doubles import ClosedForm, begun, ended, failed, passed
from tests.failures.triage.planted import SPACE, STAGES, Condition, Planted
from vlafuzz.failures.triage.pipeline import triage
from vlafuzz.failures.triage.triager import Triager, Unjudged
from vlafuzz.model import Outcome, Scene, Verdict
from vlafuzz.rollouts import crew as crew  # which takes the real runner by its name, before tests replace that
from vlafuzz.store.records import Finding, Triaged
from vlafuzz.store.store import Store


class PlantedRunner:
    """The policy fails where all conditions hold; a stochastic one with the given rate, else rarely.

    ``solvable`` says of a scene whether the expert solves it.
    """

    space, stages, changed, elsewhere = SPACE, STAGES, (), ""

    def __init__(self, conditions: Sequence[Condition], rate: float | None = None, solvable=lambda scene: True) -> None:
        self._planted, self._rate, self._solvable = Planted(conditions), rate, solvable
        self._rng = np.random.default_rng(0)
        self.deterministic = rate is None
        self.policy_rollouts = self.expert_rollouts = self.closed = 0

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        return [self._outcome(scene) for scene in scenes]

    def solve(self, scene: Scene, grasp: int, solver: str = "expert") -> Outcome:
        self.expert_rollouts += 1
        return passed() if self._solvable(scene) else failed()

    def play(self, scene: Scene, actions: np.ndarray) -> Outcome:
        return self.solve(scene, 0)

    def close(self) -> None:
        self.closed += 1

    def _outcome(self, scene: Scene) -> Outcome:
        if self._planted.judged(scene).verdict is Verdict.INVALID:
            return Outcome.invalid("geometry", "too close")
        self.policy_rollouts += 1
        fails = self._planted.fails(scene)
        if self._rate is not None:
            fails = self._rng.random() < (self._rate if fails else 0.05)
        return failed() if fails else passed()


@contextmanager
def interrupted(number: int = 2) -> Iterator[None]:
    """Ctrl-C when triage begins its n-th finding."""
    begun, own = count(1), Triager.triage

    def counted(self: Triager, finding: Finding) -> Triaged | Unjudged:
        if next(begun) == number:
            raise KeyboardInterrupt
        return own(self, finding)

    with mock.patch.object(Triager, "triage", counted):
        yield


class PlantedEvaluator(ClosedForm):
    """The policy of ``PlantedRunner`` in a run."""

    def __init__(self, conditions: Sequence[Condition]) -> None:
        super().__init__()
        self._policy = PlantedRunner(conditions)

    def outcome(self, scene: Scene) -> Outcome:
        return self._policy.evaluate([scene], [0])[0]


def scenes(conditions: Sequence[Condition], number: int) -> list[Scene]:
    return [Planted(conditions).finding(seed) for seed in range(number)]


def fill(store: Store, failing: Sequence[Scene], cells: Sequence[str] = ()) -> Store:
    """A run in which these scenes fail, each in a cell of its own unless cells are given."""
    named = cells or [f"cell {proposal}" for proposal in range(len(failing))]
    begun(store, *(ended(scene, None, *of) for scene, of in zip(failing, enumerate(named), strict=True)))
    return store


def triaged(store: Store, runner: PlantedRunner, **options: int) -> list[Triaged]:
    triage(store, lambda run: runner, **options)
    return store.triaged()
