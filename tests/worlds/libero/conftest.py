from collections.abc import Iterator

import pytest

from tests.worlds.libero.scenes import SOUP, TASK
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.space import LiberoSpace
from vlafuzz.worlds.libero.suites import find_task
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.operators import OPERATORS


@pytest.fixture(scope="session")
def bowls() -> Iterator[LiberoEnv]:
    """``libero_goal/8``: put the bowl on the plate; furniture with drawers stands around."""
    env = LiberoEnv(find_task("libero_goal/8"), size=64)
    yield env
    env.close()


@pytest.fixture(scope="module")
def space() -> LiberoSpace:
    return LiberoSpace(load_operators("libero"), TASK, "libero")


@pytest.fixture(scope="module")
def varied() -> LiberoSpace:
    everything = load_operators("libero").only(OPERATORS.keys() - {"backdrop"})
    return LiberoSpace(everything, SOUP, "libero")
