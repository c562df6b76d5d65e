"""The vla-eval client: against the real server of PyPI, and against servers that misbehave."""

import re
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from websockets.sync import client as sockets

from tests.cli.typed import told
from tests.policies.clients import served
from tests.policies.clients.served import Answering, Rounded, failure, scripted, seen, serving, start, still_open
from vlafuzz.errors import PolicyError, PrerequisiteError
from vlafuzz.model import Verdict
from vlafuzz.policies.base import CameraRequest
from vlafuzz.policies.controls import Random
from vlafuzz.policies.harness import Harness, PartlyAnsweredError
from vlafuzz.policies.mini.policy import Mini
from vlafuzz.rollouts.policies import make_policy

pytestmark = pytest.mark.usefixtures("opened", "no_pause")
STILL = [0.0] * 6 + [1.0]


class TestRollouts:
    """Whole rollouts in the simulator are the same over the wire as without it."""

    def test_chunks_that_the_server_keeps(self):
        with serving(served.Served(served.Attentive(), chunk_size=3)) as name:
            served.check_same_as_in_process(name, served.Attentive, Verdict.FAILED)

    @pytest.mark.render
    def test_mini(self):
        with serving(served.Served(Mini())) as name:
            options = "?camera=128&execute=1&relative_to=current&state=1"
            served.check_same_as_in_process(name + options, Mini, Verdict.PASSED)


class TestWire:
    """The messages of the real server."""

    def test_an_observation_arrives_as_it_was(self):
        rng = np.random.default_rng(0)
        images = {name: rng.integers(0, 256, (32, 48, 3), dtype=np.uint8) for name in ("wrist", "front")}
        front, wrist = CameraRequest("front", 48, 32), CameraRequest("wrist", 48, 32, "wrist")
        server = served.Served(served.Attentive(front, wrist))
        with serving(server) as name:
            policy = make_policy(f"{name}?camera=48x32")
            policy.reset([start("one", 3)])
            policy.act([seen("one", images=images)])
            policy.close()
        (message,) = server.seen
        assert list(message["images"]) == ["front", "wrist"]
        assert all(np.array_equal(message["images"][key], images[key]) for key in images)
        assert all(np.array_equal(message[key], served.STATE) for key in ("state", "states"))
        assert message["state"].dtype == np.float32
        assert message["task_description"] == "pick up apple"
        assert server.started == [start("one", 3)]

    def test_a_server_learns_the_suite_of_libero(self):
        server = served.Served(Rounded(Random()))
        with serving(server) as name:
            policy = make_policy(name)
            policy.reset([replace(start("one"), task="libero_goal/8"), start("two")])
            policy.act([seen("one"), seen("two")])
            policy.close()
        assert sorted(server.suites) == ["libero_goal", "vlafuzz"]

    def test_each_rollout_has_a_connection_which_ends_with_it(self, opened):
        server = served.Served(Rounded(Random()))
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
            assert len(list(new.actions(policy.act([seen("one")])[0]))) == 1
            policy.close()

    def test_observations_that_are_sent_at_once_are_batched(self):
        server = served.Served(Rounded(Random()), max_batch_size=4, max_wait_time=0.5)
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
            assert served.asked(name) == np.arange(np.prod(shape)).reshape(-1, 7).tolist()


def test_a_run_and_a_replay_of_it_from_the_command_line(tmp_path, capsys):
    store = str(tmp_path / "a.db")
    with serving(Rounded(Random())) as name:
        summary = told(capsys, ["run", "--policy", name, "--budget", "2", "--store", store, "--json"])
        assert (summary["rollouts"], summary["verdicts"]["failed"]) == (2, 2)
        assert told(capsys, ["replay", store, "--json"])["same trajectory as stored"] is True


def says(payload: object, kind: str = "action", *, late: int = 0) -> Callable[[int], bytes]:
    """A reply, ``late`` by so many messages."""
    return lambda number: served.message(kind, payload, number - late)


def array(dtype: str, data: bytes) -> dict:
    return {"__ndarray__": True, "data": data, "dtype": dtype, "shape": [7]}


GOOD = says({"actions": STILL})


