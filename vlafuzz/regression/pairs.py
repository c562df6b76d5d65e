"""Probes, the scenes of a corpus that are run again, and what two policies did in them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.regression.corpus import Corpus, Share
from vlafuzz.scene import Scene

Group = Literal["failing", "counterpart", "nominal"]
GROUPS: tuple[Group, ...] = ("failing", "counterpart", "nominal")
Standing = Literal["worse", "better", "passes", "fails", "error", "invalid", "not run"]


@dataclass(frozen=True, eq=False)
class Probe:
    """A scene that is run again.

    Attributes:
        group: minimal ``failing`` scene of a case; ``counterpart`` of one, which passes without one of its
            operators; ``nominal`` scene of one.
        what: of which case, in a few words.
        run: number of the run in whose conditions, in ``Bundle.runs``.
        passed: by the corpus's own policy, as recorded.
    """

    scene: Scene
    group: Group
    what: str
    run: int
    passed: bool


def probes(corpus: Corpus) -> list[Probe]:
    """Each scene of a corpus once.

    In the failing scenes a policy can only improve on the one that failed there; the others are where it can
    become worse. Without its only operator a case is nominal, and counts as that.
    """
    found: dict[Scene, Probe] = {}
    for case in corpus.cases:
        found.setdefault(case.scene, Probe(case.scene, "failing", case.title, case.run, passed=False))
    for case in corpus.cases:
        what = f"{case.scene.digest[:8]}, all nominal"
        found.setdefault(case.nominal, Probe(case.nominal, "nominal", what, case.run, case.nominal_passes))
    for case in corpus.cases:
        for operator, scene in case.counterparts.items():
            what = f"{case.scene.digest[:8]} without {operator}"
            found.setdefault(scene, Probe(scene, "counterpart", what, case.run, passed=True))
    return list(found.values())


class Answer(NamedTuple):
    """What came of one rollout. ``seconds``: wall time; ``detail``: which stage was lost, or what broke."""

    verdict: Verdict
    seconds: float = 0.0
    detail: str = ""

    @staticmethod
    def of(outcome: Outcome) -> Answer:
        """Of a scene that was rolled out once, or could not be."""
        seconds = sum(rollout.seconds for rollout in outcome.rollouts)
        lost = f"does not reach {outcome.lost_stage}" if outcome.lost_stage else ""
        return Answer(outcome.verdict, seconds, outcome.detail or lost)

    @staticmethod
    def of_record(*, passed: bool) -> Answer:
        """Of a scene that was rolled out long ago."""
        return Answer(Verdict.PASSED if passed else Verdict.FAILED)

    @property
    def judged(self) -> bool:
        """Whether it says something about the policy."""
        return self.verdict >= Verdict.PASSED

    @property
    def passed(self) -> bool:
        """Whether the policy did what it was told."""
        return self.verdict is Verdict.PASSED


class Pair(NamedTuple):
    """Baseline and policy in one scene, with the same seed."""

    baseline: Answer
    policy: Answer

    @property
    def judged(self) -> bool:
        """Whether both say something."""
        return self.baseline.judged and self.policy.judged

    @property
    def worse(self) -> bool:
        """Only the policy failed."""
        return self.judged and self.baseline.passed and not self.policy.passed

    @property
    def better(self) -> bool:
        """Only the baseline failed."""
        return self.judged and self.policy.passed and not self.baseline.passed

    @property
    def discordant(self) -> bool:
        """Whether it tells the two apart."""
        return self.worse or self.better


@dataclass(frozen=True, eq=False)
class Compared:
    """A probe with its pairs: one where both policies are deterministic, several with new seeds where not."""

    probe: Probe
    pairs: tuple[Pair, ...] = ()

    @property
    def judged(self) -> tuple[Pair, ...]:
        """The pairs that say something."""
        return tuple(pair for pair in self.pairs if pair.judged)

    @property
    def baseline_passed(self) -> int:
        """Judged pairs in which the baseline passed."""
        return sum(pair.baseline.passed for pair in self.judged)

    @property
    def policy_passed(self) -> int:
        """Judged pairs in which the policy passed."""
        return sum(pair.policy.passed for pair in self.judged)

    @property
    def standing(self) -> Standing:
        """How the policy stands in it: ``passes`` and ``fails`` where the baseline did as often."""
        if not self.pairs:
            return "not run"
        if not self.judged:
            answers = [answer.verdict for pair in self.pairs for answer in pair]
            return "error" if Verdict.ERROR in answers else "invalid"
        gained = self.policy_passed - self.baseline_passed
        if gained:
            return "better" if gained > 0 else "worse"
        return "passes" if 2 * self.policy_passed > len(self.judged) else "fails"

    @property
    def detail(self) -> str:
        """The first word of why: of the policy where it did not pass, else of the baseline; or empty."""
        told = [pair.policy.detail for pair in self.pairs] + [pair.baseline.detail for pair in self.pairs]
        return next(filter(None, told), "")

    @property
    def seconds(self) -> float:
        """Wall time of the policy's rollouts."""
        return sum(pair.policy.seconds for pair in self.pairs)


@dataclass(frozen=True)
class Tally:
    """A group in numbers: of the judged pairs, what baseline and policy passed, and how they differ."""

    baseline: Share
    policy: Share
    worse: int
    better: int

    @staticmethod
    def of(compared: Iterable[Compared]) -> Tally:
        """Count."""
        pairs = [pair for each in compared for pair in each.judged]
        return Tally(
            Share.of_counts(sum(pair.baseline.passed for pair in pairs), len(pairs)),
            Share.of_counts(sum(pair.policy.passed for pair in pairs), len(pairs)),
            sum(pair.worse for pair in pairs),
            sum(pair.better for pair in pairs),
        )
