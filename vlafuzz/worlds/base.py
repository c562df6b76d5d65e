"""World, what a place must offer where policies are tested: tasks, scenes, an evaluator, an expert."""

# ruff: noqa: B027 - a world need not do what is empty here

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

from vlafuzz.errors import UsageError
from vlafuzz.model.conditions import Conditions, Setting
from vlafuzz.model.evidence import Solver
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.model.task import Task
from vlafuzz.policies.base import ActionSpec, Policy
from vlafuzz.policies.clients.model import Interface, Written
from vlafuzz.worlds.evaluator import SceneEvaluator
from vlafuzz.worlds.recording import Recording


class TryingPolicy(Policy, Protocol):
    """A policy that solves scenes from the simulator's state; ``attempt`` changes how it goes about it."""

    attempt: int


class Demonstrator(TryingPolicy, Protocol):
    """An expert that solves scenes with the actions of the policy that it stands in for.

    Attributes:
        tries: number of its attempts; the present ``attempt`` is below it.
        written: the actions of the last rollout, as the policy writes them.
    """

    tries: int
    written: list[Written]


@dataclass(frozen=True, kw_only=True)
class Robot:
    """What acts in the scenes of a world.

    Attributes:
        robot: its name.
        control_hz: control steps a second; None for as many as the policy wants.
        seconds: of simulated time, after which a rollout ends.
    """

    robot: str
    control_hz: int | None = None
    seconds: int = 16


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """The scenes that a user wants of a world.

    Attributes:
        operators: a file of ranges, or the name of a shipped one; None for those that fit the robot. vary: operators
        that vary; empty for all that the file varies.
        packs: of objects, as the world opens them.
    """

    task: str
    robot: str
    operators: str | None = None
    vary: Sequence[str] = ()
    packs: Sequence[Any] = ()


@dataclass(frozen=True, kw_only=True)
class SceneMap:
    """Two values of a scene that are a place, drawn from above.

    Attributes:
        across: path of the value that goes to the right, or to the left if ``mirrored``.
        along: path of the value that goes up.
        below: what is beyond the lower edge, such as the robot.
    """

    title: str
    across: str
    along: str
    mirrored: bool = False
    below: str = ""


class World(ABC):
    """A simulator with its tasks. Strategies, triage, reports and stores are the same in all of them.

    Attributes:
        usual: whether it is meant where nobody names a world: one of those that come with vlafuzz. tasks: names of its
        tasks, the default one first; of a world with many those of a first choice. robots: names of its robots, the
        default one first.
        policies: those that come with the world, by name, described by their docstrings' first sentences. action_width:
        how many numbers an action has; 7 are a hand's motion and a gripper, see ``ActionSpec``. settings: conditions of
        its own, which decide outcomes beside the scene.
    """

    usual: bool = False
    tasks: Collection[str]
    robots: Collection[str]
    policies: ClassVar[Mapping[str, Callable[..., Policy]]] = {}
    action_width: int = ActionSpec().width
    settings: Sequence[Setting[Any]] = ()

    @property
    def objects(self) -> Collection[str]:
        """Names of the objects that its scenes may have."""
        return ()

    @property
    def simulator(self) -> str:
        """Packages with their versions, which decide physics and pictures."""
        return ""

    def renderer(self) -> str:
        """What draws its pictures here, with versions; empty if that is not known."""
        return ""

    @abstractmethod
    def has(self, task: str) -> bool:
        """Whether a name is one of its tasks'."""

    @abstractmethod
    def task(self, name: str) -> Task:
        """The task of that name; a UsageError or SceneError if there is none."""

    @abstractmethod
    def robot(self, name: str) -> Robot:
        """The robot of that name; a UsageError if there is none."""

    def default_policy(self, robot: str) -> str:
        """What is tested where nobody names a policy; a UsageError if there is none."""
        raise UsageError("this world has no default policy", hint="--policy python:pkg.mod:factory")

    def begin_early(self, policy: str | None) -> None:
        """Begin in the background what takes seconds and this policy is likely to need; None: the default."""

    def preload(self) -> None:
        """Import what its evaluators need, for workers that are forked from this process."""

    def conditions_of(self, scene: Scene) -> Mapping[str, Any]:
        """What a scene from a file takes to be run: fields of ``Conditions`` by name."""
        return {}

    def check_pictures(self) -> None:
        """Raise a PrerequisiteError if no pictures can be drawn here."""

    def maps(self, task: str) -> Sequence[SceneMap]:
        """Which values of a task's scenes are places, for maps in a report."""
        return ()

    @abstractmethod
    def space(self, wanted: Wanted) -> Space:
        """The scenes of a task.

        Raises:
            CatalogueError: the file of operators is wrong.
            UsageError: an operator has nothing to vary there, or the robot's files are missing.
        """

    @abstractmethod
    def stored_space(self, source: Path, conditions: Conditions, vary: Collection[str] | None = None) -> Space:
        """The space that ``Space.conditions`` describes; ``source`` is the store or corpus, for messages.

        Args:
            vary: other operators to vary than then.

        Raises:
            StoreError: another version wrote it, with other operators.
            UsageError: an object pack is gone.
        """

    @abstractmethod
    def evaluator(
        self, conditions: Conditions, policy: Policy, space: Space | None, *, recording: Recording | None, checked: bool
    ) -> SceneEvaluator:
        """What runs a policy in scenes; a UsageError if the policy asks for what this world does not have."""

    @abstractmethod
    def solvers(self) -> Mapping[Solver, TryingPolicy]:
        """The experts, by name."""

    def demonstrator(self, interface: Interface) -> Demonstrator:
        """An expert in the place of a policy with this interface."""
        raise UsageError("this world has no demonstrations", hint="leave them out")
