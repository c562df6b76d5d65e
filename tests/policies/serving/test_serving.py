"""Our policies behind our own servers answer the same over the wire as without it."""

import io
import json
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from urllib.parse import urlsplit
from urllib.request import urlopen

import anyio
import numpy as np
import pytest
from PIL import Image
from vla_eval.connection import Connection
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.doubles import Idle
from tests.policies.clients.served import STATE, Attentive, asked, check_same_as_in_process, failure, seen, start
from vlafuzz.cli import main
from vlafuzz.errors import UsageError
from vlafuzz.model import Verdict
from vlafuzz.policies.base import ActionChunk, ActionSpec, CameraRequest, Observation, Policy, PolicySpec
from vlafuzz.policies.clients.msgpack_wire import pack_vla_eval, unpack_vla_eval
from vlafuzz.policies.clients.servers import guesses
from vlafuzz.policies.controls import Frozen
from vlafuzz.policies.serving import serving
from vlafuzz.rollouts.policies import make_policy

pytestmark = pytest.mark.usefixtures("opened", "no_pause")

SCALES = {"position_scale": 0.5, "rotation_scale": 2.0}
CONVENTIONS = ActionSpec(rotation="euler_xyz", relative_to="current", gripper="open_01", sticky=2, hz=10, **SCALES)
CAMERAS = (CameraRequest("front", 64, 48), CameraRequest("wrist", 64, 48, "wrist"))
SERVED = {
    "conventions, and two actions of a chunk": lambda: Attentive(action=CONVENTIONS, execute=2),
    "pictures": lambda: Attentive(*CAMERAS),
}


@pytest.mark.parametrize(
    "served", [pytest.param(name, marks=pytest.mark.render if name == "pictures" else ()) for name in SERVED]
)
def test_whole_rollouts_are_those_in_process_action_for_action(served):
    with serving(SERVED[served]()) as name:
        check_same_as_in_process(name, SERVED[served], Verdict.FAILED)


class Echo(Idle):
    """Answers with its observation: the picture's corner, the state, and the number of calls."""

    def __init__(self, *cameras: CameraRequest) -> None:
        self.spec = PolicySpec("echo", cameras=cameras, state=True)
        self.begun, self.ended = [], []

    def reset(self, episodes) -> None:
        self.begun += episodes

    def finish(self, episodes) -> None:
        self.ended += episodes

    def act(self, observations) -> list[ActionChunk]:
        (seen,) = observations
        corner = [float(picture[0, 0, 0]) for picture in seen.images.values()]
        return [ActionChunk(np.array([[*corner, *seen.state[len(corner) : 6], seen.step]]))]


def url(name: str) -> str:
    """The URL of a WebSocket, without protocol prefix and options."""
    return name.partition(":")[2].partition("?")[0]


def picture(value: int) -> np.ndarray:
    return np.full((224, 224, 3), value, np.uint8)


@pytest.fixture
def echo() -> Echo:
    return Echo(CAMERAS[0])


class Slow(Attentive):
    """A slow policy, so that others send requests meanwhile."""

    def __init__(self, **more: object) -> None:
        super().__init__(**more)
        self.batches: list[int] = []

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        self.batches.append(len(observations))
        time.sleep(0.02)
        return super().act(observations)


def test_clients_that_ask_at_the_same_time_get_the_answers_that_each_gets_alone():
    def rollout(policy: Policy, number: int) -> list[list[list[float]]]:
        policy.reset([start("it", number)])
        return [policy.act([seen("it", step)])[0].actions.tolist() for step in range(4)]

    with serving(served := Slow(max_batch=8)) as name, ThreadPoolExecutor(8) as pool:
        clients = [make_policy(name) for _ in range(8)]
        there = list(pool.map(rollout, clients, range(8), timeout=60))
        for client in clients:
            client.close()
    assert there == [rollout(Attentive(), number) for number in range(8)]
    assert max(served.batches) > 1
    assert sum(served.batches) == 8 * 4


