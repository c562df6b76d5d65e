"""Policies with one planted fault each, made of healthy ones."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vlafuzz.doctor.probes import Lent
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, Policy
from vlafuzz.rollouts.policies import make_policy


class Changed(Lent):
    """A policy whose observations and answers are transformed."""

    def __init__(self, healthy: str | Policy, seen=lambda seen: seen, answer=lambda actions: actions, **spec) -> None:
        super().__init__(make_policy(healthy) if isinstance(healthy, str) else healthy)
        self._seen, self._answer, self._more = seen, answer, spec

    @property
    def spec(self):
        return replace(super().spec, **self._more)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        chunks = super().act([self._seen(seen) for seen in observations])
        return [ActionChunk(self._answer(np.array(chunk.actions))) for chunk in chunks]


def shown(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Observation], Observation]:
    """A transformation of pictures."""
    contiguous = np.ascontiguousarray
    return lambda seen: replace(seen, images={name: contiguous(change(each)) for name, each in seen.images.items()})


def blind(healthy: str) -> Policy:
    """Mini gets black pictures; pinhole always gets the first outlines."""
    first: list[Observation] = []

    def seen(observation: Observation) -> Observation:
        first.append(observation)
        return replace(shown(np.zeros_like)(observation), outlines=first[0].outlines)

    return Changed(healthy, seen)


class Deaf(Changed):
    """Always gets the same instruction."""

    def __init__(self, healthy: str) -> None:
        super().__init__(healthy, lambda seen: replace(seen, instruction="pick up green cube"))

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        super().reset([replace(start, instruction="pick up green cube") for start in episodes])


def answering(answer: Callable[[np.ndarray], np.ndarray]) -> Callable[[str], Policy]:
    return lambda healthy: Changed(healthy, answer=answer)


def nan(actions: np.ndarray) -> np.ndarray:
    actions[0, 2] = np.nan
    return actions


def nondeterministic(healthy: str) -> Policy:
    rng = np.random.default_rng(0)
    noise = [0.005, 0.005, 0.005, 0, 0, 0, 0]
    return Changed(healthy, answer=lambda actions: actions + rng.normal(size=actions.shape) * noise)


class Mixed(Changed):
    """In a batch, observations get each other's answers."""

    def __init__(self, healthy: str) -> None:
        super().__init__(healthy, max_batch=8)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return super().act(observations)[::-1]


class Offset(Changed):
    """Its chunks begin with past actions."""

    def __init__(self, healthy: str) -> None:
        super().__init__(healthy, max_batch=1)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        super().reset(episodes)
        self._before = np.array([[0.0] * 6 + [1.0]])

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        (chunk,) = super().act(observations)
        late = np.concatenate([self._before, chunk.actions])
        self._before = late[1:2]
        return [ActionChunk(late)]


def slow(healthy: str) -> Policy:
    def seen(observation: Observation) -> Observation:
        time.sleep(0.12)
        return observation

    changed = Changed(healthy, seen)
    return Changed(changed, action=replace(changed.spec.action, hz=10))


class Refusing(Changed):
    """Refuses every rollout."""

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        raise PolicyError("ws://gpu:8000: connection refused", cause="connect")


class Dropping(Changed):
    """The connection breaks in the middle of every episode."""

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        super().reset(episodes)
        self._left = 5

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        if not self._left:
            raise PolicyError("ws://gpu:8000: the connection broke", cause="connect")
        self._left -= 1
        return super().act(observations)


LIMITS = np.array([0.05, 0.05, 0.05, 0.2, 0.2, 0.2, 1.0])
FAULTS: dict[str, Callable[[str], Policy]] = {
    "blind": blind,
    "deaf": Deaf,
    "constant": answering(lambda actions: np.full_like(actions, 0.01)),
    "NaN": answering(nan),
    "saturated": answering(lambda actions: np.sign(actions) * LIMITS),
    "x and y swapped": answering(lambda actions: actions[:, [1, 0, 2, 3, 4, 5, 6]]),
    "gripper inverted": answering(lambda actions: actions * [1, 1, 1, 1, 1, 1, -1]),
    "BGR": lambda healthy: Changed(healthy, shown(lambda picture: picture[..., ::-1])),
    "upside down": lambda healthy: Changed(healthy, shown(lambda picture: picture[::-1])),
    "wrong scale": answering(lambda actions: actions * [0.05, 0.05, 0.05, 1, 1, 1, 1]),  # as in millimetres
    "batch order mixed": Mixed,
    "nondeterministic": nondeterministic,
    "chunk offset": Offset,
    "slow": slow,
    "refusing": Refusing,
    "dropping": Dropping,
}
