"""Mutated inputs over everything that reads; `scripts/attack.py` does the same with 43,300 of them."""

from collections.abc import Iterator
from unittest.mock import Mock

import pytest

from tests.attack import samples, servers
from tests.attack.counting import TARGETS, count, reaction
from vlafuzz.policies.clients import wire

COSTLY = {"store rows": 4, "meshes": 4, "triage": 4, **dict.fromkeys(servers.SERVERS, 2)}  # inputs


@pytest.fixture(scope="module", autouse=True)
def _prepared() -> Iterator[None]:
    """All samples, and no pauses between attempts to connect."""
    samples.make_all()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(wire, "PAUSES", (0.0, 0.0))
        yield
    servers.stop()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", TARGETS)
def test_the_reaction_to_a_few_inputs_is_a_sentence(name: str):
    for number in range(COSTLY.get(name, 12)):
        kind, where = reaction(name, 2, number)
        assert kind in ("accepted", "refused"), f"input {number}: {where}"


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_the_reaction_to_many_inputs_is_a_sentence_in_time_and_in_little_memory(name: str):
    counted = count(name, TARGETS[name][1] // 20, seed=3)
    assert (counted.tracebacks, counted.hangs) == (0, 0), counted.faults


def test_what_is_no_sentence_would_be_noticed(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(TARGETS, "dying", (Mock(side_effect=KeyError("x")), 1))
    assert reaction("dying", 1, 0)[0] == "tracebacks"
