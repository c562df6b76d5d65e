"""Faults of a connection cost retries and ERROR outcomes, but never make a scene fail."""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import chain
from pathlib import Path

import pytest

from tests.policies.clients import served
from tests.policies.clients.faults import Drifting, Faults, drawn, free_port, groot, relayed
from tests.search.worlds import sampled
from tests.worlds.tabletop.sim.scenes import CATALOGUE
from vlafuzz.cli import main
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.policies.serving.serve import serving
from vlafuzz.rollouts.lockstep import LockstepExecutor
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.sim.evaluator import ManiSkillEvaluator

PROTOCOLS = ("vla-eval", "openpi", "http", "groot")
STALL = 2.4  # seconds; a server gets half of it to answer, enough on a busy machine
HERE = "python:tests.policies.clients.faults:Drifting"
RATES = {"drop": 0.05, "cut": 0.02, "stall": 0.005, "garbage": 0.005, "huge": 0.005, "error": 0.005}


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
            name = stack.enter_context(serving(Drifting(), protocol))
        yield stack.enter_context(relayed(name, faults))


def evaluator(policy) -> ManiSkillEvaluator:
    return ManiSkillEvaluator(Conditions(task="pick-up", world={"min_distance": 0.15}), policy, CATALOGUE)


@pytest.fixture(scope="module")
def undisturbed() -> list[Outcome]:
    """The outcomes of the scenes in process."""
    simulator = evaluator(Drifting())
    yield simulator.evaluate(sampled(4))
    simulator.close()


def summary(outcome: Outcome) -> tuple[Verdict, list[str]]:
    return outcome.verdict, [rollout.states_hash for rollout in outcome.rollouts]


@pytest.mark.usefixtures("no_pause")
@pytest.mark.parametrize("protocol", PROTOCOLS)
class TestScenes:
    def outcomes(self, protocol: str, scenes: int, *plan: str | None) -> tuple[list[Outcome], Faults]:
        faults = Faults(plan, seconds=STALL)
        with faulty(protocol, faults) as name:
            simulator = evaluator(make_policy(f"{name}&timeout={STALL / 2}"))
            faults.begin()
            outcomes = simulator.evaluate(sampled(4)[:scenes])
            simulator.close()
        return outcomes, faults

    def test_what_is_lost_on_the_way_is_begun_again_and_every_time_is_logged(
        self, protocol, undisturbed, caplog
    ):
        outcomes, faults = self.outcomes(protocol, 2, *[None] * 3, "drop", *[None] * 6, "cut", None, "stall")
        assert [summary(outcome) for outcome in outcomes] == [summary(outcome) for outcome in undisturbed[:2]]
        assert faults.came == ["drop", "cut", "stall"]
        assert len([record for record in caplog.records if "again in" in record.message]) == 3

    def test_answers_that_are_none_are_errors_and_the_other_scenes_are_as_ever(self, protocol, undisturbed):
        outcomes, faults = self.outcomes(
            protocol, 4, None, None, "garbage", None, None, None, "huge", "error"
        )
        broken = [index for index, outcome in enumerate(outcomes) if outcome.verdict is Verdict.ERROR]
        assert len(broken) == len(faults.came) - (protocol == "groot")  # ZeroMQ cuts off what is huge
        assert all(outcomes[index].detail.startswith("policy: ") for index in broken)
        for index, (outcome, alone) in enumerate(zip(outcomes, undisturbed, strict=True)):
            assert index in broken or summary(outcome) == summary(alone)


@pytest.mark.usefixtures("no_pause")
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_fault_costs_no_scene_that_is_rolled_out_at_the_same_time(protocol, undisturbed):
    plan = [*[None] * 5, "drop", None, None, "garbage", *[None] * 3, "cut", None, "error"]
    faults = Faults(plan, seconds=STALL)
    with faulty(protocol, faults) as name:
        executor = LockstepExecutor(evaluator, make_policy(f"{name}&timeout={STALL / 2}"), lanes=3)
        faults.begin()
        outcomes = executor.evaluate(sampled(4), [0] * 4)
        executor.close()
    broken = [index for index, outcome in enumerate(outcomes) if outcome.verdict is Verdict.ERROR]
    assert faults.came[:2] == ["drop", "garbage"]
    assert len(broken) <= len({"garbage", "error"} & {*faults.came})
    for index, (outcome, alone) in enumerate(zip(outcomes, undisturbed, strict=True)):
        assert index in broken or summary(outcome) == summary(alone)


