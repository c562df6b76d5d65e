"""Evaluator: scenes in, outcomes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene
from vlafuzz.worlds.stepping import Evaluation

FRAMES = 5  # of a film, for a second of the rollout
FILM_SPEED = 3  # times real time: a failing rollout takes 16 seconds


@dataclass(frozen=True, eq=False)
class Film:
    """A recorded rollout: an MP4, and a JPEG of the scene before anything moves."""

    video: bytes
    still: bytes
    failed: bool


class Evaluator(Protocol):
    """Runs a policy in scenes. A crash in a scene is not raised, it results in an ERROR outcome."""

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        """One outcome per scene, in order. Earlier scenes have no influence on it."""

    def close(self) -> None:
        """Release simulator and policy."""


class SteppedEvaluator(Evaluator, Protocol):
    """An evaluator whose policy may be asked by its user, together with others'."""

    def evaluation(self, scene: Scene, seed: int | None = None) -> Evaluation:
        """The evaluation of a scene, step by step; no other may begin before it ends.

        ``seed``: of its first rollout; None for that of the conditions.

        Only PrerequisiteError is raised.
        """
