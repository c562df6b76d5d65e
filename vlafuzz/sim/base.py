"""Evaluator: scenes in, outcomes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene

FILM_SPEED = 3  # times real time: a policy that fails has 16 seconds to do so


@dataclass(frozen=True, eq=False)
class Film:
    """One rollout.

    Attributes:
        video: MP4.
        still: JPEG of the scene before anything moves.
        failed: whether the rollout did.
    """

    video: bytes
    still: bytes
    failed: bool


class Evaluator(Protocol):
    """Runs a policy in scenes. Never raises for what a scene does; a crash is an ERROR outcome."""

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        """One outcome a scene, in order: the same for the same scene, whatever was evaluated before."""

    def close(self) -> None:
        """No more scenes."""
