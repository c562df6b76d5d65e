"""PolicyRunner, SceneRunner: what triage asks to roll out policy and expert."""

from collections.abc import Sequence
from typing import Protocol

from vlafuzz.model.evidence import Actions, Solver
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space


class PolicyRunner(Protocol):
    """Rolls out a policy under the conditions of a run. Nothing raises for what a scene does."""

    deterministic: bool

    @property
    def space(self) -> Space:
        """The search space with the operators of the run."""

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        """One rollout in each scene, with the runner's seed plus the scene's number."""

    def close(self) -> None:
        """Release simulator and policies."""


class SceneRunner(PolicyRunner, Protocol):
    """Runs policy and expert in the scenes of one run.

    Attributes:
        stages: the names of the task's stages.
    """

    stages: tuple[str, ...]

    def renew(self) -> None:
        """Give the next scene an environment that has seen no other."""

    def solve(self, scene: Scene, attempt: int, solver: Solver = "expert") -> Outcome:
        """One rollout of the expert or the seeing expert, in its n-th attempt."""

    def play(self, scene: Scene, actions: Actions) -> Outcome:
        """The outcome when the robot executes these actions."""
