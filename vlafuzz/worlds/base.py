"""World, what a place must offer where policies are tested: tasks, scenes, an evaluator, an expert."""

# ruff: noqa: B027 - a world need not do what is empty here

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

from vlafuzz.common.arrays import Array
from vlafuzz.common.check import Check
from vlafuzz.common.watch import Watch
from vlafuzz.errors import UsageError
from vlafuzz.model import Conditions, Rejection, Scene, Setting, Solver, Space, Task
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, Policy, PolicySpec
from vlafuzz.policies.clients.model import Interface, Written
from vlafuzz.worlds.evaluator import SceneEvaluator
from vlafuzz.worlds.events import STAY, STOP
from vlafuzz.worlds.recording import Recording


class TryingPolicy(Policy, Protocol):
    """A policy that solves scenes from the simulator's state; ``attempt`` changes how it goes about it."""

    attempt: int


class Demonstrator(TryingPolicy, Protocol):
    """An expert that solves scenes with the actions of the policy that it stands in for.

    ``tries``: number of its attempts; the present ``attempt`` is below it. ``written``: the actions of the last
    rollout, as the policy writes them.
    """

    tries: int
    written: list[Written]


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A robot of a world, by its name.

    ``control_hz``: control steps a second; None for as many as the policy wants. ``seconds``: of simulated time, after
    which a rollout ends.
    """

    robot: str
    control_hz: int | None = None
    seconds: int = 16


@dataclass(frozen=True, kw_only=True)
class SceneMap:
    """Two values of a scene that are a place, drawn from above.

    ``across``: path of the value that goes to the right, or to the left if ``mirrored``. ``along``: of the one that
    goes up. ``below``: what is beyond the lower edge, such as the robot.
    """

    title: str
    across: str
    along: str
    mirrored: bool = False
    below: str = ""


@dataclass(frozen=True, kw_only=True)
class Prompt:
    """The words that a task tells a policy, and those with which they are compared; empty where they are unknown.

    Attributes:
        things: in its scene; ``wanted``: those that its goal moves.
        goal: what success is, the same text for the same success.
    """

    task: str
    words: str
    things: tuple[str, ...] = ()
    wanted: tuple[str, ...] = ()
    goal: str


Acting = Callable[[Observation], Array]  # gives actions (7,)


class Scripted(ABC):
    """A policy that is a script, which acts in each rollout by itself. Once told to stop, it stands still."""

    def __init__(self, spec: PolicySpec) -> None:
        self.spec = spec
        self._acting: dict[str, Acting] = {}
        self._last: dict[str, Array] = {}

    @abstractmethod
    def begin(self, start: EpisodeStart) -> Acting:
        """Begin a rollout; returns what gives its actions."""

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        for start in episodes:
            self._acting[start.episode], self._last[start.episode] = self.begin(start), STAY

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        for seen in observations:
            told, last = seen.instruction == STOP, self._last[seen.episode]
            self._last[seen.episode] = last * STAY if told else self._acting[seen.episode](seen)
        return [ActionChunk(self._last[seen.episode][None]) for seen in observations]

    def close(self) -> None:
        self._acting.clear()


Judge = Callable[[Scene], Rejection | None]  # why a scene is not fair; None if it is


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
    def simulator(self) -> str:
        """Packages with their versions, which decide physics and pictures."""
        return ""

    def renderer(self) -> str:
        """The device and driver that draw its pictures here, with versions; empty if they are not known."""
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
        """The policy that is tested where nobody names one; a UsageError if there is none."""
        raise UsageError("this world has no default policy", hint="--policy python:pkg.mod:factory")

    def preload(self) -> None:
        """Import what its evaluators need, for workers that are forked from this process."""

    def conditions_of(self, scene: Scene) -> Mapping[str, Any]:
        """The fields of ``Conditions``, by name, under which a scene from a file can be run."""
        return {}

    def check_pictures(self) -> None:
        """Raise a PrerequisiteError if no pictures can be drawn here."""

    def maps(self, task: str) -> Sequence[SceneMap]:
        """The maps of a report: which values of a task's scenes are places."""
        return ()

    @abstractmethod
    def space(
        self, task: str, robot: str, operators: str | None = None, vary: Sequence[str] = (), packs: Sequence[Any] = ()
    ) -> Space:
        """The scenes of a task.

        Args:
            operators: a file of ranges, or the name of a shipped one; None for those that fit the robot.
            vary: operators that vary; empty for all that the file varies.
            packs: of objects, as the world opens them.

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
        """The evaluator of a policy; a UsageError if the policy asks for what this world does not have."""

    @abstractmethod
    def solvers(self) -> Mapping[Solver, TryingPolicy]:
        """The experts, by name."""

    def demonstrator(self, interface: Interface) -> Demonstrator:
        """An expert in the place of a policy with this interface."""
        raise UsageError("this world has no demonstrations", hint="leave them out")

    # What only some worlds have, for the commands that are about it.

    def machine(self) -> Iterable[Check]:
        """Check that this machine has what the world needs; some checks take seconds."""
        return ()

    def open_packs(self, folders: Sequence[str], watch: Watch) -> tuple[Any, ...]:
        """The packs of objects in these folders.

        Raises:
            UsageError: a folder is no pack and has none in it, or this world takes none.
            CatalogueError: a mesh is damaged.
        """
        raise UsageError(f"--pack {folders[0]}: this world takes no packs of objects", hint="leave it out")

    def listed_objects(self, packs: Sequence[Any]) -> list[dict[str, Any]]:
        """Its objects, or those of packs, as rows: metres, kilograms, and poses with their narrowest grasps."""
        return []

    def listed_operators(
        self, source: str | None, task: str | None, robot: str | None, packs: Sequence[Any]
    ) -> tuple[str, list[dict[str, str]], list[str]]:
        """The operators of a file: a title, a row for each, the tasks with ranges of their own; errors as of a run."""
        raise UsageError("the operators of this world are not listed", hint="its page or its class says what varies")

    def judge(self, packs: Sequence[Any], *, settle: bool) -> Judge:
        """A judge of scenes, for which no policy is needed; ``settle``: with physics, which takes longer."""
        raise UsageError("this world checks its scenes when they are run", hint="`vlafuzz run --scenes`")

    def suite(self, name: str) -> Sequence[str]:
        """The tasks of a suite, in order: those that the world lists for ``all``, none where there is no such suite."""
        return tuple(self.tasks) if name == "all" else ()

    def prompts(self, suite: str = "") -> Iterable[Prompt]:
        """Return what tasks tell a policy in nominal scenes: those of a suite, the one of that name, or all."""
        for task in [suite] if suite else self.tasks:
            scene = self.space(task, next(iter(self.robots))).nominal()
            yield Prompt(task=task, words=scene.instruction, goal=task)

    def imported(self, path: Path) -> Sequence[Scene]:
        """The scenes of another program's file; a SceneError if it is no such file."""
        raise UsageError(f"{path}: this world reads no files of other programs", hint="export scenes of a store")
