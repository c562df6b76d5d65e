import pytest

from tests.worlds.tabletop.sim.meddling import ANOTHER, NOMINAL


@pytest.fixture(scope="module")
def known(expert_on) -> list[str]:
    """The hashes of the expert's rollouts of NOMINAL and ANOTHER."""
    outcomes = expert_on("pick-up").evaluate([NOMINAL, ANOTHER])
    return [outcome.rollouts[0].states_hash for outcome in outcomes]
