"""World, what a place must offer where policies are tested: tasks, scenes, an evaluator, an expert."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Protocol

from vlafuzz.conditions.conditions import Conditions
from vlafuzz.evidence import Solver
from vlafuzz.objects import Catalogue
from vlafuzz.policies.base import Policy
from vlafuzz.scene import Scene
from vlafuzz.sim.evaluator import SceneEvaluator
from vlafuzz.space import OperatorSet, SearchSpace
from vlafuzz.tasks.base import Task

if TYPE_CHECKING:
    from vlafuzz.clients.interface import Interface, Written
    from vlafuzz.sim.recording import Recording


class TryingPolicy(Policy, Protocol):
    """A policy that solves scenes from the simulator's state; ``attempt`` changes how it goes about it."""

    attempt: int


class Demonstrator(Policy, Protocol):
    """An expert that solves scenes with the actions of the policy that it stands in for.

    Attributes:
        tries: number of its attempts.
        attempt: the present one, below ``tries``.
        written: the actions of the last rollout, as the policy writes them.
    """

    tries: int
    attempt: int
    written: list[Written]


class Stills(Protocol):
    """Takes pictures of scenes before anything moves."""

    def png(self, scene: Scene) -> bytes:
        """A picture of a valid scene by the third-person camera; PrerequisiteError without a renderer."""

    def close(self) -> None:
        """Release the renderer."""


class World(Protocol):
    """A simulator with its tasks. Scenes, strategies, triage and stores are the same in all of them."""

    @property
    def robots(self) -> Collection[str]:
        """Names of its rigs, the default one first."""

    @property
    def simulator(self) -> str:
        """Packages with their versions, which decide physics and pictures."""

    def renderer(self) -> str:
        """What draws its pictures here, with versions; empty if that is not known."""

    def task(self, name: str) -> Task:
        """The task of that name; a UsageError or SceneError if there is none."""

    def default_policy(self, robot: str) -> str:
        """What is tested where nobody names a policy; a UsageError if there is none."""

    def check_pictures(self) -> None:
        """Raise a PrerequisiteError if no pictures can be drawn here."""

    def space(self, operators: OperatorSet, catalogue: Catalogue, task: str, robot: str) -> SearchSpace:
        """The scenes of a task that the operators can make; a UsageError if it lacks one that varies."""

    def evaluator(
        self,
        conditions: Conditions,
        policy: Policy,
        catalogue: Catalogue,
        *,
        recording: Recording | None,
        checked: bool,
    ) -> SceneEvaluator:
        """What runs a policy in scenes; a UsageError if the policy asks for what this world does not have."""

    def solvers(self) -> Mapping[Solver, TryingPolicy]:
        """The experts, by name."""

    def demonstrator(self, interface: Interface) -> Demonstrator:
        """An expert in the place of a policy with this interface."""

    def stills(self, conditions: Conditions, catalogue: Catalogue) -> Stills:
        """What takes pictures of scenes of a task."""
