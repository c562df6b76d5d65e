"""The vla-eval client: against the real server of PyPI, and against servers that misbehave."""

import json
import time
from dataclasses import replace

import numpy as np
import pytest

from tests.policies.clients.served import (
    STATE,
    Answering,
    Attentive,
    Rounded,
    Served,
    asked,
    seen,
    serving,
    start,
    still_open,
)
from tests.policies.rolled import check_same_as_in_process
from vlafuzz.cli import main
from vlafuzz.model.outcome import Verdict
from vlafuzz.policies.base import CameraRequest
from vlafuzz.policies.controls import Random
from vlafuzz.policies.harness import Harness
from vlafuzz.policies.mini.policy import Mini
from vlafuzz.rollouts.policies import make_policy

pytestmark = pytest.mark.usefixtures("opened", "no_pause")
STILL = [0.0] * 6 + [1.0]


class TestRollouts:
    """Whole rollouts in the simulator are the same over the wire as without it."""

    def test_chunks_that_the_server_keeps(self):
        with serving(Served(Attentive(), chunk_size=3)) as name:
            check_same_as_in_process(name, Attentive, Verdict.FAILED)

    @pytest.mark.render
    def test_mini(self):
        with serving(Served(Mini())) as name:
            options = "?camera=128&execute=1&relative_to=current&state=1"
            check_same_as_in_process(name + options, Mini, Verdict.PASSED)


class TestWire:
    """The messages of the real server."""

    def test_an_observation_arrives_as_it_was(self):
        rng = np.random.default_rng(0)
        images = {name: rng.integers(0, 256, (32, 48, 3), dtype=np.uint8) for name in ("wrist", "front")}
        server = Served(Attentive(CameraRequest("front", 48, 32), CameraRequest("wrist", 48, 32, "wrist")))
        with serving(server) as name:
            policy = make_policy(f"{name}?camera=48x32")
            policy.reset([start("one", 3)])
            policy.act([seen("one", images=images)])
            policy.close()
        (message,) = server.seen
        assert list(message["images"]) == ["front", "wrist"]
        assert all(np.array_equal(message["images"][key], images[key]) for key in images)
        assert all(np.array_equal(message[key], STATE) for key in ("state", "states"))
        assert message["state"].dtype == np.float32
        assert message["task_description"] == "pick up apple"
        assert server.started == [start("one", 3)]

    def test_a_server_learns_the_suite_of_libero(self):
        server = Served(Rounded(Random()))
        with serving(server) as name:
            policy = make_policy(name)
            policy.reset([replace(start("one"), task="libero_goal/8"), start("two")])
            policy.act([seen("one"), seen("two")])
            policy.close()
        assert sorted(server.suites) == ["libero_goal", "vlafuzz"]

    def test_each_rollout_has_a_connection_which_ends_with_it(self, opened):
        server = Served(Rounded(Random()))
        with serving(server) as name:
            policy = make_policy(name)
            assert still_open(opened) == 0
            harnesses = [Harness(policy, start(f"{number}", number)) for number in range(3)]
            assert still_open(opened) == 3
            harnesses[0].finish()
            assert still_open(opened) == 2
            del harnesses
            assert still_open(opened) == 0
            policy.close()
            late = time.monotonic() + 20
            while len(set(server.ended)) < 3 and time.monotonic() < late:  # the server hears of it a little later
                time.sleep(0.01)
        assert len(set(server.ended)) == 3

    def test_a_rollout_that_begins_anew_is_not_ended_by_the_old_one(self):
        with serving(Rounded(Random())) as name:
            policy = make_policy(name)
            old = Harness(policy, start("one"))
            new = Harness(policy, start("one"))
            old.finish()
            new.accept(policy.act([seen("one")])[0])
            policy.close()

    def test_observations_that_are_sent_at_once_are_batched(self):
        server = Served(Rounded(Random()), max_batch_size=4, max_wait_time=0.5)
        names = ["a", "b", "c", "d"]
        with serving(server) as name:
            policy, alone = make_policy(name), Rounded(Random())
            for client in (policy, alone):
                client.reset([start(name, seed) for seed, name in enumerate(names)])
            for _ in range(3):
                there, here = (client.act([seen(name) for name in names]) for client in (policy, alone))
                assert [one.actions.tolist() for one in there] == [one.actions.tolist() for one in here]
            policy.close()
        assert sum(server.batches) == 12
        assert max(server.batches) == 4

    @pytest.mark.parametrize("shape", [(7,), (1, 7), (5, 7)])
    def test_one_action_or_a_chunk_of_them(self, shape):
        with serving(Answering(lambda _: np.arange(np.prod(shape)).reshape(shape))) as name:
            assert asked(name) == np.arange(np.prod(shape)).reshape(-1, 7).tolist()


def test_a_run_and_a_replay_of_it_from_the_command_line(tmp_path, capsys):
    store = str(tmp_path / "a.db")
    with serving(Rounded(Random())) as name:
        ran = main(["run", "--policy", name, "--budget", "2", "--store", store, "--json"])
        summary = json.loads(capsys.readouterr().out)
        assert (ran, summary["rollouts"], summary["verdicts"]["failed"]) == (0, 2, 2)
        assert main(["replay", store, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["same trajectory as stored"] is True
