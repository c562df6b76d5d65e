"""Probes, the scenes of a corpus that are run again, and the outcomes of two policies in them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.regression.corpus import Corpus
from vlafuzz.scene import Scene
from vlafuzz.statistics import Share

Group = Literal["failing", "counterpart", "nominal"]
GROUPS: tuple[Group, ...] = ("failing", "counterpart", "nominal")
Standing = Literal["worse", "better", "passes", "fails", "error", "invalid", "not run"]


@dataclass(frozen=True, eq=False)
class Probe:
    """A scene that is run again.

    Attributes:
        group: the minimal ``failing`` scene of a case; its ``counterpart``, with one operator reset;
            or its ``nominal`` scene.
        what: the case, in a few words.
        run: index of the run whose conditions apply, in ``Corpus.runs``.
        passed: whether the corpus's own policy passed, as recorded.
    """

    scene: Scene
    group: Group
    what: str
    run: int
    passed: bool


def probes(corpus: Corpus) -> list[Probe]:
    """Every scene of a corpus once.

    In a failing scene, a policy can only improve on the one that failed there; in the others it can get
    worse. The counterpart of a case with one operator is its nominal scene, and counts as nominal.
    """
    by_scene: dict[Scene, Probe] = {}
    for case in corpus.cases:
        by_scene.setdefault(case.scene, Probe(case.scene, "failing", case.title, case.run, passed=False))
    for case in corpus.cases:
        what = f"{case.scene.digest[:8]}, all nominal"
        by_scene.setdefault(case.nominal, Probe(case.nominal, "nominal", what, case.run, case.nominal_passes))
    for case in corpus.cases:
        for operator, scene in case.counterparts.items():
            what = f"{case.scene.digest[:8]} without {operator}"
            by_scene.setdefault(scene, Probe(scene, "counterpart", what, case.run, passed=True))
    return list(by_scene.values())


class Answer(NamedTuple):
    """The result of one rollout. ``seconds``: wall time; ``detail``: the stage lost, or the error."""

    verdict: Verdict
    seconds: float = 0.0
    detail: str = ""

    @staticmethod
    def of(outcome: Outcome) -> Answer:
        """From the outcome of a scene that was rolled out once, or could not be."""
        seconds = sum(rollout.seconds for rollout in outcome.rollouts)
        lost = f"does not reach {outcome.lost_stage}" if outcome.lost_stage else ""
        return Answer(outcome.verdict, seconds, outcome.detail or lost)

    @property
    def judged(self) -> bool:
        """Whether it passed or failed."""
        return self.verdict >= Verdict.PASSED

    @property
    def passed(self) -> bool:
        return self.verdict is Verdict.PASSED


class Pair(NamedTuple):
    """The answers of baseline and policy in one scene, with the same seed."""

    baseline: Answer
    policy: Answer

    @property
    def judged(self) -> bool:
        return self.baseline.judged and self.policy.judged

    @property
    def worse(self) -> bool:
        return self.judged and self.baseline.passed and not self.policy.passed

    @property
    def better(self) -> bool:
        """Only the baseline failed."""
        return self.judged and self.policy.passed and not self.baseline.passed

    @property
    def discordant(self) -> bool:
        """Whether exactly one of the two failed."""
        return self.worse or self.better


@dataclass(frozen=True, eq=False)
class Compared:
    """A probe with its pairs: one if both policies are deterministic, else several with different seeds."""

    probe: Probe
    pairs: tuple[Pair, ...] = ()

    @property
    def judged(self) -> tuple[Pair, ...]:
        return tuple(pair for pair in self.pairs if pair.judged)

    @property
    def baseline_passed(self) -> int:
        return sum(pair.baseline.passed for pair in self.judged)

    @property
    def policy_passed(self) -> int:
        return sum(pair.policy.passed for pair in self.judged)

    @property
    def standing(self) -> Standing:
        """The policy against the baseline: ``passes`` or ``fails`` if both passed equally often."""
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
        """The first reason for a failure or error, the policy's before the baseline's; or empty."""
        details = [pair.policy.detail for pair in self.pairs] + [pair.baseline.detail for pair in self.pairs]
        return next(filter(None, details), "")

    @property
    def seconds(self) -> float:
        """Wall time of the policy's rollouts."""
        return sum(pair.policy.seconds for pair in self.pairs)


@dataclass(frozen=True)
class Tally:
    """Counts over the judged pairs of a group: passes of baseline and policy, and discordant pairs."""

    baseline: Share
    policy: Share
    worse: int
    better: int

    @staticmethod
    def of(compared: Iterable[Compared]) -> Tally:
        pairs = [pair for probe in compared for pair in probe.judged]
        return Tally(
            Share.of_counts(sum(pair.baseline.passed for pair in pairs), len(pairs)),
            Share.of_counts(sum(pair.policy.passed for pair in pairs), len(pairs)),
            sum(pair.worse for pair in pairs),
            sum(pair.better for pair in pairs),
        )
