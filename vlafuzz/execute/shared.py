"""Shared: what workers have in place of a policy that lives in a host."""

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
from vlafuzz.policies.batching import Asked
from vlafuzz.policies.registry import make_policy

PATIENCE = 20.0  # seconds for a host that died to be there again

_hosts: dict[tuple[str, bool], tuple[PolicyProcess, list[Shared]]] = {}


class Shared:
    """Sends its observations to the host and waits; goes into workers by pickling.

    A host that dies takes the rollout along: the worker is lost, and its scenes are tried again.
    """

    def __init__(self, name: str, address: Address, key: bytes, spec: PolicySpec) -> None:
        self.name, self.spec = name, spec
        self._address, self._key = address, key
        self._pipe: Any = None
        self._number = 0
        self._live: list[tuple[EpisodeStart, str]] = []  # and what it is called there
        self._over: list[str] = []

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_pipe": None}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """See ``Policy``."""
        first, self._number = self._number, self._number + len(episodes)
        begun = [(start, f"{number}/{start.episode}") for number, start in enumerate(episodes, first)]
        self._ask(Asked(begin=[replace(start, episode=name) for start, name in begun]))
        self._live += begun

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """See ``Policy``."""
        known = {start.episode: name for start, name in self._live}
        named = [replace(seen, episode=known.get(seen.episode, seen.episode)) for seen in observations]
        return self._ask(Asked(act=named))

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """Told with the next question: this may be called in the middle of one."""
        self._over += [name for start, name in self._live if any(start is each for each in episodes)]
        self._live = [(start, name) for start, name in self._live if name not in self._over]

    def close(self) -> None:
        """In a worker: no more questions. Where it was made: the host ends with the last who shares it."""
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None
        for key, (host, sharers) in list(_hosts.items()):
            if any(each is self for each in sharers):
                sharers[:] = [each for each in sharers if each is not self]
                if not sharers:
                    del _hosts[key]
                    host.close()

    def _ask(self, asked: Asked) -> list[ActionChunk]:
        over, self._over = self._over, []
        try:
            self._pipe = self._pipe or self._connect()
            self._pipe.send(replace(asked, over=over))
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


def share(name: str, *, everywhere: bool = False) -> Shared:
    """The policy of that name in a host: the one that is there, or a new one.

    Args:
        everywhere: whether workers of other machines are to reach it.

    Raises:
        VlafuzzError: it cannot be made.
    """
    if (name, everywhere) not in _hosts:
        _hosts[name, everywhere] = (
            PolicyProcess(name, partial(make_policy, name), everywhere=everywhere),
            [],
        )
    host, sharers = _hosts[name, everywhere]
    sharers.append(Shared(name, host.address, host.key, host.spec))
    return sharers[-1]
