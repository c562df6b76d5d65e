"""Exam: runs a policy in the simulator, probes its answers, and tries corrections where it fails.

`vlafuzz doctor` makes all of its checks, and `vlafuzz run` the quick ones before it begins.
"""

import shlex
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import chain, count, cycle, islice
from math import ceil
from pathlib import Path
from statistics import median

import numpy as np

from vlafuzz.campaign import config
from vlafuzz.campaign.config import Plan, RunConfig, stands_alone
from vlafuzz.campaign.forecast import Speed, answered_together, at_a_time, longest, usual_speed
from vlafuzz.common.check import Check
from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.doctor import verdicts
from vlafuzz.doctor.probes import Break, Interview, Recorder, reworded, seconds_at_once, sights
from vlafuzz.doctor.wiring import Corrected, Correction, check_wiring, corrections, most_rollouts
from vlafuzz.errors import PolicyError, PrerequisiteError, SimulatorError, UsageError, VlafuzzError
from vlafuzz.model import Outcome, Scene, Space, Verdict
from vlafuzz.policies.base import Policy
from vlafuzz.policies.clients.servers import guesses
from vlafuzz.rollouts.executor import evaluate_safely
from vlafuzz.rollouts.policies import is_built_in, make_policy
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.store.records import Manifest
from vlafuzz.worlds import world_of
from vlafuzz.worlds.first_use import looked_at
from vlafuzz.worlds.values import ValuesWorld

UNCHECKED = "unchecked"
TARGETS = ("target-type", "target-position", "target-orientation")  # vary in nominal scenes
CLUTTER = ("confounder-type", "confounder-position", "confounder-orientation", "confounder-count")
SCENES, ANSWERS = 3, 8  # scenes in which the policy is observed, and answers in each
UNFAIR = 10  # scenes drawn per fair one, at most
MORE = 3  # times as many nominal rollouts, at most, until there is a second failure
BROKEN = 2  # broken rollouts after which the remaining ones are skipped


