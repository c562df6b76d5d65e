"""Interview: a policy is asked again about moments of its rollouts, with one thing in them changed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vlafuzz.diagnostics.answers import Answers, Array, Change
from vlafuzz.diagnostics.probes import Probe, ask, same
from vlafuzz.diagnostics.recorder import Moment
from vlafuzz.policies.base import Policy

FEW, MANY = 6, 24  # moments: of a policy that repeats itself, of one that does not


class Interview:
    """About moments of several scenes. Each is a rollout of its own for the policy.

    Raises:
        PolicyError: it breaks; so do the methods.

    Attributes:
        answers: to the moments as they were.
    """

    def __init__(self, policy: Policy, recorded: Sequence[Moment]) -> None:
        self._policy, self._recorded = policy, recorded
        for number in (FEW, MANY):
            self._moments = _spread(recorded, number)
            self.answers = Answers(policy.spec, self._ask(same), self._ask(same))
            if not self.answers.noise.any():
                break

    def change(self, probe: Probe) -> Change:
        """What a probe does to the answers."""
        return self.answers.change(self._ask(probe))

    def together(self) -> list[Array]:
        """The answers when as many as it takes are asked for at once."""
        most = self._policy.spec.max_batch
        groups = (self._moments[first : first + most] for first in range(0, len(self._moments), most))
        return [answer for group in groups for answer in ask(self._policy, group)]

    def _ask(self, probe: Probe) -> list[Array]:
        return [ask(self._policy, [probe(each, self._other(each))])[0] for each in self._moments]

    def _other(self, moment: Moment) -> Moment:
        """As far on in another scene."""

        def unlike(other: Moment) -> tuple[bool, int]:
            return other.start.episode == moment.start.episode, abs(other.seen.step - moment.seen.step)

        return min(self._recorded, key=unlike)


def _spread(moments: Sequence[Moment], number: int) -> list[Moment]:
    """So many of them, from the first to the last."""
    chosen = np.linspace(0, len(moments) - 1, min(number, len(moments))).round().astype(int)
    return [moments[index] for index in chosen]
