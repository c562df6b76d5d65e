"""Twelve more defects of a cart, built in when the checks were finished: three of them were missed at first."""

import time

import numpy as np

from tests.worlds.carts import Cart, Carts, ReadBack, world
from vlafuzz.worlds.gym import Parameter


class _SeedsWhenMade(Cart):
    def __init__(self):
        np.random.seed(0)  # noqa: NPY002 - so that two new environments begin alike

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed, options=options)
        self.x = float(np.random.normal(0, 0.01))  # noqa: NPY002
        return self.seen(), {}


class _WearsOut(Cart):
    resets = 0

    def take(self, values):
        super().take(values)
        self.resets += 1
        self.friction *= 0.999**self.resets


class _Accumulates(Cart):
    body = 1.0

    def take(self, values):
        super().take(values)
        self.body *= values["mass"] / 2
        self.mass = 2 * self.body


class _ClipsBelow(Cart):
    def take(self, values):
        super().take(values | {"mass": max(values["mass"], 1.5)})


class _HashOfText(Cart):
    def take(self, values):
        super().take(values)
        self.friction += 1e-6 * (hash(values["floor"]) % 100)


class _RealTime(Cart):
    def step(self, action):
        self.v += 1e-6 * (time.perf_counter() % 1)
        return super().step(action)


class _OptionsFallBack(Cart):
    def take(self, values):
        super().take(values | {"floor": {"ice": "ice"}.get(values["floor"], "wood")})


class _Swapped(Cart):
    def take(self, values):
        super().take(values | {"mass": values["mark"], "mark": values["mass"]})


class _PictureLate(Cart):
    last = None

    def render(self):
        before, self.last = self.last, super().render()
        return self.last if before is None else before


class _IgnoresActions(Cart):
    def step(self, action):
        return super().step(np.full(1, 0.3))


class _NotFinite(Cart):
    def step(self, action):
        observation, *rest = super().step(action)
        return observation * (np.nan if self.mass < 0.8 else 1), *rest


class SolvedNear(Carts):
    parameters = (Parameter("mark", 0.0, 3.0, nominal=1.5, step=0.1, unit="m"), Carts.parameters[0])
    parameters += Carts.parameters[2:]

    def success(self, now):
        return abs(now.observation[2] - now.observation[0]) < 0.1


SeedsWhenMade, WearsOut, Accumulates, ClipsBelow = map(world, (_SeedsWhenMade, _WearsOut, _Accumulates, _ClipsBelow))
HashOfText, RealTime, OptionsFallBack, NotFinite = map(world, (_HashOfText, _RealTime, _OptionsFallBack, _NotFinite))
Swapped, PictureLate, IgnoresActions = world(_Swapped, ReadBack), world(_PictureLate), world(_IgnoresActions)
