"""Oracle: how often a policy fails in the neighbourhood of scenes, within a limit on rollouts."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from vlafuzz.failures.triage.contrast import HOPELESS, evidence, likely, missing, shown
from vlafuzz.model import Rate, Scene, Verdict
from vlafuzz.store.records import Judged

CERTIFYING = 100_000  # first number of the rollouts that certify: none of them had a part in the search
UNFAIR, MOST_UNFAIR = 12, 200  # unfair jittered scenes after which a scene is unfair, and is drawn no more
BROKEN = 3  # crashes after which a scene counts as crashed
LEAD = 3  # failures more than passes, or the reverse: Wald's test of two rates, wrong in 2 to 5 %
LOW, HIGH = 0.2, 0.8  # these rates, if the policy fails at neither end by chance
SLACK = 0.2  # share of the way from the background to a failing scene's rate that makes them
MOST = 20  # rollouts to answer for a scene
FAILURES_A_PASS = 5  # of a scene that holds
MOST_TO_CERTIFY = 200  # rollouts to certify one
AGREES = 4  # evidence of fresh rollouts by themselves beside those of the run: at least two pairs
AT_ONCE = 4  # pairs that are rolled out together at most, for several workers: as many as suffice without chance


Roll = Callable[[Sequence[Scene], Sequence[int]], Sequence[Judged]]
Jitter = Callable[[Scene, int], Scene]  # the n-th scene around a scene


class Answer(Enum):
    """What a policy mostly does in a scene's neighbourhood; the values complete "the scene …"."""

    FAILS = "fails"
    PASSES = "passes"
    UNCLEAR = "fails at times"
    UNFAIR = "is not fair"
    BROKEN = "crashed"
    UNTRIED = "was not tried"


BLOCKING = {Answer.BROKEN, Answer.UNFAIR}  # a scene with one of these is rolled out no more


class Certificate(NamedTuple):
    """An answer for a scene, with the failure rate that it rests on."""

    answer: Answer
    rate: Rate


@dataclass(eq=False)
class Tally:
    """Rollouts in the neighbourhood of a scene.

    Attributes:
        next: number of the next rollout, which its jitter and its seed depend on.
        losses: the stage that each rollout lost, in order; None where it passed.
        earlier: whether each of some rollouts of the run failed, which count beside these.
    """

    scene: Scene
    next: int = 0
    losses: list[str | None] = field(default_factory=list)
    earlier: Sequence[bool] = ()
    unfair: int = 0
    broken: int = 0

    @property
    def rollouts(self) -> int:
        """Those that passed or failed."""
        return len(self.earlier) + len(self.losses)

    @property
    def problem(self) -> Answer | None:
        """Why nothing can be said about the scene."""
        if self.broken >= BROKEN:
            return Answer.BROKEN
        if self.rollouts:
            return None
        return Answer.UNFAIR if self.unfair >= UNFAIR else Answer.UNTRIED

    def add(self, judged: Judged) -> None:
        """Count a rollout."""
        self.unfair += judged.verdict is Verdict.INVALID
        self.broken += judged.verdict is Verdict.ERROR
        if judged.verdict >= Verdict.PASSED:
            self.losses.append(judged.lost)

    def failures(self, stages: Iterable[str], first: int | None = None) -> int:
        """Rollouts that lost one of these stages, of all or of the first ones."""
        counted = set(stages)
        return sum(lost in counted for lost in self.losses[:first])


