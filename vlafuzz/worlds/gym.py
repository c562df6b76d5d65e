"""Any environment of gymnasium as a world: a file of parameters, and a class that says what they change.

``class Pole(GymWorld)`` is enough for ``vlafuzz run --world python:pole:Pole --policy python:pole:push``.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import metadata
from math import prod
from struct import Struct
from typing import Any, Self

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.common.plugins import PREFIX
from vlafuzz.errors import PolicyError, PrerequisiteError, UsageError, VlafuzzError
from vlafuzz.model import Stage
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.harness import WIDTH, BlamedOn, check_chunks
from vlafuzz.worlds import world_named
from vlafuzz.worlds.base import TryingPolicy
from vlafuzz.worlds.parameters import Parameter as Parameter, Value, read_parameters as read_parameters
from vlafuzz.worlds.values import ValuesSpace, ValuesWorld, own_name

Env = gymnasium.Env[Any, Any]
SUCCESS = ("success", "is_success")  # keys of an info, by convention
_packed = Struct("dd").pack  # reward and end
_TRUTHS = (float, bool, np.bool_)  # that need no look at several


@dataclass(slots=True, eq=False)  # not frozen, since one is made at each step: that would take four times as long
class Now:
    """A moment of a rollout: what ``reset`` or the last ``step`` of the environment returned.

    ``values``: of the scene. ``seed``: of the rollout. ``steps``: control steps so far.
    """

    env: Env
    task: str
    values: Mapping[str, Value]
    seed: int
    observation: Any
    info: Mapping[str, Any]
    reward: float = 0.0
    terminated: bool = False
    truncated: bool = False
    steps: int = 0


class GymWorld(ValuesWorld[Now]):
    """A world whose rollouts happen in an environment of gymnasium.

    A subclass has ``tasks``, ``parameters`` and ``make``, and may have the other methods of the first part.
    Stages other than success alone are ``Stage``s by the ``Now``.

    ``fresh``: make a new environment for every rollout, for one that keeps something over its reset. ``has_own_start``:
    whether the nominal scene is to equal the environment's own start. ``packages``: distributions whose versions decide
    outcomes, besides gymnasium and the environment's.
    """

    fresh: bool = False
    has_own_start: bool = True
    packages: Sequence[str] = ()
    _task: str = ""
    _env: Env | None = None
    _usual: Mapping[str, Any]

    def make(self, task: str) -> Env:
        """The environment of a task; with ``render_mode="rgb_array"`` for pictures."""
        raise UsageError(f"{type(self).__name__} makes no environment", hint="define make(task)")

    def apply(self, env: Env, values: Mapping[str, Value]) -> None:
        """Set the values without ``sets`` in an environment before its reset, which also gets all as ``options``.

        Those with ``sets`` are set before, by attributes, indices and names: ``model/body/cube/mass`` is
        ``model.body("cube").mass``. With the unit × they multiply what the environment had when it was made.
        """

    def start(self, env: Env, values: Mapping[str, Value], seed: int) -> tuple[Any, Mapping[str, Any]]:
        """Reset an environment to a scene, as ``env.reset`` does; here is what has to be set after it."""
        self.apply(env, values)
        return env.reset(seed=seed, options=dict(values))

    def applied(self, now: Now) -> Mapping[str, Value]:
        """The values read back from the environment: by default of the parameters that have ``sets``."""
        told = dict[str, Value]()
        for one in (one for one in self.parameters if one.sets):
            usual, there = np.ravel(self._usual[one.sets[0]]), np.ravel(_read(now.env, one.sets[0]))
            first = np.argmax(usual != 0)  # of several numbers, one that a factor changes
            number = there[first].item()
            told[one.name] = number / usual[first] if one.unit == "×" else number
        return told

    def success(self, now: Now) -> bool:
        """Whether the task is solved; by default what ``info`` says."""
        for key in SUCCESS:
            if key in now.info:
                said = now.info[key]
                return bool(said if type(said) in _TRUTHS else np.all(np.asarray(said)))
        if now.steps == 0:
            return False
        problem = f"{type(self).__name__}: the environment's info has neither {' nor '.join(SUCCESS)}"
        raise PrerequisiteError(problem, hint="define success(now)")

    def progress(self, now: Now) -> float:
        """How near success is, in [0, 1]; search profits from it."""
        return 0.0

    def picture(self, state: Now) -> Picture | None:
        """``(height, width, 3)``, by default what the environment renders if it was made with a ``render_mode``."""
        drawn = state.env.render() if state.env.render_mode else None
        return None if drawn is None else np.asarray(drawn, dtype=np.uint8)

    def solve(self, now: Now) -> Any:
        """The expert's next action, or several, one a row; without an expert no failure is shown to be solvable."""
        return None

    @classmethod
    def policy(cls, act: Any, *, name: str = "", deterministic: bool = True) -> Callable[[], "GymPolicy"]:
        """A factory of a policy of this world, for ``--policy python:module:NAME``; also as a decorator.

        Args:
            act: a function of an observation; or a class without arguments, or an object, with a method ``act``
                that is one. A method ``reset(seed)`` is called where a rollout begins.
            deterministic: the same observations and seed always give the same actions.
        """
        known = name or getattr(act, "__name__", "own")

        def make() -> GymPolicy:
            world, made = cls._here(), act() if isinstance(act, type) else act
            answer, spec = getattr(made, "act", made), world._spec(known, state=True, deterministic=deterministic)
            return GymPolicy(world, spec, answer, getattr(made, "reset", None))

        return make

    # What follows is ``ValuesWorld``.

    @cached_property
    def stages(self) -> Sequence[Stage]:  # type: ignore[override]
        return (Stage("success", self.success, self.progress, steps=1),)

    @cached_property
    def horizon(self) -> int:  # type: ignore[override]
        spec = self._kept.spec
        if spec is None or spec.max_episode_steps is None:
            problem = f"{type(self).__name__}: the environment has no limit of steps"
            raise UsageError(problem, hint="horizon = …: control steps after which a rollout ends")
        return int(spec.max_episode_steps)

    @cached_property
    def space_of_actions(self) -> spaces.Space[Any]:
        """The environment's; a UsageError if it is none of arrays or whole numbers."""
        space = self._kept.action_space
        if not isinstance(space, spaces.Box | spaces.Discrete | spaces.MultiDiscrete | spaces.MultiBinary):
            problem = f"{type(self).__name__}: actions of {type(space).__name__} are not supported"
            raise UsageError(problem, hint="gymnasium.wrappers.TransformAction makes an array of them")
        return space

    @cached_property
    def action_width(self) -> int:  # type: ignore[override]
        """How many numbers an action has; one more than seven, which would be a hand's motion."""
        width = prod(self.space_of_actions.shape or ())
        return width + 1 if width == WIDTH else width

    @cached_property
    def simulator(self) -> str:
        module = type(self._kept.unwrapped).__module__.partition(".")[0]
        named = [one.name for one in metadata.distributions(name=module)]  # the list of all takes half a second
        found = (named or metadata.packages_distributions().get(module) or [])[:1]
        names = dict.fromkeys(["gymnasium", *found, *self.packages])
        try:
            return ", ".join(f"{name} {metadata.version(name)}" for name in names)
        except metadata.PackageNotFoundError as missing:
            raise PrerequisiteError(f"there is no package {missing.name}", hint=f"pip install {missing.name}") from None

    def reset(self, values: Mapping[str, Value], seed: int) -> Now:
        env = self._ready()
        for one in self.parameters:  # here, so that no override of apply or start can leave it out
            for path in one.sets:
                _write(env, path, values[one.name] * self._usual[path] if one.unit == "×" else values[one.name])
        return Now(env, self._name, values, seed, *self.start(env, values, seed))

    def own_start(self, seed: int) -> Now | None:
        if not self.has_own_start:
            return None
        env = self._ready()
        return Now(env, self._name, {}, seed, *env.reset(seed=seed))

    def step(self, state: Now, action: ArrayLike) -> Now:
        shape, dtype, low, high = self._row
        if type(action) is np.ndarray and action.shape == shape:  # most are
            fitting: Any = action.copy() if action.dtype is dtype else action.astype(dtype)
            for number in fitting.tolist():  # so few are compared faster by Python than by NumPy
                if not low <= number <= high:
                    fitting = fitted(self.space_of_actions, action)
                    break
        else:
            fitting = fitted(self.space_of_actions, np.asarray(action))
        env, task, values, seed, steps = state.env, state.task, state.values, state.seed, state.steps + 1
        seen, reward, terminated, truncated, info = env.step(fitting)
        return Now(env, task, values, seed, seen, info, float(reward), bool(terminated), bool(truncated), steps)

    def observe(self, state: Now) -> Array:
        """All numbers of the observation, pictures left out."""
        if type(seen := state.observation) is np.ndarray and seen.ndim == 1:
            return seen
        numbers = [part.ravel() for part in _leaves(seen) if part.ndim < 2 or part.dtype != np.uint8]
        return numbers[0] if len(numbers) == 1 else np.concatenate([np.zeros(0), *numbers])

    def fingerprint(self, state: Now) -> bytes:
        seen, end = state.observation, _packed(state.reward, state.terminated)
        if type(seen) is np.ndarray:  # most are, and each step counts
            return seen.tobytes() + end
        return b"".join([*map(np.ndarray.tobytes, _leaves(seen)), end])

    def ended(self, state: Now) -> bool:
        return state.terminated or state.truncated

    def expert(self) -> TryingPolicy | None:
        if type(self).solve is GymWorld.solve:
            return None
        return GymPolicy(self, self._spec("expert", privileged=True, execute=None), self.solve)

    def some_action(self, rng: np.random.Generator) -> Array:
        self.space_of_actions.seed(int(rng.integers(2**31)))
        return np.asarray(self.space_of_actions.sample(), dtype=np.float64).ravel()

    def opened(self, task: str) -> Self:
        """The same world with an environment of its own; the first gets the one by which the spaces were read."""
        own = copy(self)
        own._task = task
        (self if task == self._name else own)._env = None
        return own

    def close(self) -> None:
        if self._env is not None:
            self._env.close()
            self._env = None

    @cached_property
    def _row(self) -> tuple[tuple[int, ...] | None, np.dtype[Any] | None, float, float]:
        """Shape, type and common bounds of an action that is a row of bounded numbers; nothing of others."""
        space = self.space_of_actions
        if type(space) is not spaces.Box or space.shape != (self.action_width,) or not space.is_bounded():
            return None, None, 0.0, 0.0
        return space.shape, space.dtype, float(space.low.max()), float(space.high.min())

    @classmethod
    def _here(cls) -> Self:
        """The world of this class that is loaded, whose environment tells the spaces, too; else another one."""
        with suppress(VlafuzzError):  # such as that the class is none of a module
            if type(world := world_named(f"{PREFIX}{cls.__module__}:{cls.__qualname__}")) is cls:
                return world
        return cls()

    def space(self, task: str, *about: Any, **options: Any) -> ValuesSpace:
        made = super().space(task, *about, **options)
        self._task = self._task or own_name(task)  # by whose environment the spaces are read
        return made

    def _spec(self, name: str, **about: Any) -> PolicySpec:
        return PolicySpec(name, action=ActionSpec(width=self.action_width), **about)

    @property
    def _name(self) -> str:
        return self._task or self.tasks[0]

    @property
    def _kept(self) -> Env:
        """The environment that is there, or else made."""
        if self._env is None:
            self._env = env = self.make(self._name)
            self._usual = {path: copy(_read(env, path)) for one in self.parameters for path in one.sets}
        return self._env

    def _ready(self) -> Env:
        if self.fresh:
            self.close()
        return self._kept


