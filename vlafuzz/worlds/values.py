"""Worlds whose scenes are values by name: all that a simulator of one's own needs to be fuzzed.

A world names the values that its reset takes with their ranges, and says how a rollout goes on::

    class Corridor(ValuesWorld):
        tasks = ("walk",)
        parameters = (Parameter("length", 2.0, 9.0, nominal=3.0, step=0.5),)
        ...

``vlafuzz run --world python:corridor:Corridor --policy python:corridor:walk`` finds out what breaks a policy.
"""

from __future__ import annotations

import hashlib
import json
from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, Self, TypeVar, Unpack, cast

import numpy as np

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.errors import PrerequisiteError, StoreError, UsageError, suggestion
from vlafuzz.model import Conditions, Monitor, Rejection, Scene, Solver, Space, Stage, Task
from vlafuzz.model.conditions import check_choice
from vlafuzz.model.space import Values
from vlafuzz.policies.base import Observation, Policy
from vlafuzz.worlds import world_of
from vlafuzz.worlds.base import Robot, TryingPolicy, World
from vlafuzz.worlds.episode import Episode
from vlafuzz.worlds.evaluator import Options, SceneEvaluator
from vlafuzz.worlds.parameters import PREFIX, Parameter, Parameters, Value, operators_of

ROBOT = "own"  # the only one of such a world
REDRAWS = 200  # scenes that are drawn for a fair one
State = TypeVar("State")


class _Composer:
    def __init__(self, world: ValuesWorld[Any], task: str) -> None:
        self._world, self._task = world, task
        self.genes = tuple(parameter.gene for parameter in world.parameters)

    def compose(self, values: Mapping[str, float]) -> Scene:
        told = {one.name: one.told(values[PREFIX + one.name]) for one in self._world.parameters}
        return self._world.scene(self._task, told)

    def values(self, scene: Scene) -> Values:
        known = dict(scene.values)
        return {PREFIX + one.name: one.number(known.get(one.name)) for one in self._world.parameters}


class ValuesSpace(Space):
    """The scenes of a task whose values are drawn evenly, each for itself."""

    def __init__(self, world: ValuesWorld[Any], name: str, operators: Parameters) -> None:
        self._world = world
        self.groups = {name: (name,) for name in operators.operators}
        super().__init__(world.task(name), ROBOT, operators, _Composer(world, name))

    def __reduce__(self) -> tuple[Any, ...]:  # a world's stages may be functions without a name, which no pipe takes
        return _again, (self.task.name, self.operators)

    @property
    def conditions(self) -> dict[str, Any]:
        assert isinstance(self.operators, Parameters)
        world = {setting.name: setting.default for setting in self._world.settings}
        return {"operators": self.operators.to_json(), "operators_digest": self.operators.digest, "world": world}

    def sample(self, rng: np.random.Generator) -> Scene:
        problem = None
        for _ in range(REDRAWS):
            scene = self.compose({path: self.draw(path, rng) for path in self.by_path})
            if (problem := self._world.unfair(self._world.values_in(scene))) is None:
                return scene
        raise UsageError(f"{self.task.name}: no fair scene in {REDRAWS}: {problem}", hint="narrow the ranges")

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        return scene if self._world.unfair(self._world.values_in(scene)) is None else None

    def jittered(self, scene: Scene, number: int) -> Scene:
        """Change the numbers that vary by less than half a step, within their ranges."""
        rng = np.random.default_rng([int(scene.digest, 16), number])
        values = self.values(scene)
        for one in self._world.parameters:
            if not one.options and one.kind != "integer" and one.operator in self.operators.varied:
                path = PREFIX + one.name
                moved = values[path] + one.step * float(rng.uniform(-0.5, 0.5))
                values[path] = min(max(moved, one.low), one.high)
        return self.compose(values)


def _again(task: str, operators: Parameters) -> ValuesSpace:
    return ValuesSpace(cast(ValuesWorld[Any], world_of(task)), task, operators)