class Oracle:
    """Answers with rollouts in jittered scenes. Each has another jitter and seed, so none repeats another.

    Args:
        roll: rolls the policy out, each scene with the seed of its number.
        stages: of the task, in order.
        jitter: None to repeat exactly the same scenes.
        budget: rollouts that may be spent.
        lead: failures more than passes, or the reverse, that make an answer.
        first: number of each scene's first rollout.

    Attributes:
        counted: the stages whose loss is a failure, by default all.
        spent: rollouts so far.
    """

    _up = _down = 1.0  # what a failure and a pass add to the lead of either answer

    def __init__(
        self, roll: Roll, stages: Sequence[str], jitter: Jitter | None, *, budget: int, lead: int = LEAD, first: int = 0
    ) -> None:
        self._roll, self._jitter, self.lead, self.budget = roll, jitter, lead, budget
        self._first, self._tallies = first, dict[tuple[Scene, int], Tally]()
        self.stages = self.counted = tuple(stages)
        self.spent = 0

    @property
    def room(self) -> int:
        """Rollouts that are left."""
        return max(self.budget - self.spent, 0)

    def count_up_to(self, lost: str) -> None:
        """Count as failures only those at this stage or an earlier one."""
        self.counted = self.stages[: self.stages.index(lost) + 1]

    def expect(self, background: float, failing: float) -> None:
        """Take scenes that fail no more often than the background for ones that pass."""
        low, high = background + SLACK * (failing - background), failing - SLACK * (failing - background)
        unit = math.log(HIGH / LOW)
        self._up, self._down = math.log(high / low) / unit, math.log((1 - low) / (1 - high)) / unit

    def answers(
        self, scenes: Sequence[Scene], stages: Sequence[str] | None = None, *, lead: int | None = None
    ) -> list[Answer]:
        """What the policy mostly does in each: cheap answers. ``stages``: those whose loss counts here."""

        def needed(tally: Tally) -> int:
            failures, rollouts = self._counts(tally.scene, stages)
            missing = (lead or self.lead) - abs(self._ahead(failures, rollouts))
            return min(max(math.ceil(missing / max(self._up, self._down)), 0), MOST - rollouts)

        self._draw_until([self._tally(scene) for scene in scenes], needed)
        return [self.known(scene, stages, lead=lead) or Answer.UNTRIED for scene in scenes]

    def fails(self, scenes: Sequence[Scene]) -> list[bool]:
        """Whether each still fails. A scene that is unfair, crashed or was not tried does not."""
        return [answer is Answer.FAILS for answer in self.answers(scenes)]

    def holds(self, scene: Scene, sure: int) -> bool:
        """Whether a scene fails so often as to go on from it: ``sure`` times, at most every sixth one passes.

        Of a stochastic policy, ``sure`` is the lead of its failures.
        """
        if self.lead > 1:
            return self.answers([scene], lead=max(self.lead, sure))[0] is Answer.FAILS

        def needed(tally: Tally) -> int:
            failures, rollouts = self._counts(tally.scene)
            return max(sure - failures, 0) if rollouts - failures <= failures // FAILURES_A_PASS else 0

        self._draw_until([self._tally(scene)], needed)
        failures, rollouts = self._counts(scene)
        return failures >= sure and rollouts - failures <= failures // FAILURES_A_PASS

    def known(self, scene: Scene, stages: Sequence[str] | None = None, *, lead: int | None = None) -> Answer | None:
        """The answer for a scene, if the rollouts so far give one, those that certify included."""
        failures, rollouts = self._counts(scene, stages)
        problem = self._tally(scene).problem
        if problem and not (rollouts and problem is not Answer.BROKEN):
            return None if problem is Answer.UNTRIED else problem
        ahead = self._ahead(failures, rollouts)
        if abs(ahead) >= (lead or self.lead):
            return Answer.FAILS if ahead > 0 else Answer.PASSES
        return Answer.UNCLEAR if rollouts >= MOST else None

    def repeated(self, scene: Scene, rollouts: int, stages: Sequence[str] | None = None) -> Rate:
        """A scene's rate after at least so many rollouts, if they can be had."""
        self._draw_until([self._tally(scene)], lambda tally: max(rollouts - tally.rollouts, 0))
        return self.rate(scene, stages)

    def rate(self, scene: Scene, stages: Sequence[str] | None = None) -> Rate:
        """Of the rollouts that gave a scene's answer."""
        return Rate.of_counts(*self._counts(scene, stages))

    def contrasts(
        self, scene: Scene, others: Sequence[Scene], stages: Sequence[str] | None = None, *, most: int = MOST_TO_CERTIFY
    ) -> list[Certificate]:
        """Whether each of other scenes passes more often, by fresh rollouts: as many there as in the scene.

        Those that are credited count beside them. It passes if the scene is ``shown`` to fail more often, it fails
        where an effect has become improbable. Stages count in the others; in the scene those of the finding.
        """
        subject = self._tally(scene, CERTIFYING)
        tallies = [self._tally(other, CERTIFYING) for other in others]

        def needed(tally: Tally) -> int:
            ends = map(until, tallies if tally is subject else [tally])
            return max(max(ends, default=0) - len(tally.losses), 0)

        def until(tally: Tally) -> int:
            """The fresh pairs after which it is looked again whether it passes."""
            (*_, pairs), more = self._fresh(subject, tally, stages), missing(*self._pairs(subject, tally, stages))
            over = self._contrast(subject, tally, stages) or {subject.problem, tally.problem} & BLOCKING
            return 0 if over or len(tally.losses) >= most else min(pairs + min(more, AT_ONCE), most)

        self._draw_until([subject, *tallies], needed)
        return [
            Certificate(
                tally.problem or self._contrast(subject, tally, stages) or Answer.UNCLEAR, self._rate(tally, stages)
            )
            for tally in tallies
        ]

    def credit(self, scene: Scene, failed: Sequence[bool]) -> None:
        """Let rollouts of a run, which were no part of why it suspects the scene, certify it, too."""
        self._tally(scene, CERTIFYING).earlier = failed

    def certified(self, scene: Scene) -> Rate:
        """Of the rollouts that certified a scene."""
        return self._rate(self._tally(scene, CERTIFYING), None)

    def _contrast(self, scene: Tally, other: Tally, stages: Sequence[str] | None) -> Answer | None:
        failures, without, pairs = self._pairs(scene, other, stages)
        if shown(failures, without, pairs) and evidence(*self._fresh(scene, other, stages)) >= AGREES:
            return Answer.PASSES
        return Answer.FAILS if likely(failures, pairs, without, pairs) < HOPELESS else None

    def _pairs(self, scene: Tally, other: Tally, stages: Sequence[str] | None) -> tuple[int, int, int]:
        """Failures of the scene and of the other one in as many rollouts of both, and this number."""
        failures, without, pairs = self._fresh(scene, other, stages)
        earlier = min(len(scene.earlier), len(other.earlier))
        return failures + sum(scene.earlier[:earlier]), without + sum(other.earlier[:earlier]), pairs + earlier

    def _fresh(self, scene: Tally, other: Tally, stages: Sequence[str] | None) -> tuple[int, int, int]:
        pairs = min(len(scene.losses), len(other.losses))
        return scene.failures(self.counted, pairs), other.failures(stages or self.counted, pairs), pairs

    def lost(self, scene: Scene, stages: Sequence[str] | None = None) -> str:
        """The stage that is mostly lost in a scene which is known to fail."""
        counts = Counter(self._tally(scene).losses + self._tally(scene, CERTIFYING).losses)
        return max(stages or self.counted, key=lambda stage: counts[stage])

    def sample(self, scenes: Sequence[Scene]) -> list[bool | None]:
        """Whether one more rollout in each fails; None where it cannot be judged, or the budget is spent.

        A scene that is given several times has as many rollouts.
        """
        tallies = [self._tally(scene) for scene in scenes]
        judged: list[Judged | None] = [*self._draw(tallies[: self.room])]
        judged += [None] * (len(scenes) - len(judged))
        return [one.lost in self.counted if one and one.verdict >= Verdict.PASSED else None for one in judged]

    def _ahead(self, failures: int, rollouts: int) -> float:
        """Failures more than passes, each weighed by what it tells."""
        return round(self._up * failures - self._down * (rollouts - failures), 9)

    def _counts(self, scene: Scene, stages: Sequence[str] | None = None) -> tuple[int, int]:
        """Failures and rollouts of a scene so far, those that certify included."""
        both = self._tally(scene), self._tally(scene, CERTIFYING)
        failures = sum(one.failures(stages or self.counted) + sum(one.earlier) for one in both)
        return failures, sum(one.rollouts for one in both)

    def _rate(self, tally: Tally, stages: Sequence[str] | None) -> Rate:
        return Rate.of_counts(tally.failures(stages or self.counted) + sum(tally.earlier), tally.rollouts)

    def _tally(self, scene: Scene, first: int = 0) -> Tally:
        return self._tallies.setdefault((scene, first), Tally(scene, self._first + first))

    def _draw_until(self, tallies: Sequence[Tally], needed: Callable[[Tally], int]) -> None:
        """Roll out, in batches, until no scene needs more rollouts or the budget is spent."""
        distinct = list(dict.fromkeys(tallies))
        while wanted := [
            tally
            for tally in distinct
            if tally.problem in (None, Answer.UNTRIED) and tally.unfair < MOST_UNFAIR
            for _ in range(needed(tally))
        ]:
            if not self.room:
                return
            self._draw(wanted[: self.room])

    def _draw(self, tallies: Sequence[Tally]) -> Sequence[Judged]:
        numbers = list[int]()
        for tally in tallies:  # each rollout of a scene has another number
            numbers.append(tally.next)
            tally.next += 1
        scenes = [tally.scene for tally in tallies]
        if self._jitter:
            scenes = list(map(self._jitter, scenes, numbers))
        judged = self._roll(scenes, numbers)
        for tally, answer in zip(tallies, judged, strict=True):
            tally.add(answer)
            self.spent += answer.rollouts
        return judged
