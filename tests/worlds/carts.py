"""Environments of gymnasium with known defects in their resets, steps and pictures, and sound ones beside them."""

import random
import sys
import time
from collections.abc import Mapping
from itertools import count
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

from vlafuzz.model import Stage
from vlafuzz.worlds.gym import GymWorld, Now, Parameter

FRICTION = {"wood": 0.3, "ice": 0.02, "felt": 0.9}
HELD = count()


class Cart(gymnasium.Env):
    """A cart on a floor has to reach a mark. ``reset`` takes values by name in its options; else it has its own."""

    metadata: ClassVar = {"render_modes": ["rgb_array"], "render_fps": 10}
    render_mode = "rgb_array"
    observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float64)
    action_space = spaces.Box(-1, 1, (1,), np.float32)
    own: ClassVar[dict[str, Any]] = {"mass": 2.0, "mark": 1.5, "slope": 0.0, "floor": "wood"}

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.take(self.own | (options or {}))
        self.x = float(self.np_random.normal(0, 0.01))
        self.v = 0.0
        return self.seen(), {}

    def take(self, values: Mapping[str, Any]) -> None:
        self.mass, self.mark = values["mass"], values["mark"]
        self.slope, self.friction = np.radians(values["slope"]), FRICTION[values["floor"]]

    def step(self, action):
        pull = 4 * float(action[0]) - self.mass * np.sin(self.slope) - self.friction * self.mass * self.v
        self.v += 0.1 * pull / self.mass
        self.x += 0.1 * self.v
        return self.seen(), -abs(self.mark - self.x), False, False, {"success": abs(self.mark - self.x) < 0.1}

    def seen(self):
        return np.array([self.x, self.v, self.mark])

    def render(self):
        picture = np.zeros((24, 48, 3), np.uint8)
        picture[:, int(np.clip(24 + 10 * self.x, 0, 47))] = 255
        return picture


class Carts(GymWorld):
    """The sound one; what is applied is not read back."""

    tasks = ("reach",)
    parameters = (
        Parameter("mass", 0.5, 4.0, nominal=2.0, step=0.1, unit="kg", says="how heavy the cart is"),
        Parameter("mark", 0.5, 3.0, nominal=1.5, step=0.1, unit="m"),
        Parameter("slope", -10.0, 10.0, nominal=0.0, step=0.5, unit="°"),
        Parameter("floor", options=("wood", "ice", "felt")),
    )
    horizon = 60
    env: type[Cart] = Cart

    def make(self, task):
        assert task in self.tasks
        return self.env()


class ReadBack(Carts):
    """Sound, and says which values it has."""

    def applied(self, state: Now):
        env = state.env.unwrapped
        floor = next((name for name, value in FRICTION.items() if value == env.friction), "?")
        return {"mass": env.mass, "mark": env.mark, "slope": float(np.degrees(env.slope)), "floor": floor}


class Expert(ReadBack):
    """Sound, with an expert, and a value that matters only where the mark is reached."""

    parameters = (*Carts.parameters, Parameter("bell", 0.0, 1.0, nominal=0.0, step=0.1))

    class env(Cart):  # noqa: N801
        own: ClassVar = Cart.own | {"bell": 0.0}

        def take(self, values):
            super().take(values)
            self.bell = values["bell"]

        def step(self, action):
            observation, reward, *rest = super().step(action)
            return observation, reward + self.bell * (reward > -0.3), *rest

    def solve(self, now):
        x, v, mark = now.observation
        return np.clip([3 * (mark - x) - 2 * v], -1, 1)


class Staged(Carts):
    stages = (Stage("there", lambda now: now.info["success"], lambda now: 0.0),)


class NoSeedNeeded(Carts):
    """Sound: nothing in it is drawn."""

    class env(Cart):  # noqa: N801
        def reset(self, *, seed=None, options=None):
            observation, info = super().reset(seed=1, options=options)
            return observation, info


def world(kind: type[gymnasium.Env], base: type[Carts] = Carts) -> type[Carts]:
    return type(kind.__name__, (base,), {"env": kind})