class ValuesEpisode(Episode):
    """A rollout in a scene of values; ``cameras`` are names of pictures that the policy asks for."""

    def __init__(
        self, world: ValuesWorld[Any], scene: Scene, seed: int, conditions: Conditions, cameras: Collection[str]
    ) -> None:
        self._world, self.state, self._cameras = world, world.reset(world.values_in(scene), seed), cameras
        self._step, self._fingerprint, self._ended = world.step, world.fingerprint, world.ended  # looked up once
        self.states_hash = hashlib.blake2b(digest_size=16)
        monitor, horizon = Monitor(tuple(world.stages)), 0 if world.ended(self.state) else world.horizon
        super().__init__(scene, seed, conditions, monitor, hz=world.control_hz, horizon=horizon)

    def observe(self) -> Observation:
        return Observation(
            self.start.episode,
            len(self.actions),
            self.scene.instruction,
            images={camera: self.picture(camera) for camera in self._cameras},
            state=np.array(self._world.observe(self.state), dtype=np.float32),
            privileged=self.state,
        )

    def picture(self, camera: str) -> Picture:
        drawn = self._world.picture(self.state)
        if drawn is None:
            raise PrerequisiteError("this world draws no pictures", hint="define its method picture")
        return drawn

    def _execute(self, action: Array) -> None:
        self.state = state = self._step(self.state, action)
        self.states_hash.update(self._fingerprint(state))
        self.monitor.observe(state)
        if self._ended(state):
            self._last = len(self.actions)


class ValuesEvaluator(SceneEvaluator):
    """Runs a policy in scenes of values; what is kept between two of them, the world decides."""

    def __init__(
        self, world: ValuesWorld[Any], conditions: Conditions, policy: Policy, **options: Unpack[Options]
    ) -> None:
        self._task = world.task(conditions.task)
        self._world = world.opened(own_name(conditions.task))
        self._cameras = [camera.name for camera in policy.spec.cameras]
        super().__init__(conditions, policy, self._task.stage_names, **options)

    def check(self, scene: Scene) -> Rejection | None:
        if scene.task != self._task.name or dict(scene.values).keys() != self._world.named.keys():
            return Rejection("semantic", f"it is no scene of {self._task.name}")
        problem = self._world.unfair(self._world.values_in(scene))
        return Rejection("geometry", problem) if problem else None

    def begin(self, scene: Scene, seed: int) -> Episode:
        return ValuesEpisode(self._world, scene, seed, self._conditions, self._cameras)

    def renew(self) -> None:
        self._world.close()


def own_name(task: str) -> str:
    """A task's name as its world has it, without the world's."""
    return task.rpartition("/")[2]


