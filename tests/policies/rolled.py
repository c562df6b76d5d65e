"""Policies behind servers, in scenes of the tabletop."""

from collections.abc import Callable

import numpy as np

from tests.worlds.tabletop.sim.scenes import evaluate, pick_up, put
from vlafuzz.model import Verdict
from vlafuzz.policies.base import Policy
from vlafuzz.rollouts.policies import make_policy


def check_same_as_in_process(name: str, make: Callable[[], Policy], verdict: Verdict) -> None:
    """Whole rollouts of a policy behind a server have the verdict, and the actions and states of those without."""
    scenes = [pick_up(put("coke_can", -0.05, 0.1)), pick_up(put("green_cube", 0.05, -0.15, 30.0))]
    for far, near in zip(evaluate(make_policy(name), *scenes), evaluate(make(), *scenes), strict=True):
        assert verdict is far.verdict is near.verdict, far.detail
        assert np.array_equal(far.rollouts[0].actions, near.rollouts[0].actions)
        assert far.rollouts[0].states_hash == near.rollouts[0].states_hash