def _read(env: Env, path: str) -> Any:
    """Look up what an environment has at a path, see ``GymWorld.apply``."""
    held: Any = env
    try:
        for name in path.split("/"):
            if isinstance(held, np.ndarray):
                held = held[int(name)]
            elif isinstance(held, gymnasium.Env):
                held = held.get_wrapper_attr(name)
            else:
                held = held(name) if callable(held) else getattr(held, name)
    except (AttributeError, KeyError, ValueError, IndexError, TypeError) as error:
        problem = f"sets: {path}: the environment has none: {error}"
        raise UsageError(problem, hint="attributes, indices and names, such as model/body/cube/mass") from None
    return held


def _write(env: Env, path: str, value: Any) -> None:
    way, _, last = path.rpartition("/")
    held, now = _read(env, way) if way else env, _read(env, path)
    if isinstance(now, np.ndarray):
        now[...] = value
    elif isinstance(held, np.ndarray):
        held[int(last)] = value
    else:
        getattr(held, "set_wrapper_attr", partial(setattr, held))(last, value)


def fitted(space: spaces.Space[Any], action: Array) -> Any:
    """An action in its space; a PolicyError says in a sentence why it does not fit."""
    size = prod(space.shape or ())
    if action.size == WIDTH + 1 == size + 1:
        action = action[:WIDTH]
    if action.size == size:
        shaped = action.astype(space.dtype).reshape(space.shape or ())
        real = isinstance(space, spaces.Box)
        fitting = shaped if real or space.shape else shaped[()]
        if (real or (shaped.ravel() == action).all()) and space.contains(fitting):
            return fitting
    problem = f"does not fit {space}" if np.isfinite(action).all() else "is not finite"
    shown = np.array2string(action, precision=3, threshold=8)
    raise PolicyError(f"the action {shown} {problem}", "clip it, or look at its unit", "bad_action")