@pytest.mark.usefixtures("no_pause")
def test_what_is_lost_three_times_is_an_error_with_its_cause(undisturbed):
    faults = Faults(["drop"] * 3, seconds=STALL)
    with faulty("http", faults) as name:
        simulator = evaluator(make_policy(f"{name}&timeout={STALL / 2}"))
        faults.begin()
        lost, *others = simulator.evaluate(sampled(4))
        simulator.close()
    assert lost.verdict is Verdict.ERROR
    assert lost.detail.startswith("policy: timeout: ")
    assert [summary(outcome) for outcome in others] == [summary(outcome) for outcome in undisturbed[1:]]


@contextmanager
def killed_twice(protocol: str) -> Iterator[str]:
    """The name of ``Drifting`` in a process that is killed twice, and restarted some seconds later."""
    port, over = free_port(), threading.Event()
    command = [sys.executable, "-m", "vlafuzz", "serve", HERE, "--protocol", protocol, "--port", str(port)]

    def process() -> subprocess.Popen[str]:
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        names.append(server.stdout.readline().strip())
        return server

    def keep() -> None:
        for left in (2, 1, 0):
            with process() as server:
                ready.set()
                over.wait(10 if left else None)
                server.kill()

    names, ready, keeper = [], threading.Event(), threading.Thread(target=keep)
    keeper.start()
    ready.wait()
    try:
        yield names[0]
    finally:
        over.set()
        keeper.join()


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("run") / "scenes.jsonl"
    write_scenes(path, sampled(200))
    return path


def run(name: str, scenes: Path, store: Path, capsys) -> dict[str, tuple[Verdict, list[str]]]:
    """The outcome of each scene."""
    command = ["run", "--policy", name, "--scenes", str(scenes), "--store", str(store)]
    code = main([*command, "--unchecked", "--json"])  # the checks before a run do not go on after a fault
    ended = json.loads(capsys.readouterr().out)
    assert ended["proposals"] == 200
    assert code == (3 if ended["verdicts"]["error"] else 0)
    with Store.open(store) as opened:
        return {trial.scene.digest: summary(trial.outcome) for trial in opened.trials(1)}


@pytest.fixture(scope="module")
def alone(scenes, tmp_path_factory):
    """``alone(capsys)``: the run without a server, once."""
    cached = {}

    def results(capsys) -> dict[str, tuple[Verdict, list[str]]]:
        if not cached:
            cached.update(run(HERE, scenes, tmp_path_factory.mktemp("alone") / "a.db", capsys))
        return cached

    return results


@pytest.mark.slow
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_run_of_200_scenes_goes_through_with_every_scene_as_without_faults_or_an_error(
    protocol, scenes, alone, tmp_path, capsys, caplog
):
    own = {"cut": 0.0, "kill": 0.002} if protocol == "groot" else {}  # ZeroMQ hides what is cut
    plan = drawn(RATES | own, seed=1)
    faults = Faults(chain([None] * 10, plan), seconds=5.0)  # who is not there at first is refused
    with ExitStack() as stack:
        if protocol == "groot":
            name = stack.enter_context(groot(faults))
        else:
            name = stack.enter_context(relayed(stack.enter_context(killed_twice(protocol)), faults))
        faults.begin()
        results = run(f"{name}&timeout=2", scenes, tmp_path / "a.db", capsys)
    expected = alone(capsys)
    errors = [digest for digest, (verdict, _) in results.items() if verdict is Verdict.ERROR]
    again = [record for record in caplog.records if "again in" in record.message]
    assert {digest: results[digest] for digest in results if digest not in errors} == {
        digest: expected[digest] for digest in results if digest not in errors
    }
    assert len(errors) < 50
    assert {"drop", "stall", "garbage", "huge"} < {*faults.came}
    assert len(again) + len(errors) >= len(faults.came)
    sys.stderr.write(
        f"{protocol}: {len(faults.came)} faults, {len(again)} new attempts, {len(errors)} errors\n"
    )