class _GlobalGenerator(Cart):
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed, options=options)
        self.x = float(np.random.normal(0, 0.01))  # noqa: NPY002
        return self.seen(), {}


class _KeepsState(Cart):
    v = 0.0

    def reset(self, *, seed=None, options=None):
        before = self.v
        super().reset(seed=seed, options=options)
        self.v = 0.1 * before
        return self.seen(), {}


class _IgnoresValue(Cart):
    def take(self, values):
        super().take(values | {"mass": self.own["mass"]})


class _SwappedUnit(Cart):
    def take(self, values):
        super().take(values)
        self.slope = values["slope"]  # radians


class _Clips(Cart):
    def take(self, values):
        super().take(values | {"mass": min(values["mass"], 2.5)})


class _OtherNominal(Cart):
    own: ClassVar = Cart.own | {"mass": 1.0}


class _AppliesLate(Cart):
    waiting: ClassVar = Cart.own

    def reset(self, *, seed=None, options=None):
        before, self.waiting = self.waiting, self.own | (options or {})
        return super().reset(seed=seed, options=before)


class _IgnoresSeed(Cart):
    def reset(self, *, seed=None, options=None):
        self.np_random = np.random.default_rng()
        return super().reset(options=options)


class _StepsByChance(Cart):
    def step(self, action):
        self.v += 1e-3 * random.random()
        return super().step(action)


class _DrawsDifferently(Cart):
    def render(self):
        picture = super().render()
        picture[0, 0] = next(HELD) % 250
        return picture


class _DrawingMoves(Cart):
    def render(self):
        self.x += 0.01
        return super().render()


class _DrawingCrashes(Cart):
    def render(self):
        raise RuntimeError("no display")


class _MapsCategoryWrongly(Cart):
    def take(self, values):
        super().take(values | {"floor": {"wood": "wood", "ice": "felt", "felt": "felt"}[values["floor"]]})


class _SwapsCategories(Cart):
    def take(self, values):
        super().take(values | {"floor": {"wood": "wood", "ice": "felt", "felt": "ice"}[values["floor"]]})


class _DependsOnProcess(Cart):
    started = time.time()

    def take(self, values):
        super().take(values)
        self.mass += 1e-6 * (self.started % 1)


class TwoTasks(Carts):
    """Sound, with a second task that is the first one again."""

    tasks = ("reach", "again")


class LazyExpert(ReadBack):
    """Its expert never moves."""

    def solve(self, now):
        return [0.0]


class ShortExpert(Expert):
    """Its expert goes the other way where the mark is far."""

    def solve(self, now):
        return super().solve(now) if now.values["mark"] <= 2 else [-1.0]


class Solved(Carts):
    """Success is said to hold from the start."""

    def success(self, now):
        return now.observation[0] < 2


class NoSuccess(Carts):
    """Nobody says what success is."""

    class env(Cart):  # noqa: N801
        def step(self, action):
            return *super().step(action)[:4], {}


GlobalGenerator, KeepsState, IgnoresValue = world(_GlobalGenerator), world(_KeepsState), world(_IgnoresValue)
SwappedUnit, Clips, OtherNominal = world(_SwappedUnit, ReadBack), world(_Clips), world(_OtherNominal)
AppliesLate, IgnoresSeed, StepsByChance = world(_AppliesLate), world(_IgnoresSeed), world(_StepsByChance)
DrawsDifferently, DrawingMoves, DrawingCrashes = world(_DrawsDifferently), world(_DrawingMoves), world(_DrawingCrashes)
MapsCategoryWrongly, SwapsCategories = world(_MapsCategoryWrongly), world(_SwapsCategories, ReadBack)
DependsOnProcess = world(_DependsOnProcess)
ClipsReadBack, IgnoresReadBack = world(_Clips, ReadBack), world(_IgnoresValue, ReadBack)


@Expert.policy
def sliding(observation):
    """Pushes to the mark at once, and gives up where the cart began to the left of where it stands."""
    x, v, mark = observation
    return np.clip([3 * (mark - x) - 2 * v], -1, 1) if mark < 2.05 else [0.0]


def alone():
    assert "sapien" not in sys.modules
    return sliding()
