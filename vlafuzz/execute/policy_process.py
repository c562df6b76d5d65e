"""Host: the process in which a policy lives that all workers share."""

from __future__ import annotations

import faulthandler
import os
import signal
import socket
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import AuthenticationError, connection, get_context
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from threading import Lock, Thread
from typing import Any

from vlafuzz.errors import PolicyError, UsageError, VlafuzzError
from vlafuzz.execute.processes import cause_of_death
from vlafuzz.policies.base import Policy, PolicySpec
from vlafuzz.policies.batching import Asked, BatchingPolicy

Address = str | tuple[str, int]  # a path, or host and port
LONGEST = 240.0  # seconds for an answer: less than a worker waits for a scene, so that the host is to blame
CLOSING = 5.0  # seconds for the policy to let go of what it holds


class PolicyProcess:
    """Runs the process, and starts another one when it dies.

    Args:
        name: of the policy, for messages.
        make: makes it, in the process; picklable.
        everywhere: whether workers of other machines are to reach it.
        longest: seconds for an answer before the process counts as hung, and ends.
    """

    def __init__(
        self, name: str, make: Callable[[], Policy], *, everywhere: bool = False, longest: float = LONGEST
    ) -> None:
        self.name, self._make, self._longest = name, make, longest
        self.key = os.urandom(32)  # who does not know it is not listened to
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
        """End it."""
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
        self._pipe, theirs = context.Pipe()
        given = (self._make, self.address, self.key, theirs, self._longest)
        self._process = context.Process(target=_live, args=given, daemon=True)
        self._process.start()
        theirs.close()

    def _greeting(self) -> tuple[Address, PolicySpec]:
        """Where it listens and what it is, once it is made."""
        try:
            told = self._pipe.recv()
        except (EOFError, OSError):
            died = cause_of_death(self._process)
            raise PolicyError(f"{self.name}: the process that was to make it {died}") from None
        if isinstance(told, VlafuzzError):
            raise told
        self._ready = True
        return told  # type: ignore[no-any-return]

    def _watch(self) -> None:
        """Start it again whenever it dies, unless it dies before it is ready."""
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


def _live(make: Callable[[], Policy], address: Address, key: bytes, parent: Any, longest: float) -> None:
    """The process's life, until the parent says so or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, who ends this process
    if isinstance(address, str):
        with suppress(FileNotFoundError):
            os.unlink(address)  # of the process before, which was killed
    with connection.Listener(address, backlog=128, authkey=key) as listener:
        try:
            policy = make()
        except VlafuzzError as error:
            parent.send(error)
            return
        except Exception as error:
            parent.send(UsageError(f"the policy cannot be made: {type(error).__name__}: {error}"))
            return
        inbox: SimpleQueue[_Letter | None] = SimpleQueue()
        for target, source in ((_accept, listener), (_end_with, parent)):
            Thread(target=target, args=(source, inbox), daemon=True).start()
        parent.send((listener.address, policy.spec))
        _work(policy, inbox, longest)
        policy.close()


_Letter = tuple[int, Any, Asked | None]  # who, the connection to answer on, what; None: gone


def _work(policy: Policy, inbox: SimpleQueue[_Letter | None], longest: float) -> None:
    """Answer what has arrived, all of it at once; what comes meanwhile is for the next time."""
    batching = BatchingPolicy(policy)
    while True:
        letters = [inbox.get()]
        while not inbox.empty():
            letters.append(inbox.get())
        if None in letters:
            return
        asked = [(who, pipe, what) for who, pipe, what in filter(None, letters) if what]
        faulthandler.dump_traceback_later(longest, exit=True)
        answers = batching.answer([(who, what) for who, _, what in asked])
        faulthandler.cancel_dump_traceback_later()
        for (_, pipe, _), answer in zip(asked, answers, strict=True):
            with suppress(OSError):  # it is gone meanwhile
                pipe.send(answer)
        for who, _, what in filter(None, letters):
            if what is None:
                batching.leave(who)


def _accept(listener: connection.Listener, inbox: SimpleQueue[_Letter | None]) -> None:
    number = 0
    while True:
        try:
            pipe = listener.accept()
        except (OSError, EOFError, AuthenticationError):  # its side broke, or it is no worker
            continue
        number += 1
        Thread(target=_read, args=(number, pipe, inbox), daemon=True).start()


def _read(number: int, pipe: Any, inbox: SimpleQueue[_Letter | None]) -> None:
    with suppress(EOFError, OSError):
        while True:
            inbox.put((number, pipe, pipe.recv()))
    inbox.put((number, pipe, None))


def _end_with(parent: Any, inbox: SimpleQueue[_Letter | None]) -> None:
    with suppress(EOFError, OSError):
        parent.recv()
    inbox.put(None)


def _own_address() -> str:
    """This machine's, as others see it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("10.255.255.255", 1))  # sends nothing; the system chooses the way
        except OSError:
            return "127.0.0.1"
        return str(probe.getsockname()[0])