class Exam:
    """One policy in the task of a planned run. Loading the simulator takes seconds; the policy stays open.

    ``watch`` is told of every rollout to the end.
    """

    def __init__(self, manifest: Manifest, policy: Policy, watch: Watch = SILENT) -> None:
        self._watch, self._done, self._most = watch, 0, 0
        self._policy, self._spec = policy, policy.spec
        self._hz = world_of(manifest.task).robot(manifest.robot).control_hz or policy.spec.action.hz
        self._corrected = Corrected(policy)
        self._recorder = Recorder(self._corrected)
        once = replace(manifest, repeats=1, stop_early=True)
        self._evaluator = make_evaluator(once, self._recorder)
        self._manifest = manifest
        self._nominal = self._drawn(TARGETS)
        self._outcomes: list[tuple[Scene, Outcome]] = []  # of complete rollouts in nominal scenes
        self._rewordings: dict[str, str] = {}  # instructions that name another object on the table

    def close(self) -> None:
        self._evaluator.close()

    def quick(self) -> Iterator[Check]:
        """The checks that take seconds, up to the first refusal."""
        return self._guarded(self._probed(quick=True))

    def speed(self, plan: Plan | None = None) -> Speed:
        """The speed that the checks measured; with a plan that of its rollouts, which may be answered at once."""
        recorder = self._recorder
        answer, simulator = median(recorder.seconds[1:] or recorder.seconds), median(recorder.between or [0.0])
        words = f"measured: an answer takes {answer:.2g} s"
        step = (answer + simulator) / (plan.place.workers if plan else 1)
        if plan and answered_together(plan):
            number = at_a_time(plan)
            most = min(number, self._spec.max_batch)
            if most > 1:
                answer = seconds_at_once(self._policy, list(islice(cycle(recorder.moments), most)))
                words += f", {most} at once {answer:.2g} s"
            step = answer * ceil(number / most) / number + simulator / plan.place.workers
        return Speed(step / len(recorder.moments[0].executed), words)

    def thorough(self, n: int) -> Iterator[Check]:
        """All checks up to the first refusal, with ``n`` nominal rollouts, and more where they fail.

        A policy that cannot do the task is still checked for wiring, which may be the reason.
        """
        for check in self._guarded(self._probed(quick=False)):
            yield check
        if check.verdict == "refuse":
            return
        self._outcomes += self._rolled(n)
        outcomes = [outcome for _, outcome in self._outcomes]
        yield (check := verdicts.on_rollouts(outcomes, self._recorder.breaks))
        if check.verdict != "refuse":
            yield verdicts.on_nominal(outcomes)
            candidates = corrections(self._spec, self._recorder.longest)
            self._done, self._most = 0, most_rollouts(candidates)
            yield check_wiring(self._outcomes, self._nominal, candidates, self._retry)

    def _probed(self, *, quick: bool) -> Iterator[Check]:
        spec, recorder = self._spec, self._recorder
        yield verdicts.on_spec(spec, self._hz, of_values=isinstance(world_of(self._manifest.task), ValuesWorld))
        yield self._observe()
        yield verdicts.on_actions(spec, self._hz, np.concatenate([moment.executed for moment in recorder.moments]))
        interview = Interview(self._policy, recorder.moments)
        yield verdicts.on_determinism(spec, interview.answers)
        yield verdicts.on_sight({name: interview.change(probe) for name, probe in sights(spec).items()})
        others = {*self._rewordings.values(), *(moment.start.instruction for moment in recorder.moments)}
        hears = len(others) > 1 and not (spec.privileged or spec.calibrated)
        yield verdicts.on_hearing(interview.change(reworded(self._rewordings)) if hears else None)
        if not quick:
            together = interview.together() if spec.max_batch > 1 else None
            yield verdicts.on_batch(spec, interview.answers, together)
            yield verdicts.on_speed(self._hz, recorder.seconds, len(recorder.moments[0].executed))

    def _guarded(self, checks: Iterator[Check]) -> Iterator[Check]:
        """The checks up to a refusal; when the policy breaks during a probe, that becomes a check, too."""
        try:
            for check in checks:
                yield check
                if check.verdict == "refuse":
                    return
        except PolicyError as error:
            yield verdicts.on_break(Break("when it was asked again about moments", error), first=False)

    def _observe(self) -> Check:
        recorder, seen = self._recorder, 0
        recorder.most, space = ANSWERS, self._space(TARGETS)
        drawn = self._drawn(TARGETS + CLUTTER)
        if not self._space(TARGETS + CLUTTER).genes:  # a world without things on a table
            drawn = chain([space.nominal()], self._drawn(None))
        for scene in islice(drawn, SCENES * UNFAIR):
            if other := space.misnamed(scene):
                self._rewordings[scene.instruction] = other
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
            hint = "ranges that leave room: --operators"
            raise SimulatorError(f"no fair scene: {outcome.detail}", hint)
        return Check("connects", f"{len(recorder.moments)} answers in {seen} scenes", "ok")

    def _rolled(self, n: int) -> Iterator[tuple[Scene, Outcome]]:
        """Roll out ``n`` fair scenes; fewer when the policy keeps breaking, or has failed in most of them.

        After a single failure among successes there are more, to see whether there is another.
        """
        rolled = broken = failed = 0
        self._watch.progress("nominal rollouts", 0, n)
        for scene in islice(self._nominal, MORE * n * UNFAIR):
            outcome = self._roll(scene)
            if outcome.verdict is Verdict.INVALID:
                continue
            yield scene, outcome
            rolled, broken = rolled + 1, broken + (outcome.verdict is Verdict.ERROR)
            failed += outcome.verdict is Verdict.FAILED
            self._watch.progress("nominal rollouts", rolled, max(n, rolled))
            enough = rolled >= (MORE * n if failed == 1 < rolled else n)
            if enough or broken == BROKEN or 2 * failed > n:
                return

    def _drawn(self, vary: Sequence[str] | None) -> Iterator[Scene]:
        """An endless series of scenes in which these operators vary; None for those of the run."""
        space, seed = self._space(vary), self._manifest.seed
        return (space.sample(np.random.default_rng([seed, number])) for number in count())

    def _space(self, vary: Sequence[str] | None) -> Space:
        return world_of(self._manifest.task).stored_space(Path("the run"), self._manifest, vary)

    def _retry(self, scene: Scene, correction: Correction | None) -> Outcome:
        """A rollout to find out what is the wrong way round."""
        self._watch.progress("rollouts with corrections", self._done, self._most)
        self._done += 1
        return self._roll(scene, correction)

    def _roll(self, scene: Scene, correction: Correction | None = None) -> Outcome:
        self._corrected.correction = correction
        return evaluate_safely(self._evaluator, scene)