class TestOthersClients:
    """Messages of clients that are not ours, with pictures of their own size."""

    def test_vla_evals_own(self, echo):
        async def drive() -> list[list[float]]:
            async with Connection(url(name)) as line:
                await line.start_episode({"task": {"name": "up", "seed": 3}})
                message = {"images": {"front": picture(9)}, "states": STATE, "task_description": "up"}
                replies = [await line.act(message) for _ in range(2)]
                await line.end_episode({"metrics": {}})
                return [reply["actions"].tolist() for reply in replies]

        with serving(echo) as name:
            assert anyio.run(drive) == [[9.0, *STATE[1:6].tolist(), step] for step in range(2)]
        assert [(begun.instruction, begun.seed) for begun in echo.begun] == [("up", 3)]
        assert echo.ended == echo.begun

    @pytest.mark.parametrize("kind", ["PNG", "JPEG"])
    def test_one_of_vla_eval_compresses_its_pictures(self, echo, kind):
        packed = io.BytesIO()
        Image.fromarray(picture(9)).save(packed, kind)
        shown = {"__image__": True, "format": kind.lower(), "data": packed.getvalue()}
        message = {"images": {"front": shown}, "states": STATE, "task_description": "up"}
        with serving(echo) as name, connect(url(name)) as line:
            line.send(pack_vla_eval("observation", message, 4))
            kind, payload, number = unpack_vla_eval(line.recv())
        assert (kind, number, payload["actions"][0]) == ("action", 4, 9.0)

    def test_they_may_ask_whether_it_is_up(self):
        with serving(Frozen()) as name, urlopen(url(name).replace("ws", "http") + "/health") as up:
            assert up.status == 200


class TestErrors:
    """An invalid observation or a broken policy is reported; the next rollout is fine."""

    @pytest.mark.parametrize(
        ("query", "says"),
        [
            ("&camera=0", "0 pictures, expected front 64x48"),
            ("&state=eef_pos3_axisangle3_gripper2", "proprioception of shape (8,), expected 7 numbers"),
        ],
    )
    def test_an_observation_that_does_not_fit(self, query, says, echo):
        with serving(echo) as name:
            options = dict(part.split("=") for part in f"{name.partition('?')[2]}{query}".split("&"))
            query = "&".join(f"{key}={value}" for key, value in options.items())
            error = failure(f"{name.partition('?')[0]}?{query}")
        assert error.cause == "remote"
        assert says in error.message

    def test_a_policy_that_breaks(self):
        policy, fine = Frozen(), Frozen().act
        policy.act = lambda _: 1 / 0
        with serving(policy) as name:
            error = failure(name)
            assert (error.cause, "ZeroDivisionError: division by zero" in error.message) == ("remote", True)
            policy.act = fine
            assert asked(name) == [[0, 0, 0, 0, 0, 0, 1]]

    def test_what_is_no_message_ends_the_connection_and_the_server_stays(self):
        with serving(Frozen()) as name, connect(url(name)) as socket:
            socket.send(b"\xc1")
            with pytest.raises(ConnectionClosed):
                list(iter(socket.recv, None))
            assert len(asked(name)) == 1

    def test_a_port_that_is_taken(self):
        with serving(Frozen()) as name:
            again = serving(Frozen(), port=urlsplit(url(name)).port)
            with pytest.raises(UsageError, match="Address already in use") as caught:
                again.__enter__()
        assert caught.value.hint == "--port 0 takes any that is free"


class TestAddress:
    """The printed name says all that a run would have to guess."""

    @pytest.mark.parametrize(
        "action", [ActionSpec(), ActionSpec(rotation="euler_xyz", gripper="close_01", position_scale=0.05, hz=10)]
    )
    def test_nothing_is_guessed(self, action):
        with serving(Attentive(action=action)) as name, closing(make_policy(name)) as client:
            assert guesses(name, client.spec) == {}
            assert client.spec.action == action

    def test_what_the_server_declares_is_not_repeated(self):
        with serving(Frozen()) as name:
            assert "rotation=" not in name
            assert "gripper=" not in name


class TestCommand:
    @pytest.mark.parametrize(
        ("arguments", "says"),
        [
            (["randm"], "unknown policy 'randm'"),
            (["random", "--port", "70000"], "--port: expected at most 65535, got 70000"),
            (["expert"], "expert cannot be served: it wants the simulator's state"),
        ],
    )
    def test_what_it_refuses(self, arguments, says, capsys):
        assert main(["serve", *arguments]) == 2
        assert says in capsys.readouterr().err

    def test_it_prints_the_name_under_which_a_run_finds_it_and_ends_when_interrupted(self, tmp_path, capsys):
        command = [sys.executable, "-m", "vlafuzz", "serve", "random", "--port", "0"]
        store = str(tmp_path / "a.db")
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        # What is started in the background of a shell ignores Ctrl-C, and so do its children.
        options["preexec_fn"] = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)
        with subprocess.Popen(command, **options) as server:
            try:
                name = server.stdout.readline().strip()
                ran = main(["run", "--policy", name, "--budget", "2", "--store", store, "--json"])
                server.send_signal(signal.SIGINT)
                _, stderr = server.communicate(timeout=60)
            finally:
                server.kill()
        assert (ran, json.loads(capsys.readouterr().out)["rollouts"]) == (0, 2)
        assert (server.returncode, stderr.splitlines()[0]) == (0, "serving random; Ctrl-C ends it")
        assert stderr.endswith(f"`vlafuzz run --policy '{name}'`\n")  # quoted, because of ? and &
