"""Forecast: how long a run takes, or how far it gets, by the seconds of an answer and a rollout's steps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from vlafuzz.campaign.config import Plan
from vlafuzz.common.deadline import Deadline
from vlafuzz.common.plugins import is_reference
from vlafuzz.common.text import duration, plural
from vlafuzz.failures.triage.pipeline import PER_CAUSE, affordable
from vlafuzz.policies.base import PolicySpec
from vlafuzz.policies.clients.servers import is_remote
from vlafuzz.rollouts.policies import is_shared
from vlafuzz.rollouts.registry import lanes_at
from vlafuzz.store.records import Manifest
from vlafuzz.worlds import world_of

# Steps of a rollout as shares of the longest: a success takes a third, a failure all; of `mini`, half fail.
SHORT, USUAL = 0.35, 0.7
NOBODY_WAITS = 10.0  # seconds below which nothing is said
# Seconds for a control step with the simulator, of built-in policies on one core of a usual server.
_STEP = {"mini": 0.013, "pinhole": 0.003, "expert": 0.003, "seeing": 0.01, "random": 0.002, "frozen": 0.002}


class Speed(NamedTuple):
    """How fast the rollouts of a plan are: ``step`` is seconds per control step, of as many as it has at a time.

    ``words`` say what that rests on, as a part of a sentence.
    """

    step: float
    words: str = ""


def usual_speed(plan: Plan) -> Speed | None:
    """The speed of a built-in policy in our worlds, as it usually is; None for others."""
    policy = plan.manifest.policy
    known = policy in _STEP and not is_reference(plan.manifest.task)
    return Speed(_STEP[policy] / plan.place.workers, f"at the usual speed of {policy}") if known else None


def at_a_time(plan: Plan) -> int:
    """The number of rollouts that a run has at a time."""
    return min(plan.manifest.batch, max(plan.place.workers, lanes_at(plan.place, plan.policy)))


def answered_together(plan: Plan) -> bool:
    """Whether all rollouts that a run has at a time wait for one policy."""
    several = lanes_at(plan.place, plan.policy) > 1
    return several or is_remote(plan.policy) or is_shared(plan.manifest.policy)


def longest(spec: PolicySpec, manifest: Manifest) -> int:
    """Control steps of a rollout that does not succeed."""
    robot = world_of(manifest.task).robot(manifest.robot)
    return robot.seconds * (robot.control_hz or spec.action.hz)


@dataclass(frozen=True)
class Forecast:
    """How long a plan will take, with or without certification of its causes, or how far it gets in a time.

    Attributes:
        search: when no rollout of the run is begun any more; ``until``: when certification ends, too.
    """

    plan: Plan
    speed: Speed
    certify: bool
    search: Deadline = field(default_factory=Deadline)
    until: Deadline = field(default_factory=Deadline)

    @property
    def run(self) -> float:
        """Seconds of what is left of the run, were there no deadline."""
        return self.left * self.rollout

    @property
    def rollout(self) -> float:
        """Seconds of the run per rollout."""
        return USUAL * longest(self.plan.policy.spec, self.plan.manifest) * self.speed.step

    @property
    def certification(self) -> float:
        """Seconds for the causes that a run with this budget certifies, if it finds so many."""
        return self.of_cause * affordable(self.plan.manifest.budget) if self.certify else 0.0

    @property
    def of_cause(self) -> float:
        """Seconds to certify a cause, which as many workers do as triage has."""
        return PER_CAUSE * self.rollout * self.plan.place.workers / self.plan.triage_place.workers

    @property
    def too_short(self) -> bool:
        """Whether the time that is left after the run probably certifies no cause."""
        rest = self.until.left - min(self.run, self.search.left)
        return self.certify and rest < self.of_cause

    @property
    def left(self) -> int:
        """Rollouts that are to be done: of a run that is resumed, the rest."""
        return self.plan.manifest.budget - self.plan.done

    def __str__(self) -> str:
        both = self.run + self.certification
        steps = longest(self.plan.policy.spec, self.plan.manifest)
        rollouts = f"{'the other ' * bool(self.plan.done)}{plural(self.left, 'rollout')} of up to {steps} steps"
        low, high = (duration(self.run * share / USUAL) for share in (SHORT, 1.0))
        then = f", certifying their causes about {duration(self.certification)}" if self.certify else ""
        if self.run > self.search.left or both > self.until.left:
            then += f"; --time ends it after {duration(self.until.left)}"
            then += ", probably before a cause is certified" if self.too_short else ""
        return f"about {duration(both)}: {rollouts} take {low} to {high}{then}; {self.speed.words}"

    def of_tasks(self, tasks: int) -> str:
        """The forecast of so many runs like this one, one after another; empty where nobody has to wait."""
        if tasks * self.run <= NOBODY_WAITS:
            return ""
        if tasks == 1:
            return str(self)
        whole = tasks * min(self.run + self.certification, self.until.left)
        return f"{tasks} tasks, one after another: about {duration(whole)} in all; each {self}"
