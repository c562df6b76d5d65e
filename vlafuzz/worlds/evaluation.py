"""Evaluator: scenes in, outcomes out; an evaluation pauses where the policy must act."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from vlafuzz.errors import PolicyError
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene
from vlafuzz.policies.base import ActionChunk, Observation, Policy
from vlafuzz.policies.harness import ask

FRAMES = 5  # of a film, for a second of the rollout
FILM_SPEED = 3  # times real time: a failing rollout takes 16 seconds
T = TypeVar("T")
Asking = Generator[Observation | float, ActionChunk | None, T]
Evaluation = Asking[Outcome]
"""The evaluation of one scene. It yields an observation where the policy must act, and is sent the chunk, or
thrown the PolicyError; or it yields a pause in seconds. It returns the outcome."""


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
        """The evaluation of a scene; no other may begin before it ends. Only PrerequisiteError is raised.

        ``seed``: of its first rollout; None for that of the conditions.
        """


def proceed(evaluation: Evaluation, answer: ActionChunk | PolicyError | None) -> Observation | float | Outcome:
    """Resume an evaluation with the policy's answer; None at its start and after a pause."""
    try:
        return evaluation.throw(answer) if isinstance(answer, PolicyError) else evaluation.send(answer)
    except StopIteration as over:
        outcome: Outcome = over.value
        return outcome


def drive(evaluation: Evaluation, policy: Policy) -> Outcome:
    """The outcome of an evaluation in which this policy acts."""
    asked = proceed(evaluation, None)
    while not isinstance(asked, Outcome):
        answer: ActionChunk | PolicyError | None = None
        if isinstance(asked, float):
            time.sleep(asked)
        else:
            try:
                answer = ask(policy, asked)
            except PolicyError as error:
                answer = error
        asked = proceed(evaluation, answer)
    return asked
