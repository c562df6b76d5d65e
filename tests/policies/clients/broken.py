"""Servers and policies that break from some answer on, and a bench on which only right answers pass.

A fault lasts until it is mended.
"""

import hashlib
import json
import os
import signal
import socket
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.doubles import STAGES
from tests.policies.clients.test_hostile import RESET
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, PolicySpec
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.worlds.episode import Episode
from vlafuzz.worlds.evaluator import SceneEvaluator

RIGHT = np.array([[0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
STEPS = 3  # of a rollout, each with an answer
PAGE = b"<!doctype html><html><body>Bad Gateway</body></html>"
ANSWERS: dict[str, Any] = {
    "NaN": [[float("nan")] * 7],
    "inf": [[float("inf")] * 7],
    "1e300": [[1e300] * 7],
    "shape": [[0.0] * 6],
    "nothing": [],
}


class Judging(Episode):
    """Passes if all actions are the right ones, and else fails: no fault may come to that."""

    states_hash = hashlib.blake2b(digest_size=16)

    def observe(self) -> Observation:
        return Observation(self.start.episode, len(self.actions), self.scene.instruction)

    def picture(self, camera: str) -> Any:
        raise AssertionError

    def _execute(self, action: Any) -> None:
        over = len(self.actions) == STEPS
        passes = over and np.allclose(self.actions, np.repeat(RIGHT, STEPS, 0))
        vars(self.monitor).update(success_once=passes, success_now=passes, reached=STAGES if passes else ())


class Bench(SceneEvaluator):
    """Every scene is fair, and needs no simulator."""

    def check(self, scene: Any) -> None:
        return None

    def begin(self, scene: Any, seed: int) -> Judging:
        about = {"success_once": False, "success_now": False, "stages": ()}
        monitor = SimpleNamespace(reached=[], progress=0.0, trace=np.zeros(STEPS, np.float32), **about)
        return Judging(scene, seed, self._conditions, monitor, hz=5, horizon=STEPS)  # type: ignore[arg-type]

    def renew(self) -> None:
        pass


def bench(conditions: Any, policy: Any = None) -> Bench:
    return Bench(conditions, policy or make_policy(conditions.policy), STAGES)


class Breaking:
    """A policy of the user's own; ``what`` breaks from the answer number ``at``, or at a ``place``."""

    spec = PolicySpec("breaking")
    what, place, at, asked = "", "", 0, 0

    def __init__(self) -> None:
        self._meet("make")

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._meet("reset")

    def act(self, observations: Sequence[Observation]) -> list[Any]:
        Breaking.asked += 1
        if self.place == "act" and Breaking.asked > self.at:
            self._meet("act")
            return [{"rubbish": "x", "None": None, "complex": RIGHT * 1j}.get(self.what, ANSWERS.get(self.what))]
        return [ActionChunk(RIGHT)]

    def close(self) -> None:
        self._meet("close")

    def _meet(self, place: str) -> None:
        if place == self.place and self.what == "raises":
            raise KeyError("weights")
        if place == self.place and self.what == "exits":
            sys.exit(0)


class Mortal(Breaking):
    """Its worker is killed whenever it is asked, until the file ``mended`` is there."""

    def act(self, observations: Sequence[Observation]) -> list[Any]:
        if not Path("mended").exists():
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observations)


class Server:
    """A server on a port of its own; ``what`` breaks from the answer number ``at``."""

    def __init__(self, what: str, at: int) -> None:
        self.what, self.at, self.asked, self.mended = what, at, 0, False
        self._over = threading.Event()
        self._listen(0)

    @property
    def broken(self) -> bool:
        return self.asked > self.at and not self.mended

    def mend(self) -> None:
        self.mended = True
        if self._listener.fileno() < 0:
            self._listen(self.port)

    def close(self) -> None:
        self.mended = True
        self._over.set()
        self._shut()

    def _shut(self) -> None:
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _listen(self, port: int) -> None:
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, args=(self._listener,), daemon=True).start()

    def _accept(self, listener: socket.socket) -> None:
        with suppress(OSError):
            while True:
                peer, _ = listener.accept()
                threading.Thread(target=self._talk, args=(peer,), daemon=True).start()

    def _talk(self, peer: socket.socket) -> None:
        with suppress(OSError), peer, peer.makefile("rb") as lines:
            while head := lines.readline():
                while (line := lines.readline()).strip():
                    head += line
                _, _, length = head.lower().partition(b"content-length:")
                lines.read(int(length.split()[0]) if length else 0)
                self.asked += 1
                if not self.broken:
                    peer.sendall(http(json.dumps(RIGHT.tolist()).encode()))
                elif self.what == "refuses":
                    self._shut()
                    return
                elif self.what == "resets":
                    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
                    return
                elif self.what == "hangs":
                    self._over.wait(1)
                    return
                else:
                    peer.sendall(REPLIES[self.what])
                    if self.what == "half":
                        return


def http(body: bytes, status: str = "200 OK", *more: str) -> bytes:
    head = "\r\n".join([f"HTTP/1.1 {status}", f"Content-Length: {len(body)}", *more])
    return head.encode() + b"\r\n\r\n" + body


REPLIES = {
    "500": http(PAGE, "500 Internal Server Error"),
    "HTML": http(PAGE),
    "half": http(json.dumps(RIGHT.tolist()).encode())[:-9],
    "redirect": http(b"", "307 Temporary Redirect", "Location: /other"),
    **{name: http(json.dumps(actions).encode()) for name, actions in ANSWERS.items()},
}
FAULTS = ("refuses", "resets", "hangs", *REPLIES)
