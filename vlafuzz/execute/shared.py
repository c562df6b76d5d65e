"""Shared policy: a worker's stand-in for a policy that lives in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from multiprocessing import connection
from typing import Any

from vlafuzz.errors import PolicyError
from vlafuzz.execute.policy_process import Address, PolicyProcess
from vlafuzz.execute.worker_pool import Lost
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.batching import Request
from vlafuzz.policies.registry import make_policy

PATIENCE = 20.0  # seconds for a process that died to be restarted

_processes: dict[tuple[str, bool], tuple[PolicyProcess, list[SharedPolicy]]] = {}


class SharedPolicy:
    """Sends its observations to the policy process and waits; workers get it by pickling.

    When the process dies, the rollout is lost: the worker counts as lost, and its scenes are tried again.
    """

    def __init__(self, name: str, address: Address, key: bytes, spec: PolicySpec) -> None:
        self.name, self.spec = name, spec
        self._address, self._key = address, key
        self._pipe: Any = None
        self._number = 0
        self._live: list[tuple[EpisodeStart, str]] = []  # with the name of the rollout in the process
        self._over: list[str] = []

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_pipe": None}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """See ``Policy``."""
        first, self._number = self._number, self._number + len(episodes)
        begun = [(start, f"{number}/{start.episode}") for number, start in enumerate(episodes, first)]
        self._ask(Request(begin=[replace(start, episode=name) for start, name in begun]))
        self._live += begun

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """See ``Policy``."""
        names = {start.episode: name for start, name in self._live}
        renamed = [replace(seen, episode=names.get(seen.episode, seen.episode)) for seen in observations]
        return self._ask(Request(act=renamed))

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """Sent with the next request: garbage collection may call this in the middle of one."""
        self._over += [name for start, name in self._live if any(start is ended for ended in episodes)]
        self._live = [(start, name) for start, name in self._live if name not in self._over]

    def close(self) -> None:
        """In a worker: disconnect. In the process that created it: the last one ends the policy process."""
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None
        for key, (process, sharers) in list(_processes.items()):
            if any(sharer is self for sharer in sharers):
                sharers[:] = [sharer for sharer in sharers if sharer is not self]
                if not sharers:
                    del _processes[key]
                    process.close()

    def _ask(self, request: Request) -> list[ActionChunk]:
        over, self._over = self._over, []
        try:
            self._pipe = self._pipe or self._connect()
            self._pipe.send(replace(request, over=over))
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

    Args:
        everywhere: whether workers on other machines must reach it.

    Raises:
        VlafuzzError: the policy cannot be created.
    """
    key = name, everywhere
    if key not in _processes:
        process = PolicyProcess(name, partial(make_policy, name), everywhere=everywhere)
        _processes[key] = process, []
    process, sharers = _processes[key]
    sharers.append(SharedPolicy(name, process.address, process.key, process.spec))
    return sharers[-1]
