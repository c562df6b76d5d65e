"""Forecast: how long a run takes, or how far it gets, by the seconds of an answer and a rollout's steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from vlafuzz.campaign.config import Plan
from vlafuzz.common.deadline import Deadline
from vlafuzz.common.text import duration, plural
from vlafuzz.failures.triage.pipeline import PER_CAUSE, affordable
from vlafuzz.policies.base import PolicySpec
from vlafuzz.policies.clients.servers import is_remote
from vlafuzz.rollouts.lockstep import lanes_for
from vlafuzz.rollouts.policies import is_shared
from vlafuzz.rollouts.registry import lanes_at
from vlafuzz.store.records import Manifest
from vlafuzz.worlds import world_of

# Steps of a rollout as shares of the longest: a success takes a third, a failure all; of `mini`, half fail.
SHORT, USUAL = 0.35, 0.7
NOBODY_WAITS = 10.0  # seconds below which nothing is said
# Seconds for a control step with the simulator, of built-in policies on one core of a usual server.
_STEP = {"mini": 0.013, "pinhole": 0.003, "expert": 0.003, "seeing": 0.01, "random": 0.002, "frozen": 0.002}


@dataclass(frozen=True, kw_only=True)
class Speed:
    """How fast a policy is, and the simulator with it.

    Attributes:
        answer: seconds for the answer to one observation; ``batched``: for ``batch`` observations at once.
        simulator: seconds between two answers of a rollout.
        actions: control steps that are executed of an answer.
        words: what it rests on, as a part of a sentence.
    """

    answer: float
    simulator: float
    actions: int = 1
    batch: int = 1
    batched: float = 0.0
    words: str = ""

    def at_once(self, number: int) -> float:
        """Seconds for the answers to so many observations."""
        if self.batch == 1 or number == 1:
            return self.answer * number
        if number >= self.batch:
            return self.batched * math.ceil(number / self.batch)
        return self.answer + (self.batched - self.answer) * (number - 1) / (self.batch - 1)


def usual_speed(plan: Plan) -> Speed | None:
    """The speed of a built-in policy, as it usually is; None for others."""
    policy = plan.manifest.policy
    if policy not in _STEP:
        return None
    return Speed(answer=_STEP[policy], simulator=0.0, words=f"at the usual speed of {policy}")


def at_a_time(plan: Plan) -> int:
    """The number of rollouts that a run has at a time."""
    return min(plan.manifest.batch, max(plan.place.workers, lanes_at(plan.place, plan.policy)))


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
        place = self.plan.place
        lanes = min(lanes_at(place, self.plan.policy), self.plan.manifest.batch)
        return self._answers * self._answer(place.workers, lanes)

    @property
    def certification(self) -> float:
        """Seconds for the causes that a run with this budget certifies, if it finds so many."""
        return self.of_cause * affordable(self.plan.manifest.budget) if self.certify else 0.0

    @property
    def of_cause(self) -> float:
        """Seconds to certify a cause."""
        lanes = (lanes_for(self.plan.policy) + 1) // 2  # triage fills half of them, about
        return PER_CAUSE * self._answers * self._answer(self.plan.triage_place.workers, lanes)

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

    @property
    def _answers(self) -> float:
        """Answers in a usual rollout."""
        return USUAL * longest(self.plan.policy.spec, self.plan.manifest) / self.speed.actions

    def _answer(self, workers: int, lanes: int) -> float:
        """Seconds per answer with so many workers, or so many rollouts at a time in one process."""
        speed = self.speed
        if lanes > 1:
            return speed.at_once(lanes) / lanes + speed.simulator
        together = is_remote(self.plan.policy) or is_shared(self.plan.manifest.policy)
        return ((speed.at_once(workers) if together else speed.answer) + speed.simulator) / workers
