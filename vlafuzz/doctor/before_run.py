"""Checks of a policy: all of them for ``vlafuzz doctor``, the quick ones before ``vlafuzz run``."""

import shlex
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from typing import NamedTuple

from vlafuzz.campaign import config
from vlafuzz.campaign.config import Plan, RunConfig
from vlafuzz.campaign.forecast import Speed, at_a_time, longest, usual_speed
from vlafuzz.campaign.launch import stands_alone
from vlafuzz.common.deadline import Deadline
from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.doctor import Check
from vlafuzz.errors import PrerequisiteError, UsageError, VlafuzzError
from vlafuzz.policies.base import Policy
from vlafuzz.policies.clients.servers import guesses, is_remote
from vlafuzz.rollouts.policies import is_built_in, make_policy

UNCHECKED = "unchecked"


def examine(run: RunConfig, n: int, watch: Watch = SILENT, deadline: Deadline | None = None) -> Iterator[Check]:
    """All checks of the policy that the run names, up to the first refusal, with ``n`` nominal rollouts.

    After the deadline no rollout is begun but the first.
    """
    assert run.policy
    policy = _make(run.policy)
    if isinstance(policy, Check):
        yield policy
        return
    from vlafuzz.doctor.exam import Exam
    from vlafuzz.doctor.two_processes import check_answers, check_simulation

    with closing(policy):
        manifest = config.plan(run, policy=policy).manifest
        watch.note(
            f"{run.policy}: a few seconds of questions, a scene and a few more in two other processes, then "
            f"{n} rollouts; where they fail, up to some 150 more, with corrections; --time bounds it"
        )
        most = longest(policy.spec, manifest)
        watch.progress("checks", 0, None)
        with closing(Exam(manifest, policy, watch, deadline)) as exam:
            for number, check in enumerate(exam.thorough(n), start=1):
                yield check
                watch.progress("checks", number, None)
                if check.check == "speed":
                    watch.note(_duration(exam.speed(1), most, n))
                    if not (deadline and deadline.passed):
                        yield from check_simulation(manifest, policy.spec.cameras)
                        yield check_answers(manifest, policy.spec, exam.moments(), remote=is_remote(policy))


class Checked(NamedTuple):
    """A plan that may be run, and the speed of its policy if that is known."""

    plan: Plan
    speed: Speed | None


def checked_plan(plan: Plan, *, unchecked: bool, watch: Watch = SILENT) -> Checked:
    """The plan of a run, labelled with what seconds of checks find wrong with its policy.

    Built-in policies skip this check: their tests cover it, and loading the simulator takes as long as a hundred of
    their rollouts. A resumed run keeps its label, and is not checked if it was not before.

    Raises:
        PrerequisiteError: the policy cannot be tested.
    """
    manifest = plan.manifest
    if manifest.repeats > 1 and plan.policy.spec.deterministic:
        watch.note(f"note: {manifest.policy} is deterministic: repeats differ only if it uses the seed")
    if plan.resume and manifest.alone:
        watch.note(f"note: {manifest.policy}: what answers now has to be the model with which the run began")
    if is_built_in(manifest.policy) or manifest.checkup == UNCHECKED:
        return Checked(plan, usual_speed(plan))
    if plan.resume is None:
        _say(plan, watch)
    label, speed = (UNCHECKED, None) if unchecked else _label(plan, watch)
    if plan.resume is None:
        plan = replace(plan, manifest=replace(manifest, checkup=label))
    return Checked(plan, speed)


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


def speed_of(plan: Plan) -> Speed | None:
    """How fast a plan's policy usually is, or as measured, which takes seconds; None if it breaks."""
    from vlafuzz.doctor.exam import Exam

    if is_built_in(plan.manifest.policy):
        return usual_speed(plan)
    with closing(Exam(plan.manifest, plan.policy)) as exam:
        seen = list(exam.looks())
        return None if any(check.verdict == "refuse" for check in seen) else exam.speed(at_a_time(plan))


def _label(plan: Plan, watch: Watch) -> tuple[str, Speed]:
    """What the checks find wrong with the policy, and how fast it is."""
    from vlafuzz.doctor.exam import Exam

    name = plan.manifest.policy
    checks: list[Check] = []
    with closing(Exam(plan.manifest, plan.policy)) as exam:
        for check in exam.quick():
            checks.append(check)
            watch.progress("checkup", len(checks), None)
        speed = None if checks[-1].verdict == "refuse" else exam.speed(at_a_time(plan))
    doctor = shlex.join(["vlafuzz", "doctor", "--policy", name])
    for check in checks:
        if check.verdict == "refuse":
            hint = f"{check.follows}; `{doctor}` looks closer, --unchecked runs it all the same"
            raise PrerequisiteError(f"{name} is not run: {check.found}", hint)
        if check.verdict == "warn" and not check.follows.startswith("guessed"):  # that was said
            watch.note(f"note: {name}: {check.found}: {check.follows}")
    assert speed is not None
    return "; ".join(check.follows for check in checks if check.verdict == "warn") or "ok", speed


def _duration(speed: Speed, most: int, n: int) -> str:
    """How long the doctor's rollouts take at most."""
    seconds = most / speed.actions * (speed.answer + speed.simulator)
    first = f"up to {duration(n * seconds)} for {plural(n, 'rollout')} of up to {most} steps"
    return f"{first}, for 150 more {duration(150 * seconds)}; {speed.words}"


def _make(name: str) -> Policy | Check:
    """The policy, or a refused check that says why it cannot be made; UsageError for an unknown one."""
    try:
        return make_policy(name)
    except UsageError:
        raise
    except VlafuzzError as error:
        return Check("connects", error.message, "refuse", error.hint or "")
