"""Probes, the scenes of a corpus that are run again, outcomes of two policies in them, and what changed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from vlafuzz.common.statistics import Share, sign_p
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.model import Outcome, Scene, Verdict

Group = Literal["control", "failing"]
Standing = Literal["worse", "better", "passes", "fails", "error", "invalid", "not run"]


@dataclass(frozen=True, eq=False)
class Probe:
    """A scene that is run again.

    Attributes:
        group: a random ``control``, or the minimal ``failing`` scene of a case.
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
    """The controls of a corpus, then the failing scenes, each once.

    The latter were selected because the corpus's own policy fails there, where any other one can only improve.
    """
    by_scene: dict[Scene, Probe] = {}
    for control in corpus.controls:
        by_scene.setdefault(control.scene, Probe(control.scene, "control", "random", 0, control.passed))
    for case in corpus.cases:
        by_scene.setdefault(case.scene, Probe(case.scene, "failing", case.title, case.run, passed=False))
    return list(by_scene.values())


class Pair(NamedTuple):
    """The outcomes of baseline and policy in one scene that was rolled out once, or could not be."""

    baseline: Outcome
    policy: Outcome

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
    def lacking(self) -> bool:
        """Whether it could not be judged as something broke, and might have been worse."""
        may_pass = self.baseline.verdict in (Verdict.ERROR, Verdict.PASSED)
        may_fail = self.policy.verdict in (Verdict.ERROR, Verdict.FAILED)
        return may_pass and may_fail and not self.judged


@dataclass(frozen=True, eq=False)
class Compared:
    """A probe with its pairs: one of a control, of other scenes several with different jitters and seeds."""

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
    def passes(self) -> bool:
        """Whether the policy mostly passes."""
        return 2 * self.policy_passed > len(self.judged)

    @property
    def standing(self) -> Standing:
        """The policy against the baseline, each by what it mostly does."""
        if not self.pairs:
            return "not run"
        if not self.judged:
            verdicts = [outcome.verdict for pair in self.pairs for outcome in pair]
            return "error" if Verdict.ERROR in verdicts else "invalid"
        if self.passes is (2 * self.baseline_passed > len(self.judged)):
            return "passes" if self.passes else "fails"
        return "better" if self.passes else "worse"

    @property
    def detail(self) -> str:
        """The first reason for a failure or error, the policy's before the baseline's; or empty."""
        outcomes = [pair.policy for pair in self.pairs] + [pair.baseline for pair in self.pairs]
        lost = (one.detail or (f"does not reach {one.lost_stage}" if one.lost_stage else "") for one in outcomes)
        return next(filter(None, lost), "")


@dataclass(frozen=True)
class Tally:
    """Counts over the judged pairs of some scenes: passes of baseline and policy.

    Attributes:
        worse: scenes in which the baseline passes and the policy fails; ``better``: the other way round.
    """

    baseline: Share
    policy: Share
    worse: int
    better: int

    @staticmethod
    def of(compared: Sequence[Compared]) -> Tally:
        """The intervals are those of independent pairs, as controls have, which are rolled out once each."""
        pairs = [pair for scene in compared for pair in scene.judged]
        return Tally(
            Share.of_counts(sum(pair.baseline.passed for pair in pairs), len(pairs)),
            Share.of_counts(sum(pair.policy.passed for pair in pairs), len(pairs)),
            sum(scene.standing == "worse" for scene in compared),
            sum(scene.standing == "better" for scene in compared),
        )


@dataclass(frozen=True, kw_only=True)
class Fixed:
    """Counts what became of scenes in which the baseline mostly fails.

    These were selected by what the corpus's own policy does there, so nothing follows for scenes that nobody selected.
    But the rollouts of another policy had no part in it, and what they say about these is valid.

    Attributes:
        changed: scenes in which the policy mostly passes; ``of`` so many that were judged.
        p_value: that it does so nowhere; see ``fixed``.
        alpha: bound on the probability that a change is shown where there is none.
    """

    changed: int
    of: int
    p_value: float
    alpha: float

    @property
    def shown(self) -> bool:
        """Whether at least one scene has really changed."""
        return self.p_value <= self.alpha

    def __str__(self) -> str:
        return f"p = {self.p_value:.2g}"


def fixed(compared: Sequence[Compared], alpha: float, *, recorded: bool) -> Fixed:
    """The failing scenes that pass now.

    Where the baseline's outcomes are recorded, it is certified to fail in half of the rollouts or more. If the policy
    did so too in every scene, all r rollouts of one would pass with probability 2**-r at most; the p-value is that of
    as many such scenes. Where the baseline was rolled out as well, each pair of rollouts of which only one passes would
    be as likely one of the policy's (sign test).
    """
    from scipy.stats import poisson_binom

    judged = [scene for scene in compared if scene.probe.group == "failing" and scene.judged]
    standings = Counter[str](scene.standing for scene in judged)
    of = len(judged)
    if recorded:
        outright = sum(scene.policy_passed == len(scene.judged) for scene in judged)
        chances = [0.5 ** len(scene.judged) for scene in judged]
        several = np.arange(outright, len(judged) + 1)
        p_value = min(float(poisson_binom.pmf(several, chances).sum()), 1.0) if judged else 1.0
    else:
        of = standings["better"] + standings["fails"]
        pairs = [pair for scene in judged for pair in scene.judged]
        p_value = float(sign_p(sum(pair.better for pair in pairs), sum(pair.worse for pair in pairs)))
    return Fixed(changed=standings["better"], of=of, p_value=p_value, alpha=alpha)