class GymPolicy:
    """Acts by the observation where its spec asks for the ``state``, else by the ``Now``; ``begin`` gets each seed."""

    attempt = 0

    def __init__(
        self, world: GymWorld, spec: PolicySpec, act: Callable[[Any], Any], begin: Callable[[int], Any] | None = None
    ) -> None:
        self.spec, self._world, self._act, self._begin = spec, world, act, begin
        self._row, self._blamed = world._row[:2], BlamedOn(spec.name)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        for episode in episodes:
            if self._begin is not None:
                self._begin(episode.seed)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(np.array(self.by_state(seen.privileged))) for seen in observations]

    def by_state(self, now: Now) -> Sequence[Array]:
        """The next actions to execute. Without an observation around the state it takes a third of the time."""
        world, spec = self._world, self.spec
        try:
            given = self._act(now.observation if spec.state else now)
            if type(given) is np.ndarray and (given.shape, given.dtype) == self._row:
                return (given.copy(),)  # since a policy may use its array again; the world looks at the numbers
            given = np.asarray(given)
            several = given.ndim > len(world.space_of_actions.shape or ())
            rows = given.reshape(len(given) if several else 1, -1)
            if world.action_width - 1 == WIDTH == rows.shape[1]:
                rows = np.pad(rows, ((0, 0), (0, 1)))
            (chunk,) = check_chunks([ActionChunk(rows)], 1, spec.name, spec.action.width)
            return list(chunk.actions[: spec.execute])
        except (Exception, SystemExit) as error:  # in place of ``with``, for which every step would pay
            self._blamed.__exit__(None, error, None)
            raise

    def close(self) -> None:
        """Close the environment by which the action space was read."""
        self._world.close()


def _leaves(observation: Any) -> list[NDArray[Any]]:
    if isinstance(observation, Mapping | tuple | list):
        parts = observation.values() if isinstance(observation, Mapping) else observation
        return [leaf for part in parts for leaf in _leaves(part)]
    return [] if isinstance(observation, str) else [np.asarray(observation)]
