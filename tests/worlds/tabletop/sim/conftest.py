from collections.abc import Iterator

import pytest

from tests.worlds.tabletop.sim.meddling import ANOTHER, NOMINAL
from tests.worlds.tabletop.sim.scenes import FRONT, make_env
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv


@pytest.fixture(scope="module")
def known(expert_on) -> list[str]:
    """The hashes of the expert's rollouts of NOMINAL and ANOTHER."""
    outcomes = expert_on("pick-up").evaluate([NOMINAL, ANOTHER])
    return [outcome.rollouts[0].states_hash for outcome in outcomes]


@pytest.fixture(scope="package")
def seeing() -> Iterator[TabletopEnv]:
    """One environment with a camera for everybody; whoever uses it begins a scene first."""
    env = make_env(cameras=(FRONT,))
    yield env
    env.close()
