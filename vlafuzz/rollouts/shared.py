"""Shared policy: a process that runs a policy for all workers and batches their requests; their stand-ins."""

from __future__ import annotations

import faulthandler
import os
import shutil
import signal
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing import AuthenticationError, connection, get_context
from tempfile import TemporaryDirectory
from threading import Lock, Thread
from typing import Any

from vlafuzz.errors import PolicyError, UsageError, VlafuzzError
from vlafuzz.policies.base import ActionChunk, Policy, PolicySpec
from vlafuzz.policies.batching import Answer, Request, ServedPolicy, StandIn
from vlafuzz.policies.harness import release
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.processes import cause_of_death
from vlafuzz.rollouts.worker_pool import Lost

Address = str | tuple[str, int]  # path of a socket, or host and port
LONGEST = 240.0  # seconds for an answer: less than the timeout of a scene, so that this process is blamed
CLOSING = 5.0  # seconds for the policy to release its resources
PATIENCE = 20.0  # seconds for a process that died to be restarted

_processes: dict[tuple[str, bool], tuple[PolicyProcess, list[SharedPolicy]]] = {}


class SharedPolicy(StandIn):
    """A ``Policy`` that sends its observations to the policy process; workers get it by pickling.

    When the process dies, the rollout is lost: the worker counts as lost, and its scenes are tried again.
    """

    def __init__(self, name: str, address: Address, key: bytes, spec: PolicySpec) -> None:
        super().__init__(spec)
        self.name, self._address, self._key = name, address, key
        self._pipe: Any = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_pipe": None}

    def close(self) -> None:
        """In a worker: disconnect. In the process that created it: the last one ends the policy process."""
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None
        for key, (process, sharers) in list(_processes.items()):
            if self in sharers:
                sharers.remove(self)
                if not sharers:
                    del _processes[key]
                    process.close()

    def _answer(self, request: Request) -> list[ActionChunk]:
        try:
            self._pipe = self._pipe or self._connect()
            self._pipe.send(request)
            answer = self._pipe.recv()
        except (EOFError, OSError):
            raise Lost(f"the process of {self.name} died") from None
        if isinstance(answer, PolicyError):
            raise answer
        return answer  # type: ignore[no-any-return]

    def _connect(self) -> Any:
        until = time.monotonic() + PATIENCE
        while True:
            try:
                return connection.Client(self._address, authkey=self._key)
            except (EOFError, OSError):
                if time.monotonic() > until:
                    raise
            time.sleep(0.1)


def share(name: str, *, everywhere: bool = False) -> SharedPolicy:
    """The policy of that name in its process, which is started when there is none yet.

    ``everywhere``: whether workers on other machines must reach it. VlafuzzError when it cannot be made.
    """
    key = name, everywhere
    if key not in _processes:
        process = PolicyProcess(name, partial(make_policy, name), everywhere=everywhere)
        _processes[key] = process, []
    process, sharers = _processes[key]
    sharers.append(SharedPolicy(name, process.address, process.key, process.spec))
    return sharers[-1]


class PolicyProcess:
    """Starts the process, and starts another one when it dies.

    Args:
        name: of the policy, for messages.
        make: creates the policy in the process; picklable.
        everywhere: whether workers on other machines must reach it.
        longest: seconds for an answer before the process counts as hung and ends.
    """

    def __init__(
        self, name: str, make: Callable[[], Policy], *, everywhere: bool = False, longest: float = LONGEST
    ) -> None:
        self.name, self._make, self._longest = name, make, longest
        self.key = os.urandom(32)  # only clients with this key are accepted
        self._folder = TemporaryDirectory(prefix="vlafuzz-")
        self.address: Address = (_own_address(), 0) if everywhere else f"{self._folder.name}/policy"
        self._lock, self._closed = Lock(), False
        self._spawn()
        try:
            self.address, self.spec = self._greeting()
        except BaseException:
            self.close()
            raise
        Thread(target=self._watch, daemon=True).start()

    def close(self) -> None:
        with self._lock:
            self._closed = True
            if self._ready:
                with suppress(OSError):
                    self._pipe.send(None)
                self._process.join(CLOSING)
            self._process.kill()
            self._process.join()
            self._pipe.close()
            self._folder.cleanup()

    def _spawn(self) -> None:
        context, self._ready = get_context("spawn"), False
        self._pipe, child_end = context.Pipe()
        arguments = (self._make, self.address, self.key, child_end, self._longest)
        self._process = context.Process(target=_main, args=arguments, daemon=True)
        self._process.start()
        child_end.close()

    def _greeting(self) -> tuple[Address, PolicySpec]:
        """Wait until the policy is created; the address of the process and the policy's spec."""
        try:
            message = self._pipe.recv()
        except (EOFError, OSError):
            cause = cause_of_death(self._process)
            raise PolicyError(f"{self.name}: the process that was to make it {cause}") from None
        if isinstance(message, VlafuzzError):
            raise message
        self._ready = True
        return message  # type: ignore[no-any-return]

    def _watch(self) -> None:
        """Restart the process whenever it dies, unless it dies before it is ready."""
        while True:
            connection.wait([self._process.sentinel])
            with self._lock:
                if self._closed:
                    return
                self._spawn()
            try:
                self._greeting()
            except VlafuzzError:
                return


def _main(make: Callable[[], Policy], address: Address, key: bytes, parent: Any, longest: float) -> None:
    """The process, which runs until the parent ends it or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this process
    faulthandler.register(signal.SIGALRM, chain=True)  # of an answer that takes too long: it says where, and ends this
    sys.stdout = sys.stderr  # a policy may print, and stdout is for data
    if isinstance(address, str):
        with suppress(FileNotFoundError):
            os.unlink(address)  # left over from a process that was killed
    with connection.Listener(address, backlog=128, authkey=key) as listener:
        try:
            policy = make()
        except Exception as error:
            broken = UsageError(f"the policy cannot be made: {type(error).__name__}: {error}")
            parent.send(error if isinstance(error, VlafuzzError) else broken)
            return
        Thread(target=_accept, args=(listener, ServedPolicy(policy, longest=longest)), daemon=True).start()
        parent.send((listener.address, policy.spec))
        with suppress(EOFError, OSError):
            parent.recv()
        release(policy)
    if isinstance(address, str):  # the parent does the same, unless it was killed
        shutil.rmtree(os.path.dirname(address), ignore_errors=True)


def _accept(listener: connection.Listener, served: ServedPolicy) -> None:
    while True:
        try:
            pipe = listener.accept()
        except (OSError, EOFError, AuthenticationError):  # the connection broke, or is not a worker's
            continue
        Thread(target=_talk, args=(served, pipe), daemon=True).start()


def _talk(served: ServedPolicy, pipe: Any) -> None:
    """Answer the requests of a worker until it is gone."""
    caller = next(served.newcomers)
    with suppress(EOFError, OSError):
        while True:
            request: Request = pipe.recv()
            try:
                answer: Answer = list(served.ask(caller, request))
            except PolicyError as error:
                answer = error
            pipe.send(answer)
    served.leave(caller)


def _own_address() -> str:
    """This machine's address, as other machines see it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("10.255.255.255", 1))  # sends nothing; the system chooses the route
        except OSError:
            return "127.0.0.1"
        return str(probe.getsockname()[0])