def examine(run: RunConfig, n: int, watch: Watch = SILENT) -> Iterator[Check]:
    """All checks of the policy that the run names, up to the first refusal, with ``n`` nominal rollouts."""
    assert run.policy
    try:
        policy = make_policy(run.policy, run.task or "")
    except UsageError:
        raise
    except VlafuzzError as error:
        yield Check("connects", error.message, "refuse", error.hint or "")
        return
    with closing(policy):
        manifest = config.plan(run, policy=policy).manifest
        most = longest(policy.spec, manifest)
        with closing(Exam(manifest, policy, watch)) as exam:
            for check in exam.thorough(n):
                yield check
                if check.check == "speed":
                    speed = exam.speed()
                    seconds = most * speed.step
                    first = f"up to {duration(n * seconds)} for {plural(n, 'rollout')} of up to {most} steps"
                    more = f"where they fail, up to {duration(150 * seconds)} more, with corrections"
                    watch.note(f"{first}; {more}; Ctrl-C ends it; {speed.words}")


def checked_plan(plan: Plan, *, unchecked: bool, watch: Watch = SILENT) -> tuple[Plan, Speed | None]:
    """The plan of a run, labelled with what seconds of checks find wrong with its policy, and its speed if known.

    Built-in policies skip this check: their tests cover it, and loading the simulator takes as long as a hundred of
    their rollouts. A resumed run keeps its label, and is not checked if it was not before.

    Raises:
        PrerequisiteError: the policy cannot be tested, or not in this world.
    """
    manifest = plan.manifest
    if not unchecked and manifest.checkup != UNCHECKED:
        _look_at_world(manifest.task, watch)
    if manifest.repeats > 1 and plan.policy.spec.deterministic:
        watch.note(f"note: {manifest.policy} is deterministic: repeats differ only if it uses the seed")
    if plan.resume and manifest.alone:
        watch.note(f"note: {manifest.policy}: what answers now has to be the model with which the run began")
    if is_built_in(manifest.policy) or manifest.checkup == UNCHECKED:
        return plan, usual_speed(plan)
    if plan.resume is None:
        _say(plan, watch)
    label, speed = (UNCHECKED, None) if unchecked else _label(plan, watch)
    if plan.resume is None:
        plan = replace(plan, manifest=replace(manifest, checkup=label))
    return plan, speed


def _look_at_world(task: str, watch: Watch) -> None:
    """Say what is wrong with a world of the user's own that is new here; a PrerequisiteError if it cannot be used."""
    name, _, own = task.rpartition("/")
    doctor = shlex.join(["vlafuzz", "doctor", "--world", f"{name}:{own}"])
    for check in looked_at(task, watch):
        if check.verdict == "refuse":
            hint = f"{check.follows}; `{doctor}` looks closer, --unchecked runs it all the same"
            raise PrerequisiteError(f"{name} is not run: {check.check}: {check.found}", hint)
        watch.note(f"note: {name}: {check.check}: {check.found}: {check.follows}")


def _say(plan: Plan, watch: Watch) -> None:
    """Say what the run takes for granted: each convention that nobody declares, and that it stands alone."""
    name, manifest = plan.manifest.policy, plan.manifest
    if assumed := guesses(name, plan.policy.spec):
        watch.note(f"note: {name}: nobody declares these conventions, so they are guessed:")
        for option, means in assumed.items():
            watch.note(f"  {option} ({means})")
        whole = shlex.quote(f"{name}{'&' if '?' in name else '?'}{'&'.join(assumed)}")
        watch.note(f"hint: with the right values in the policy's name, nothing is guessed: {whole}")
    if manifest.alone:
        watch.note(stands_alone(name))


def _label(plan: Plan, watch: Watch) -> tuple[str, Speed]:
    """Run the checks; returns what they find wrong with the policy, and how fast it is."""
    name, warnings = plan.manifest.policy, list[str]()
    doctor = shlex.join(["vlafuzz", "doctor", "--policy", name])
    with closing(Exam(plan.manifest, plan.policy)) as exam:
        for number, check in enumerate(exam.quick(), start=1):
            watch.progress("checkup", number, None)
            if check.verdict == "refuse":
                hint = f"{check.follows}; `{doctor}` looks closer, --unchecked runs it all the same"
                raise PrerequisiteError(f"{name} is not run: {check.found}", hint)
            if check.verdict == "warn":
                warnings.append(check.follows)
                if not check.follows.startswith("guessed"):  # that was said
                    watch.note(f"note: {name}: {check.found}: {check.follows}")
        return "; ".join(warnings) or "ok", exam.speed(plan)
