"""Evaluator: scenes in, outcomes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene

FILM_SPEED = 3  # times real time: a failing rollout takes 16 seconds


@dataclass(frozen=True, eq=False)
class Film:
    """A recorded rollout.

    Attributes:
        video: MP4.
        still: JPEG of the scene before anything moves.
        failed: whether the rollout failed.
    """

    video: bytes
    still: bytes
    failed: bool


class Evaluator(Protocol):
    """Runs a policy in scenes. A crash in a scene is not raised, it results in an ERROR outcome."""

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        """One outcome per scene, in order. Earlier scenes have no influence on it."""

    def close(self) -> None:
        """Release simulator and policy."""
