"""Confirm: whether a scene fails again. Of a stochastic policy, by Wald's sequential test."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from vlafuzz.outcome import Verdict

RARELY, MOSTLY = 0.2, 0.8  # failure rates that are told apart
WRONG = 0.05  # probability of taking either for the other
MOST = 20  # repeats


@dataclass(frozen=True)
class Confirmation:
    """The result of repeating a finding.

    Attributes:
        repeats: those that could be judged, of which ``failures`` failed.
        confirmed: it mostly fails.
        refuted: it mostly passes. With neither it is flaky, or too many repeats could not be judged.
    """

    repeats: int
    failures: int
    confirmed: bool
    refuted: bool = False


def confirm(repeat: Callable[[int], Verdict], *, deterministic: bool) -> Confirmation:
    """Repeat a finding until it is clear whether it mostly fails; a deterministic policy once.

    Args:
        repeat: gives the verdict of the n-th repeat, from 0. A crash is not counted; an unfair scene ends
            the test.
    """
    evidence, failures, judged = 0.0, 0, 0
    step = math.log(MOSTLY / RARELY)  # the other way for a pass: the two rates are each other's complement
    bound = math.log((1 - WRONG) / WRONG)
    for number in range(1 if deterministic else MOST):
        verdict = repeat(number)
        if verdict is Verdict.INVALID:
            break
        if verdict is Verdict.ERROR:
            continue
        judged += 1
        failures += verdict is Verdict.FAILED
        evidence += step if verdict is Verdict.FAILED else -step
        if abs(evidence) >= bound:
            break
    if deterministic:
        return Confirmation(judged, failures, judged == failures == 1, judged == 1 and not failures)
    return Confirmation(judged, failures, evidence >= bound, evidence <= -bound)