class ValuesWorld(World, Generic[State]):
    """A world whose scenes are values by name. A subclass says what they are, and how a rollout goes.

    ``GymWorld`` is one whose rollouts happen in an environment of gymnasium.

    Actions are the policy's seven numbers, of which the world uses as many of the first ones as it needs, or as many as
    ``action_width`` and the policy's ``ActionSpec`` say.

    ``tasks``: their names; ``parameters``: the values that a reset takes, in all of them. ``stages``: milestones by the
    state, the last one success. ``horizon``: control steps after which a rollout ends; ``control_hz``: in a second.
    """

    robots = (ROBOT,)
    tasks: Sequence[str]
    parameters: Sequence[Parameter]
    stages: Sequence[Stage]
    horizon: int
    control_hz: int = 10

    @abstractmethod
    def reset(self, values: Mapping[str, Value], seed: int) -> State:
        """The state at the start of a rollout: the same for the same values and seed."""

    @abstractmethod
    def step(self, state: State, action: Array) -> State:
        """The state after a control step; ``action``: ``(action_width,)``."""

    @abstractmethod
    def observe(self, state: State) -> Any:
        """The numbers that the policy sees, as ``Observation.state``."""

    def ended(self, state: State) -> bool:
        """Whether a rollout cannot go on, before the horizon."""
        return False

    def instruction(self, task: str, values: Mapping[str, Value]) -> str:
        """The instruction for the policy."""
        return task.replace("-", " ")

    def unfair(self, values: Mapping[str, Value]) -> str | None:
        """Why nobody could solve a scene; None if it is fair."""
        return None

    def picture(self, state: State) -> Picture | None:
        """``(height, width, 3)``; None where there are no pictures."""
        return None

    def expert(self) -> TryingPolicy | None:
        """A policy that solves scenes by the state, ``Observation.privileged``, if there is one."""
        return None

    # What the checks of a world ask, ``vlafuzz.worlds.soundness``, and what keeps a simulator between scenes.

    def applied(self, state: State) -> Mapping[str, Value]:
        """The values that the simulator has, read back from it, as far as it can tell them."""
        return {}

    def own_start(self, seed: int) -> State | None:
        """The simulator's own start, which the nominal scene should equal; None if it has none."""
        return None

    def some_action(self, rng: np.random.Generator) -> Array:
        """A random action, ``(action_width,)``."""
        return rng.uniform(-1, 1, self.action_width)

    def fingerprint(self, state: State) -> bytes:
        """A fingerprint that is equal for states that are seen equal, bit for bit."""
        return np.asarray(self.observe(state), dtype=np.float64).tobytes()

    def opened(self, task: str) -> Self:
        """The world for one rollout at a time in a task, with a simulator of its own if it keeps one."""
        return self

    def close(self) -> None:
        """Release the simulator; the next reset makes a new one."""

    # What follows is the protocol ``World``.

    @cached_property
    def named(self) -> dict[str, Parameter]:
        return {one.name: one for one in self.parameters}

    @property
    def nominal_values(self) -> dict[str, Value]:
        """The values of the nominal scene, by name."""
        return {one.name: one.told(one.number(None)) for one in self.parameters}

    def scene(self, task: str, values: Mapping[str, Value]) -> Scene:
        """The scene of a task with these values."""
        told = tuple(sorted(values.items()))
        return Scene(task, (), self.instruction(own_name(task), values), robot=ROBOT, values=told)

    def values_in(self, scene: Scene) -> dict[str, Value]:
        """The values of a scene by name: of a stored one whole numbers again, which its file has as ``2.0``."""
        whole = {one.name for one in self.parameters if one.kind == "integer"}
        return {name: int(value) if name in whole else value for name, value in scene.values}

    def has(self, task: str) -> bool:
        return own_name(task) in self.tasks

    def task(self, name: str) -> Task:
        if not self.has(name):
            raise UsageError(f"no task {name!r}", hint=suggestion(name, self.tasks))
        return Task(name, 0, tuple(self.stages))

    def robot(self, name: str) -> Robot:
        return Robot(robot=ROBOT, control_hz=self.control_hz, seconds=-(-self.horizon // self.control_hz))

    def conditions_of(self, scene: Scene) -> dict[str, Any]:
        return self._space(scene.task, operators_of(self.parameters)).conditions

    def space(
        self, task: str, robot: str, operators: str | None = None, vary: Sequence[str] = (), packs: Sequence[Any] = ()
    ) -> ValuesSpace:
        if operators is not None:
            problem = f"--operators {operators}: this world names its ranges itself"
            raise UsageError(problem, hint="--vary says which of them vary")
        known = operators_of(self.parameters)
        for name in vary:
            check_choice("operator", name, known)
        return self._space(task, vary or known)

    def stored_space(self, source: Path, conditions: Conditions, vary: Collection[str] | None = None) -> ValuesSpace:
        stored = json.loads(conditions.operators)
        now = self._space(conditions.task, stored.get("varied", ()))
        if json.loads(now.conditions["operators"])["operators"] != stored.get("operators"):
            hint = "use the version of the world that began the run"
            raise StoreError(f"{source}: the parameters of {conditions.task} were others", hint=hint)
        return now if vary is None else self._space(conditions.task, vary)

    def evaluator(
        self, conditions: Conditions, policy: Policy, space: Space | None, **options: Unpack[Options]
    ) -> SceneEvaluator:
        return ValuesEvaluator(self, conditions, policy, **options)

    def solvers(self) -> Mapping[Solver, TryingPolicy]:
        expert = self.expert()
        return {"expert": expert} if expert else {}

    def _space(self, task: str, vary: Collection[str]) -> ValuesSpace:
        return ValuesSpace(self, task, Parameters(self.named, frozenset(vary) & operators_of(self.parameters).keys()))
