"""Policies made unreliable on purpose: in a share of its rollouts mini lets every grasp go.

``python:slippery:ten`` in this folder does so in 10 % of them, ``twenty`` in 20 % and ``forty`` in 40 %, and
``libero_twenty`` is mini-libero that does in 20 %. Scene and seed decide, so that a rollout can be repeated. Letting
single grasps go is not enough: mini always grasped again, and 90 nominal rollouts passed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from zlib import crc32

import numpy as np

from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.mini.policy import SHIPPED, Mini

HELD = 4  # control steps for which a grasp holds before the gripper opens


class Slippery:
    """Mini, or the one that such a folder has, whose gripper opens soon after each grasp in a share of the rollouts."""

    def __init__(self, share: float, folder: Path = SHIPPED) -> None:
        self._mini, self._share = Mini(folder), share
        self.spec = replace(self._mini.spec, name=f"{self._mini.spec.name}-slippery-{share:.2f}")
        self._closed: dict[str, int] = {}  # steps since the gripper closed, of the rollouts that slip

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._mini.reset(episodes)
        for one in episodes:  # whose names are of scene and seed
            if np.random.default_rng(crc32(one.episode.encode())).random() < self._share:
                self._closed[one.episode] = 0

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        chunks = self._mini.act(observations)
        return [self._slipping(seen.episode, chunk) for seen, chunk in zip(observations, chunks, strict=True)]

    def close(self) -> None:
        self._mini.close()
        self._closed.clear()

    def _slipping(self, episode: str, chunk: ActionChunk) -> ActionChunk:
        if episode not in self._closed:
            return chunk
        closing = chunk.actions[0, 6] < 0
        self._closed[episode] = self._closed[episode] + 1 if closing else 0
        if self._closed[episode] <= HELD:
            return chunk
        opened = chunk.actions.copy()
        opened[:, 6] = 1.0
        return ActionChunk(opened)


def ten() -> Slippery:
    """Fails about one rollout in ten by chance."""
    return Slippery(0.1)


def twenty() -> Slippery:
    """Fails about one rollout in five by chance."""
    return Slippery(0.2)


def forty() -> Slippery:
    """Fails about two rollouts in five by chance."""
    return Slippery(0.4)


def libero_twenty() -> Slippery:
    """Acts in LIBERO, and fails about one rollout in five by chance."""
    return Slippery(0.2, SHIPPED / "libero")