class TestWrongAnswers:
    """Errors of a real server with a bad model, and of our own servers that break the protocol."""

    def test_an_error_of_the_model_is_told(self):
        with serving(Answering(lambda message: message["nothing"])) as name:
            error = failure(f"{name}?camera=0")
        assert error.cause == "remote"
        assert error.message.endswith("observation_failed: KeyError: 'nothing'")

    def test_an_error_at_the_start_of_an_episode_is_told(self):
        policy = Random()
        policy.reset = lambda _: 1 / 0
        with serving(policy) as name:
            error = failure(name)
        assert error.cause == "remote"
        assert error.message.endswith("episode_start_failed: ZeroDivisionError: division by zero")

    @pytest.mark.parametrize(
        ("reply", "cause", "says"),
        [
            (b"\xc1garbage", "protocol", "not a vla-eval message: 8 bytes, "),
            (b"", "protocol", "not a vla-eval message: 0 bytes"),
            ("Traceback: it broke", "protocol", "not a vla-eval message: the text 'Traceback: it broke'"),
            (b"\x80", "protocol", "no type, payload and number in {}"),
            (b"\x01", "protocol", "no type, payload and number in 1"),
            (says([1]), "protocol", "a payload of list"),
            (says({"actions": STILL}, late=1), "protocol", "with number 3, got"),
            (says(served.HELLO, "hello"), "protocol", "expected the message 'action'"),
            (says({"error": "no\nmemory"}, "error"), "remote", ": no memory"),
            (says({}), "bad_action", "a reply without actions, but []"),
            (says({"actions": STILL, "more": bytes(5 << 20)}), "protocol", "more than 4 MiB"),
            (says({"actions": array("<f8", bytes(48))}), "protocol", "reshape"),
            (served.CLOSE, "connect", "the connection broke"),
        ],
    )
    def test_of_a_server(self, reply, cause, says):
        with scripted(reply) as name:
            served.check_failure(failure(f"{name}?camera=0"), cause, re.escape(says))

    def test_a_slow_server_runs_out_of_time(self):
        with serving(Answering(lambda _: time.sleep(0.6) or STILL)) as name:
            began = time.monotonic()
            error = failure(f"{name}?camera=0&timeout=0.2")
        assert (error.cause, error.hint) == ("timeout", "the option timeout=… waits longer")
        assert error.message.endswith(": no reply within 0.2 s")
        assert time.monotonic() - began < 5

    def test_a_server_that_stops_reading_runs_out_of_time(self):
        with scripted(served.HANG) as name:
            policy = make_policy(f"{name}?camera=3200&timeout=0.5")
            policy.reset([start("one"), start("two")])
            flood = [seen(rollout, images=served.black(policy.spec)) for rollout in ("one", "two")]
            with pytest.raises(PolicyError, match="no reply within") as caught:
                policy.act(flood)
            assert caught.value.cause == "timeout"

    def test_of_rollouts_that_are_asked_at_once_one_breaks_alone(self):
        with scripted(GOOD, b"?", GOOD) as name:
            policy = make_policy(f"{name}?camera=0")
            policy.reset([start("a"), start("b")])
            with pytest.raises(PartlyAnsweredError, match="not a vla-eval message") as caught:
                policy.act([seen("a"), seen("b")])
            answers = dict(zip("ab", caught.value.answers, strict=True))
            (broken,) = [rollout for rollout, got in answers.items() if isinstance(got, PolicyError)]
            (whole,) = set(answers) - {broken}
            assert answers[whole].actions.tolist() == [STILL]
            assert policy.act([seen(whole, 1)])[0].actions.tolist() == [STILL]
            with pytest.raises(PolicyError, match=f"no live rollout '{broken}'"):
                policy.act([seen(broken, 1)])
            policy.close()


class TestServerThatGoesAway:
    def test_a_rollout_that_it_leaves_is_not_gone_on_with(self):
        with serving(Rounded(Random())) as name:
            policy = make_policy(name)
            policy.reset([start("one")])
            policy.act([seen("one")])
        for _ in range(2):
            with pytest.raises(PolicyError):
                policy.act([seen("one", 1)])
        policy.close()

    def test_another_one_in_its_place_is_noticed(self, opened):
        declared = [{"gripper": "binary_close_positive"}, {"gripper": "continuous_01"}]
        server = Answering(lambda _: STILL, action=declared[0])
        with serving(server) as name:
            policy = make_policy(f"{name}?camera=0")
            server._declared = {"action": declared[1]}
            with pytest.raises(PolicyError, match="another server answers") as caught:
                policy.reset([start("one")])
            assert caught.value.cause == "protocol"
            assert still_open(opened) == 0


class TestNoServer:
    """Messages for a policy that cannot be reached, from Python and from `vlafuzz run`."""

    ABSENT = "vla-eval:ws://127.0.0.1:9"

    def test_it_is_tried_three_times(self, monkeypatch):
        tried = []
        real = sockets.connect
        monkeypatch.setattr(sockets, "connect", lambda *a, **k: tried.append(a) or real(*a, **k))
        with pytest.raises(PrerequisiteError):
            make_policy(self.ABSENT)
        assert len(tried) == 3

    def test_a_connection_that_breaks_once_is_opened_again(self, monkeypatch):
        real, broken = sockets.connect, iter([ConnectionResetError(104, "Connection reset by peer")])

        def connect(*args, **more):
            for error in broken:
                raise error
            return real(*args, **more)

        with serving(Rounded(Random())) as name:
            policy = make_policy(name)
            monkeypatch.setattr(sockets, "connect", connect)
            policy.reset([start("one")])
            assert len(policy.act([seen("one")])) == 1
            policy.close()

    @pytest.mark.parametrize(
        ("hello", "says"),
        [
            (served.HELLO | {"protocol_version": 2}, "it speaks version 2 of the protocol, not 1"),
            ({"model_server": "x"}, "its hello: protocol_version: field required"),
            (served.HELLO | {"action_spec": "none"}, "its hello: action_spec: "),
        ],
    )
    def test_a_server_of_another_protocol(self, hello, says):
        with scripted(hello=hello) as name, pytest.raises(PrerequisiteError) as caught:
            make_policy(name)
        assert says in caught.value.message
