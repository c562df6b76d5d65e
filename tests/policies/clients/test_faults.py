"""Faults of a connection cost retries and ERROR outcomes, but never make a scene fail."""

from contextlib import ExitStack, contextmanager

import pytest

from tests.policies.clients import served
from tests.policies.clients.faults import Drifting, Faults, groot, openpi, relayed
from tests.search.worlds import sampled
from tests.worlds.tabletop.sim.scenes import evaluator_of
from vlafuzz.model import Outcome, Verdict
from vlafuzz.rollouts.lockstep import LockstepExecutor
from vlafuzz.rollouts.policies import make_policy

PROTOCOLS = ("vla-eval", "openpi", "groot")  # that of /act is broken in test_fault_matrix
TIMEOUT = 1.2  # seconds for an answer, enough on a busy machine
STALL = 1.5 * TIMEOUT  # the next attempt is answered in the middle of its time


@contextmanager
def faulty(protocol: str, faults: Faults):
    """The name of ``Drifting`` behind a faulty connection."""
    with ExitStack() as stack:
        if protocol == "groot":
            yield stack.enter_context(groot(faults))
            return
        if protocol == "vla-eval":  # the real server
            name = f"{stack.enter_context(served.serving(Drifting()))}?camera=0&state=1"
        else:
            name = stack.enter_context(openpi())
        yield stack.enter_context(relayed(name, faults))


@pytest.fixture(scope="module")
def undisturbed() -> list[Outcome]:
    """The outcomes of the scenes in process."""
    simulator = evaluator_of(Drifting())
    yield simulator.evaluate(sampled(4))
    simulator.close()


def summary(outcome: Outcome) -> tuple[Verdict, list[str]]:
    return outcome.verdict, [rollout.states_hash for rollout in outcome.rollouts]


@pytest.mark.usefixtures("no_pause")
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_what_is_lost_on_the_way_is_begun_again_and_every_time_is_logged(protocol, undisturbed, caplog):
    faults = Faults([*[None] * 3, "drop", *[None] * 6, "cut", None, "stall"], seconds=STALL)
    with faulty(protocol, faults) as name:
        simulator = evaluator_of(make_policy(f"{name}&timeout={TIMEOUT}"))
        faults.begin()
        outcomes = simulator.evaluate(sampled(4)[:2])
        simulator.close()
    assert [summary(outcome) for outcome in outcomes] == [summary(outcome) for outcome in undisturbed[:2]]
    assert faults.came == ["drop", "cut", "stall"]
    assert len([record for record in caplog.records if "again in" in record.message]) == 3


@pytest.mark.usefixtures("no_pause")
@pytest.mark.parametrize("protocol", ["openpi", "groot"])  # a connection a rollout, and one for all
def test_a_fault_costs_no_scene_that_is_rolled_out_at_the_same_time(protocol, undisturbed):
    plan = [*[None] * 5, "drop", None, None, "garbage", *[None] * 3, "cut", None, "error"]
    faults = Faults(plan, seconds=STALL)
    with faulty(protocol, faults) as name:
        executor = LockstepExecutor(evaluator_of, make_policy(f"{name}&timeout={TIMEOUT}"), lanes=3)
        faults.begin()
        results = dict(executor.run(enumerate(sampled(4))))
        executor.close()
    outcomes = [results[index] for index in range(4)]
    broken = [index for index, outcome in enumerate(outcomes) if outcome.verdict is Verdict.ERROR]
    assert faults.came[:2] == ["drop", "garbage"]
    assert len(broken) <= len({"garbage", "error"} & {*faults.came})
    for index, (outcome, alone) in enumerate(zip(outcomes, undisturbed, strict=True)):
        assert index in broken or summary(outcome) == summary(alone)
