"""Triager: confirms, witnesses, shrinks and attributes one finding. It imports no simulator."""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from vlafuzz.errors import SceneError
from vlafuzz.evidence import Actions, Solver
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.phrasing import signature
from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.store.records import Finding, Triaged
from vlafuzz.triage.attribute import attribute
from vlafuzz.triage.confirm import MOST, Confirmation, confirm
from vlafuzz.triage.oracle import BudgetedOracle, Judged
from vlafuzz.triage.path import deviating
from vlafuzz.triage.shrink import Shrunk, shrink
from vlafuzz.triage.witness import Search, prove

# Rollouts to shrink and attribute one finding; a stochastic policy takes about five a scene, at most twenty.
MAX_ROLLOUTS, MAX_OF_STOCHASTIC = 100, 1000


class PolicyRunner(Protocol):
    """Rolls out a policy under the conditions of a run. Nothing raises for what a scene does."""

    deterministic: bool

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        """One rollout in each scene, with the runner's seed plus the scene's number."""

    def close(self) -> None:
        """Release simulator and policies."""


class SceneRunner(PolicyRunner, Protocol):
    """Runs policy and expert in the scenes of one run.

    Attributes:
        space: the search space with the operators of the run.
        stages: the names of the task's stages.
    """

    space: SearchSpace
    stages: tuple[str, ...]

    def renew(self) -> None:
        """Give the next scene an environment that has seen no other."""

    def solve(self, scene: Scene, attempt: int, solver: Solver = "expert") -> Outcome:
        """One rollout of the expert or the seeing expert, in its n-th attempt."""

    def play(self, scene: Scene, actions: Actions) -> Outcome:
        """The outcome when the robot executes these actions."""


class _BrokenError(Exception):
    """Policy or simulator broke, which says nothing about the finding."""


