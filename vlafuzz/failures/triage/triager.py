"""Triager: confirms, witnesses, shrinks, certifies and attributes a finding. It imports no simulator."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

from vlafuzz.common.deadline import Deadline
from vlafuzz.errors import SceneError
from vlafuzz.failures.triage.attribute import attribute
from vlafuzz.failures.triage.certify import Certifier, Shrunk, by_known_cause
from vlafuzz.failures.triage.oracle import LEAD, MOST, MOST_TO_CERTIFY, UNFAIR, Answer, Oracle
from vlafuzz.failures.triage.path import deviating, directed, free_genes, outward
from vlafuzz.failures.triage.shrink import Reference, Shrinker, find_reference
from vlafuzz.failures.triage.witness import Search, prove
from vlafuzz.model import Rate, Scene, Verdict
from vlafuzz.model.phrasing import signature
from vlafuzz.model.space import CONFOUNDERS
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Finding, FoundCause, Judged, Repeats, Triaged

# Rollouts to shrink, certify and attribute a finding; of a stochastic policy, an answer takes 3 to 20.
MAX_ROLLOUTS, MAX_OF_STOCHASTIC = 200, 1000
FIRST = 2  # failures more than passes in a cause's scene, or one farther out, before it is certified
TO_SHRINK, TO_CERTIFY = 0.5, 0.8  # shares of them after which shrinking and certifying end


class Unjudged(Enum):
    """Why a finding could not be judged."""

    BROKEN = "policy or simulator broke"
    UNFAIR = "the scene is no longer fair"
    LATE = "no time was left"


class _UnjudgedError(Exception):
    """What happened says nothing about the finding."""

    def __init__(self, why: Unjudged = Unjudged.BROKEN) -> None:
        self.why = why


@dataclass
class Triager:
    """Works through the findings of one run.

    Attributes:
        trials: scenes of the run, and whether the policy failed in each.
        blamed: a cause by the scene that shows it; near a threshold this is certified farther out, if it can be.
        rolled: verdicts that the finding has paid for; only ``roll`` changes it. Each pays for all of its own as if it
            were alone, so that its result does not depend on which finding comes first.
        repeats: all rollouts so far, which findings share; only ``roll`` changes it.
        known: certified findings, one of each signature. A finding that their operators explain keeps its own values of
            these, and thresholds of a known signature are not located again.
        deadline: after which a finding is given up.
    """

    runner: SceneRunner
    trials: Sequence[tuple[Scene, bool]] = ()
    blamed: Mapping[Scene, FoundCause] = field(default_factory=dict)
    rolled: Repeats = field(default_factory=dict)
    repeats: Repeats = field(default_factory=dict, kw_only=True)
    known: Sequence[Triaged] = field(default=(), kw_only=True)
    deadline: Deadline = field(default_factory=Deadline, kw_only=True)

    def triage(self, finding: Finding) -> Triaged | Unjudged:
        """The finding after triage, or why it could not be judged."""
        began = time.monotonic()
        alone = replace(self, rolled={})
        try:
            spent, triaged = alone._of_cause(finding)
            if triaged is None:
                oracle = alone._oracle()
                confirmed, rate = alone._confirm(finding.scene, oracle)
                triaged = replace(alone._repeated(finding, rate), policy_rollouts=oracle.spent)
                most = alone._most(finding.scene) - spent
                triaged = alone._prove(triaged, oracle, most) if confirmed else triaged
                triaged = replace(triaged, policy_rollouts=triaged.policy_rollouts + spent)
        except _UnjudgedError as error:
            return error.why
        return replace(triaged, seconds=time.monotonic() - began)

    def roll(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        """One rollout in each scene; what is known is not repeated, and no finding pays for it twice."""
        if self.deadline.passed:
            raise _UnjudgedError(Unjudged.LATE)
        tries = {(scene.digest, n): scene for scene, n in zip(scenes, numbers, strict=True)}
        new = [key for key in tries if key not in self.rolled and key not in self.repeats]
        outcomes = self.runner.evaluate([tries[key] for key in new], [number for _, number in new])
        judged = dict(zip(new, map(Judged.of, outcomes), strict=True))
        self.repeats |= {key: one for key, one in judged.items() if one.verdict is not Verdict.ERROR}
        if any(answer.unanswered for answer in judged.values()):
            raise _UnjudgedError
        answers = [self.rolled.get(key) or self.repeats.get(key) or judged[key] for key in tries]
        self.rolled |= {key: self.repeats[key]._replace(rollouts=0) for key in tries if key in self.repeats}
        return answers

    def _of_cause(self, finding: Finding) -> tuple[int, Triaged | None]:
        """The rollouts to certify the operators of a cause at once, without a search; and the finding if they hold.

        At a threshold the policy fails in one scene and passes in the next: then a scene farther out is certified.
        """
        space, scene = self.runner.space, finding.scene
        found = self.blamed.get(scene, FoundCause(None, (), 0))
        names = [name for name in found.operators if name in space.groups]
        subject = [name for name in found.operators if name == space.subject and not names]
        deviating = self._deviating(scene)
        if not names + subject or deviating is None:
            return 0, None
        oracle = self._oracle()
        oracle.budget = round(self._most(scene) * TO_CERTIFY)
        others = [operator for name in deviating if name not in names for operator in space.group(name)]
        alone = space.reset(scene, others)
        for name, outcomes in found.tests.items():
            if not subject:
                oracle.credit(space.reset(alone, space.group(name)) if name else alone, outcomes)
        farther = [alone, *outward(space, alone, names)]
        firm = next((one for one in farther if oracle.answers([one], lead=FIRST)[0] is Answer.FAILS), None)
        firm = firm or max(farther, key=lambda one: oracle.rate(one).share)
        if not oracle.rate(firm).rollouts:
            return oracle.spent, None
        farther_out = firm != alone
        free = free_genes(space, firm, [operator for name in names for operator in space.group(name)])
        shrinker = Shrinker(space, oracle, [firm])
        if CONFOUNDERS in names or len(free) > len(names):
            shrinker.drop_confounders()
            # A confounder has many values: of a policy that fails by chance, cheap answers drop one that matters.
            if CONFOUNDERS not in names or oracle.lead == 1:
                shrinker.drop_values()
        certifier = Certifier(oracle, space, Reference(None, oracle.stages), subject)
        shrunk = certifier.simplest(certifier.test(shrinker.best))
        rate = oracle.rate(alone) if farther_out else shrunk.rate
        # To shrink the whole failure would take 80 to 160 rollouts more; of seven causes, one was certified so.
        if not shrunk.minimal:
            triaged = replace(self._repeated(finding, rate), detail=shrunk.problem)
            return oracle.spent, replace(triaged, policy_rollouts=oracle.spent)
        search = self._search(shrunk.scene)
        detail = f"farther out than it was found, where {rate.failures} of {rate.rollouts} rollouts around it fail"
        triaged = replace(
            self._repeated(finding, rate),
            bucket="witnessed" if search.witness else "unproven",
            lost_stage=shrunk.lost,
            expert_rollouts=search.rollouts,
            witness=search.witness,
            recovery=search.recovery,
            detail=detail if farther_out else "",
        )
        oracle.budget = self._most(scene)
        if search.witness:
            triaged = self._attribute(triaged, shrunk, oracle, shrunk.scene)
        else:
            triaged = replace(triaged, detail="the expert fails, too")
        return oracle.spent, replace(triaged, shrink_rollouts=oracle.spent, policy_rollouts=oracle.spent)

    def _repeated(self, finding: Finding, rate: Rate) -> Triaged:
        """A finding of which nothing is known but how often it fails."""
        return Triaged(
            scene=finding.scene,
            policy_key=finding.policy_key,
            bucket="flaky",
            repeats=rate.rollouts,
            failures=rate.failures,
            rate=rate,
            deviating=self._deviating(finding.scene) or (),
            detail=f"{rate.failures} of {rate.rollouts} repeats failed",
        )

    def _confirm(self, scene: Scene, oracle: Oracle) -> tuple[bool, Rate]:
        """Repeat a finding until it is clear whether it fails again, and how often.

        A stochastic policy has a second chance: it may fail in less than half of the rollouts, but more often than in
        the nominal scene.
        """
        answer = oracle.answers([scene], lead=LEAD)[0]
        if answer in (Answer.BROKEN, Answer.UNFAIR, Answer.UNTRIED):
            raise _UnjudgedError(Unjudged.UNFAIR if answer is Answer.UNFAIR else Unjudged.BROKEN)
        if answer is Answer.FAILS or self.runner.deterministic or self._deviating(scene) is None:
            return answer is Answer.FAILS, oracle.rate(scene)
        oracle.budget += MOST_TO_CERTIFY
        (nominal,) = oracle.contrasts(scene, [self.runner.space.nominal(like=scene)])
        return nominal.answer is Answer.PASSES, oracle.certified(scene)

    def _most(self, scene: Scene) -> int:
        """Rollouts to shrink, certify and attribute a finding; few where its operators are known, as others wait."""
        few = self.runner.deterministic or scene in self.blamed
        return MAX_ROLLOUTS if few else MAX_OF_STOCHASTIC

    def _oracle(self) -> Oracle:
        lead = 1 if self.runner.deterministic else LEAD
        return Oracle(self.roll, self.runner.stages, self.runner.space.jittered, budget=MOST + UNFAIR, lead=lead)

    def _prove(self, triaged: Triaged, oracle: Oracle, most: int) -> Triaged:
        """Witness, shrink, certify and attribute a confirmed failure."""
        search = self._search(triaged.scene)
        lost = oracle.lost(triaged.scene)
        triaged = replace(triaged, expert_rollouts=search.rollouts, lost_stage=lost, detail="")
        if search.witness is None:
            return replace(triaged, bucket="unproven", detail="the expert fails, too")
        triaged = replace(triaged, bucket="witnessed", witness=search.witness, recovery=search.recovery)
        if self._deviating(triaged.scene) is None:
            return replace(triaged, detail="not shrunk: it has a value that no operator gives")
        oracle.count_up_to(lost)
        before = oracle.spent
        triaged = self._shrink(triaged, oracle, most)
        spent = oracle.spent - before
        return replace(triaged, shrink_rollouts=spent, policy_rollouts=triaged.policy_rollouts + spent)

    def _shrink(self, triaged: Triaged, oracle: Oracle, most: int) -> Triaged:
        space, confirmed = self.runner.space, oracle.spent
        oracle.budget = confirmed + round(most * TO_SHRINK)
        reference = find_reference(triaged.scene, oracle, space, [one for one, failed in self.trials if not failed])
        if reference is None:
            return replace(triaged, bucket="flaky", detail="even the nominal scene of the same objects fails")
        certifier = Certifier(oracle, space, reference)
        shrunk = by_known_cause(triaged.scene, self.known, certifier)
        if shrunk is None:
            way = Shrinker(space, oracle, [triaged.scene], reference.scene).shrink()
            oracle.budget = confirmed + round(most * TO_CERTIFY)
            shrunk = certifier.certify(way)
        else:
            triaged = replace(triaged, detail="known operators suffice, with the values that were found")
        oracle.budget = confirmed + most
        return self._attribute(triaged, shrunk, oracle, triaged.scene)

    def _attribute(self, triaged: Triaged, shrunk: Shrunk, oracle: Oracle, proved: Scene) -> Triaged:
        """Name the cause of a shrunk failure, and look for thresholds that are not known yet."""
        space, rates = self.runner.space, dict(shrunk.rates)
        if shrunk.minimal and triaged.scene in self.blamed and space.subject in self.blamed[triaged.scene].operators:
            others = space.reset(shrunk.scene, [space.subject])
            rates[space.subject] = oracle.contrasts(shrunk.scene, [others], most=MOST)[0].rate
        operators = directed(space, shrunk.scene, shrunk.operators, shrunk.reference)
        name = signature(triaged.scene.task, shrunk.lost, operators)
        located = any(name == one.signature and one.causes.thresholds for one in self.known)
        triaged = replace(
            triaged,
            shrunk=shrunk.scene,
            lost_stage=shrunk.lost,
            operators=shrunk.operators,
            causes=attribute(shrunk, oracle, space, self.trials, located=located),
            certified=shrunk.rate,
            counterparts=shrunk.counterparts,
            counterpart_rates=rates,
            reference=shrunk.reference,
            signature=name,
        )
        if not shrunk.minimal:
            return replace(triaged, detail=shrunk.problem)
        return self._crown(triaged, shrunk.scene, proved)

    def _crown(self, triaged: Triaged, scene: Scene, proved: Scene) -> Triaged:
        """A shrunk scene is minimal when it has a witness of its own; ``proved`` is the scene that has one."""
        if scene == proved:
            return replace(triaged, bucket="minimal")
        search = self._search(scene)
        triaged = replace(triaged, expert_rollouts=triaged.expert_rollouts + search.rollouts)
        if search.witness is None:
            return replace(triaged, detail="the expert solves the finding, but not the shrunk scene")
        return replace(triaged, bucket="minimal", witness=search.witness, recovery=search.recovery)

    def _search(self, scene: Scene) -> Search:
        search = prove(scene, self.runner.solve, self.runner.play)
        if search.broken:
            raise _UnjudgedError
        return search

    def _deviating(self, scene: Scene) -> tuple[str, ...] | None:
        """The operators that are not nominal; None for a scene with a value that no operator gives."""
        space = self.runner.space
        try:
            return tuple(deviating(space, scene)) if space.reset(scene, []) == scene else None
        except SceneError:
            return None


def repeat(runner: SceneRunner, scene: Scene, first: int = 0) -> tuple[Answer, Rate, str | None]:
    """What the policy mostly does around a scene, how often it fails, and the stage that it loses.

    Args:
        first: number of the first rollout.
    """
    oracle = Oracle(Triager(runner).roll, runner.stages, runner.space.jittered, budget=MOST + UNFAIR, first=first)
    try:
        answer, rate = oracle.answers([scene])[0], oracle.rate(scene)
    except _UnjudgedError:
        return Answer.BROKEN, Rate.of_counts(0, 0), None
    return answer, rate, oracle.lost(scene) if rate.failures else None
