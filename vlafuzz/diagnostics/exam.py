"""Exam: a policy in the simulator, observed, asked again and corrected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, count, islice
from pathlib import Path

import numpy as np

from vlafuzz.conditions.operators import stored_operators
from vlafuzz.conditions.packs import stored_catalogue
from vlafuzz.diagnostics import verdicts
from vlafuzz.diagnostics.check import Check, until_refused
from vlafuzz.diagnostics.corrections import Corrected, Correction, corrections
from vlafuzz.diagnostics.interview import Interview
from vlafuzz.diagnostics.probes import moved, sights, told
from vlafuzz.diagnostics.recorder import Break, Recorder
from vlafuzz.diagnostics.wiring import check_wiring
from vlafuzz.errors import PolicyError, SimulatorError
from vlafuzz.execute.base import evaluate_safely
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.policies.base import Policy
from vlafuzz.scene import Scene
from vlafuzz.sim.make import make_evaluator
from vlafuzz.space import SearchSpace
from vlafuzz.store.records import Manifest
from vlafuzz.tasks.instructions import load_wordings, say

TARGETS = ("target-type", "target-position", "target-orientation")  # what varies in nominal scenes
CLUTTER = ("confounder-type", "confounder-position", "confounder-orientation", "confounder-count")
SCENES, ANSWERS = 3, 8  # in which it is observed, and how long in each
UNFAIR = 10  # scenes are drawn for one that is fair, at most
BROKEN = 2  # rollouts break before the others are spared


class Exam:
    """One policy in one task. From here on, seconds go by; the policy stays open.

    Args:
        manifest: of the run that is to come of it.
    """

    def __init__(self, manifest: Manifest, policy: Policy) -> None:
        self._policy, self._spec = policy, policy.spec
        self._corrected = Corrected(policy)
        self._recorder = Recorder(self._corrected)
        once = replace(manifest, repeats=1, stop_early=True)
        self._evaluator = make_evaluator(once, self._recorder)
        self._manifest, self._catalogue = manifest, stored_catalogue(manifest)
        self._nominal = self._drawn(TARGETS)
        self._outcomes: list[tuple[Scene, Outcome]] = []  # of whole rollouts in nominal scenes
        self._otherwise: dict[str, str] = {}  # what names another thing on the table

    def close(self) -> None:
        """Let go of the simulator."""
        self._evaluator.close()

    def quick(self) -> Iterator[Check]:
        """What seconds tell, up to the first that is refused."""
        return until_refused(self._guarded(self._asked(quick=True)))

    def thorough(self, n: int) -> Iterator[Check]:
        """All checks, with ``n`` nominal rollouts and more where they fail, up to the first that is refused.

        That it cannot do the task does not end them: what is miswired may be why.
        """
        checks = chain(self._guarded(self._asked(quick=False)), self._lasting(n))
        verdict = "ok"
        for check in until_refused(checks):
            verdict = check.verdict
            yield check
        if verdict != "refuse":
            yield verdicts.on_nominal([outcome for _, outcome in self._outcomes])
            candidates = corrections(self._spec, self._recorder.longest)
            yield check_wiring(self._outcomes, self._nominal, candidates, self._roll)

    def _asked(self, *, quick: bool) -> Iterator[Check]:
        spec, recorder = self._spec, self._recorder
        yield verdicts.on_spec(spec)
        yield self._observe()
        yield verdicts.on_actions(spec, np.concatenate([each.executed for each in recorder.moments]))
        interview = Interview(self._policy, recorder.moments)
        yield verdicts.on_determinism(spec, interview.answers)
        yield verdicts.on_sight({name: interview.change(probe) for name, probe in sights(spec).items()})
        hearing = None if spec.privileged else interview.change(told(self._otherwise))
        yield verdicts.on_hearing(hearing)
        if not quick:
            yield verdicts.on_proprioception(interview.change(moved) if spec.state else None)
            together = interview.together() if spec.max_batch > 1 else None
            yield verdicts.on_batch(spec, interview.answers, together)
            yield verdicts.on_speed(spec, recorder.seconds, len(recorder.moments[0].executed))

    def _lasting(self, n: int) -> Iterator[Check]:
        self._outcomes += self._rolled(n)
        yield verdicts.on_rollouts([outcome for _, outcome in self._outcomes], self._recorder.breaks)

    def _guarded(self, checks: Iterator[Check]) -> Iterator[Check]:
        """A policy that breaks while it is asked again is a row, too."""
        try:
            yield from checks
        except PolicyError as error:
            yield verdicts.on_break(Break.of(error, "when it was asked again about moments"), first=False)

    def _observe(self) -> Check:
        """Record how some rollouts begin, among several things."""
        recorder, seen = self._recorder, 0
        recorder.most = ANSWERS
        for scene in islice(self._drawn(TARGETS + CLUTTER), SCENES * UNFAIR):
            if scene.confounders:
                self._otherwise[scene.instruction] = self._misnamed(scene)
            outcome = self._roll(scene)
            if recorder.broken:
                return verdicts.on_break(recorder.broken, first=not recorder.moments)
            if outcome.detail.startswith("simulator"):
                raise SimulatorError(outcome.detail, hint="`vlafuzz doctor` checks this machine")
            seen += outcome.verdict is not Verdict.INVALID
            if seen == SCENES:
                break
        recorder.most = None
        if not recorder.moments:
            raise SimulatorError(
                f"no fair scene: {outcome.detail}", hint="ranges that leave room: --operators"
            )
        return Check("connects", f"{len(recorder.moments)} answers in {seen} scenes", "ok")

    def _rolled(self, n: int) -> Iterator[tuple[Scene, Outcome]]:
        """Fair scenes, until ``n`` are rolled out or it keeps breaking."""
        rolled = broken = 0
        for scene in islice(self._nominal, n * UNFAIR):
            outcome = self._roll(scene)
            if outcome.verdict is Verdict.INVALID:
                continue
            yield scene, outcome
            rolled, broken = rolled + 1, broken + (outcome.verdict is Verdict.ERROR)
            if rolled == n or broken == BROKEN:
                return

    def _drawn(self, vary: Sequence[str]) -> Iterator[Scene]:
        """Ever others, in which these operators vary."""
        manifest = self._manifest
        operators = stored_operators(Path("the run"), manifest).only(vary)
        space = SearchSpace(operators, self._catalogue, manifest.task, manifest.robot)
        return (space.sample(np.random.default_rng([manifest.seed, number])) for number in count())

    def _misnamed(self, scene: Scene) -> str:
        """Its instruction, with the name of a confounder in place of the first target's."""
        named = (scene.confounders[0], *scene.targets[1:])
        return say(load_wordings()[scene.task][0], [self._catalogue[each.object].spoken for each in named])

    def _roll(self, scene: Scene, correction: Correction | None = None) -> Outcome:
        self._corrected.correction = correction
        return evaluate_safely(self._evaluator, [scene])[0]