@dataclass
class Triager:
    runner: SceneRunner
    max_rollouts: int | None
    known: dict[Scene, Judged] = field(default_factory=dict)

    def triage(self, finding: Finding) -> Triaged | None:
        """The finding after triage; None where policy or simulator broke."""
        try:
            return self._triage(finding)
        except _BrokenError:
            return None

    def _triage(self, finding: Finding) -> Triaged:
        began = time.monotonic()
        self.runner.renew()
        confirmation, judged = repeat(self.runner, finding.scene)
        if not (confirmation.confirmed or confirmation.refuted or confirmation.repeats == MOST):
            raise _BrokenError
        triaged = Triaged(
            scene=finding.scene,
            policy_key=finding.policy_key,
            bucket="flaky",
            repeats=confirmation.repeats,
            failures=confirmation.failures,
            deviating=self._deviating(finding.scene) or (),
            policy_rollouts=judged.rollouts,
            detail=f"{confirmation.failures} of {confirmation.repeats} repeats failed",
        )
        if confirmation.confirmed:
            triaged = self._prove(triaged, judged)
        return replace(triaged, seconds=time.monotonic() - began)

    def _prove(self, triaged: Triaged, judged: Judged) -> Triaged:
        """Witness, shrink and attribute a confirmed failure."""
        search = self._search(triaged.scene)
        triaged = replace(triaged, expert_rollouts=search.rollouts, lost_stage=judged.lost, detail="")
        if search.witness is None:
            return replace(triaged, bucket="unproven", detail="the expert fails, too")
        triaged = replace(triaged, bucket="witnessed", witness=search.witness)
        if self._deviating(triaged.scene) is None:
            return replace(triaged, detail="not shrunk: it has a value that no operator gives")
        return self._shrink(triaged, judged)

    def _shrink(self, triaged: Triaged, judged: Judged) -> Triaged:
        runner = self.runner
        oracle = BudgetedOracle(
            self._judge,
            runner.stages,
            (triaged.scene, judged),
            budget=self.max_rollouts or (MAX_ROLLOUTS if runner.deterministic else MAX_OF_STOCHASTIC),
            rollouts_a_scene=1 if runner.deterministic else MOST,
        )
        shrunk = shrink(triaged.scene, oracle, runner.space)
        if not shrunk.base:
            triaged = replace(triaged, causes=attribute(shrunk, oracle, runner.space))
        triaged = replace(
            triaged,
            shrunk=shrunk.scene,
            lost_stage=shrunk.lost,
            operators=shrunk.operators,
            counterparts=shrunk.counterparts,
            signature=signature(triaged.scene.task, shrunk.lost, shrunk.operators),
            shrink_rollouts=oracle.spent,
            policy_rollouts=triaged.policy_rollouts + oracle.spent,
        )
        if shrunk.base:
            return replace(triaged, bucket="base", detail="even the nominal scene of the same objects fails")
        if not shrunk.minimal:
            return replace(triaged, detail=_why_not(shrunk))
        return self._crown(triaged, shrunk.scene)

    def _crown(self, triaged: Triaged, scene: Scene) -> Triaged:
        """A shrunk scene is minimal when it has a witness of its own."""
        if scene == triaged.scene:
            return replace(triaged, bucket="minimal")
        search = self._search(scene)
        triaged = replace(triaged, expert_rollouts=triaged.expert_rollouts + search.rollouts)
        if search.witness is None:
            return replace(triaged, detail="the expert solves the finding, but not the shrunk scene")
        return replace(triaged, bucket="minimal", witness=search.witness)

    def _search(self, scene: Scene) -> Search:
        search = prove(scene, self.runner.solve, self.runner.play)
        if search.broken:
            raise _BrokenError
        return search

    def _judge(self, scenes: Sequence[Scene]) -> list[Judged]:
        """The verdicts of candidates; those known from another finding cost nothing."""
        fresh = [scene for scene in scenes if scene not in self.known]
        if self.runner.deterministic:
            judged = [Judged.of(outcome) for outcome in self.runner.evaluate(fresh, [0] * len(fresh))]
        else:
            judged = [repeat(self.runner, scene)[1] for scene in fresh]
        if any(verdict.unanswered for verdict in judged):
            raise _BrokenError
        answers = dict(zip(fresh, judged, strict=True))
        verdicts = [answers.get(scene) or self.known[scene] for scene in scenes]
        self.known |= {
            scene: answer._replace(rollouts=0)
            for scene, answer in answers.items()
            if answer.verdict is not Verdict.ERROR
        }
        return verdicts

    def _deviating(self, scene: Scene) -> tuple[str, ...] | None:
        """The operators that are not nominal; None for a scene with a value that no operator gives."""
        space = self.runner.space
        try:
            return tuple(deviating(space, scene)) if space.reset(scene, []) == scene else None
        except SceneError:
            return None


def repeat(runner: SceneRunner, scene: Scene) -> tuple[Confirmation, Judged]:
    """Whether a scene fails again, and the verdict that its repeats mostly have."""
    seen: list[Judged] = []

    def once(number: int) -> Verdict:
        seen.append(Judged.of(runner.evaluate([scene], [number])[0]))
        return seen[-1].verdict

    confirmation = confirm(once, deterministic=runner.deterministic)
    rollouts = sum(judged.rollouts for judged in seen)
    lost = Counter(judged.lost for judged in seen if judged.lost is not None)
    if confirmation.confirmed:
        return confirmation, Judged(Verdict.FAILED, lost.most_common(1)[0][0], rollouts)
    if confirmation.refuted:
        return confirmation, Judged(Verdict.PASSED, None, rollouts)
    verdict = Verdict.FAILED if confirmation.failures else seen[-1].verdict  # at times
    return confirmation, Judged(verdict, None, rollouts, seen[-1].unanswered)


def _why_not(shrunk: Shrunk) -> str:
    """Why a shrunk scene is not shown to be minimal."""
    if not shrunk.complete:
        return "the limit on rollouts cut shrinking short"
    return "; ".join(f"without {name} the scene {outcome}" for name, outcome in shrunk.unresolved.items())
