"""Evaluations that pause where the policy must act, so that several of them can share one call of it."""

import time
from collections.abc import Generator
from typing import TypeVar

from vlafuzz.errors import PolicyError
from vlafuzz.model.outcome import Outcome
from vlafuzz.policies.base import ActionChunk, Observation, Policy
from vlafuzz.policies.harness import ask

T = TypeVar("T")
Asking = Generator[Observation | float, ActionChunk | None, T]
Evaluation = Asking[Outcome]
"""The evaluation of one scene. It yields an observation where the policy must act, and is sent the chunk, or
thrown the PolicyError; or it yields a pause in seconds. It returns the outcome."""


def proceed(
    evaluation: Evaluation, answer: ActionChunk | PolicyError | None
) -> Observation | float | Outcome:
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
