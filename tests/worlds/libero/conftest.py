from collections.abc import Iterator

import pytest

from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.suites import find_task


@pytest.fixture(scope="session")
def bowls() -> Iterator[LiberoEnv]:
    """``libero_goal/8``: put the bowl on the plate; furniture with drawers stands around."""
    env = LiberoEnv(find_task("libero_goal/8"), size=64)
    yield env
    env.close()
