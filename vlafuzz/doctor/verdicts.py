"""Verdicts on the observations of a policy: functions from facts to checks."""

import math
from collections.abc import Mapping, Sequence
from statistics import median

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.common.check import Check, Rating
from vlafuzz.common.statistics import wilson
from vlafuzz.doctor.probes import Answers, Break, Effect
from vlafuzz.model import Outcome, Verdict
from vlafuzz.policies.base import PolicySpec
from vlafuzz.policies.harness import WIDTH

FASTEST = {"position_scale": 2.0, "rotation_scale": 2 * math.pi}  # metres and radians per second of such an arm
OFTEN = 0.1  # share of steps above that speed from which on actions are out of range
STILL = 0.001  # metres and radians per step below which the hand does not really move
SAME = 1e-6
AT_END = 0.8  # share of steps at an end of its range from which on a number counts as clipped
CUT = 3  # clipped numbers; fewer may be intended, as in a straight descent at constant speed
ANYWAY = " (100%: as much as from moment to moment)"

# Each fault that a policy may have is rated, with advice on what to do.
FAULTS: dict[str, tuple[Rating, str]] = {
    "guessed": ("warn", "say {options} in the policy's name"),
    "it sees no picture": ("warn", "pictures of scenes do not matter to it; a policy that sees asks for cameras"),
    "constant": ("refuse", "its actions do not depend on the scene; look at how pictures are prepared"),
    "saturated": ("refuse", "they are clipped; look at the statistics by which it scales its actions"),
    "out of range": ("warn", "{problem}; {scale}=… says what their unit is"),
    "not deterministic": ("warn", "seed it with each rollout's seed, or say deterministic=False"),
    "blind": ("refuse", "nothing that it is shown matters; look at its cameras and its libraries' versions"),
    "nearly blind": ("warn", "it notices darkness, but {view} changes nothing"),
    "deaf": ("warn", "it ignores its instruction; look at how the instruction gets to it"),
    "mixed up": ("refuse", "answer in the order of the observations, and each by its own alone"),
    "the last digits depend on the rest of the batch": ("warn", "say deterministic=False, or max_batch=1"),
    "slow": ("warn", "a robot would wait for it, here it only takes long; execute more of a chunk, or lower hz"),
    "it breaks off at times": ("warn", "the first time {broken.where}: {broken.error.message}"),
    "it mostly fails": ("warn", "most of its failures will say nothing about the scenes"),
    "it cannot do the task": ("refuse", "its failures say nothing about the scenes"),
}


def judged(check: str, found: str, fault: str | None = None, **words: object) -> Check:
    """The check, which is ok without a fault. ``words`` fill in what there is to say about the fault."""
    if fault is None:
        return Check(check, found)
    rating, advice = FAULTS[fault]
    return Check(check, found, rating, f"{fault}: {advice.format(**words)}")


def on_spec(spec: PolicySpec, hz: int, *, of_values: bool = False) -> Check:
    """Say what the policy asks for, at a control rate ``hz``; ``of_values``: the world's scenes are values alone."""
    if guessed := [name for name, source in spec.provenance.items() if source == "default"]:
        detail = f"neither server nor options declare {' and '.join(guessed)}"
        return judged("spec", detail, "guessed", options=" and ".join(f"{name}=…" for name in guessed))
    views = [camera.name for camera in spec.cameras]
    views += ["outlines"] * spec.silhouettes + ["the simulator's state"] * spec.privileged
    views += ["the observation's numbers" if of_values else "proprioception"] * spec.state
    if {*views} <= {"proprioception"}:
        return judged("spec", "it asks for no pictures", "it sees no picture")
    return Check("spec", f"sees {', '.join(views)}, {hz} Hz")


def on_break(broken: Break, *, first: bool) -> Check:
    """A break of the policy: in an answer, before the first one (``first``), or later."""
    message, hint = " ".join(broken.error.message.split()), broken.error.hint
    if broken.error.cause == "bad_action":
        return Check("actions", message, "refuse", hint or "answer with finite numbers, (steps, 7)")
    if first:
        return Check("connects", message, "refuse", hint or "it refused: its own log says why")
    found = f"broke {broken.where}: {message}"
    return Check("rollouts", found, "refuse", hint or "it broke off: its own log says why")


def on_actions(spec: PolicySpec, hz: int, executed: Array) -> Check:
    """Whether executed actions ``(n, width)`` of several scenes vary, are not clipped, and are in range."""
    if np.ptp(executed, axis=0).max() < SAME:
        numbers = ", ".join(f"{number:.3g}" for number in executed[0])
        return judged("actions", f"{len(executed)} times the same: {numbers}", "constant")
    of_hand = spec.action.width == WIDTH
    moves = executed[:, :6] if of_hand else executed
    moving = moves[:, np.ptp(moves, axis=0) >= SAME]
    sizes = (np.abs(column[column != 0]) for column in moving.T)
    clipped = sum(bool(np.mean(size >= 0.999 * size.max()) >= AT_END) for size in sizes)
    if clipped >= CUT and 2 * clipped > moving.shape[1]:
        detail = f"{clipped} of {moving.shape[1]} numbers are nearly always at an end of their range"
        return judged("actions", detail, "saturated")
    return _on_range(spec, hz, executed) if of_hand else Check("actions", f"{len(executed)} of them")


def _on_range(spec: PolicySpec, hz: int, executed: Array) -> Check:
    action = spec.action
    shifts = np.linalg.norm(executed[:, :3], axis=1) * abs(action.position_scale)
    turns = np.linalg.norm(executed[:, 3:6], axis=1) * abs(action.rotation_scale)
    detail = f"{len(executed)} of them, at most {shifts.max():.2g} m and {turns.max():.2g} rad a step"
    for scale, sizes in (("position_scale", shifts), ("rotation_scale", turns)):
        if np.mean(sizes * hz > FASTEST[scale]) > OFTEN:
            problem = f"no arm is as fast at {hz} Hz"
            return judged("actions", detail, "out of range", problem=problem, scale=scale)
    if max(shifts.max(), turns.max()) < STILL:
        return judged("actions", detail, "out of range", problem="it hardly moves", scale="position_scale")
    return Check("actions", detail)


def on_determinism(spec: PolicySpec, answers: Answers) -> Check:
    """Whether the same moment gets the same answer, compared with what the spec declares."""
    if not answers.noise.any():
        detail = "the same moments get the same answers"
        return Check("determinism", detail if spec.deterministic else f"{detail}, though it may vary")
    detail = f"asked again, its answers change by {answers.relative(float(np.mean(answers.noise))):.1%}{ANYWAY}"
    return judged("determinism", detail, "not deterministic" if spec.deterministic else None)


def on_sight(changes: Mapping[str, Effect]) -> Check:
    """Whether the policy sees, by the changes from visual probes; the last probe shows another scene."""
    if not changes:
        return Check("sight", "it asks for nothing to look at")
    effects = ", ".join(f"{change.size:.0%} with {name}" for name, change in changes.items())
    *_, (view, last) = changes.items()
    fault = None if last.clear else "nearly blind" if any(change.clear for change in changes.values()) else "blind"
    return judged("sight", f"its answers change by {effects}{ANYWAY}", fault, view=view)


def on_hearing(change: Effect | None) -> Check:
    """Whether the instruction matters; None where it need not."""
    if change is None:
        return Check("hearing", "it knows the scene, or hears one instruction in all scenes")
    detail = f"its answers change by {change.size:.0%} with another instruction{ANYWAY}"
    return judged("hearing", detail, None if change.clear else "deaf")


def on_batch(spec: PolicySpec, answers: Answers, together: Sequence[Array] | None) -> Check:
    """Whether observations get the same answers in a batch as alone; None for policies without batches."""
    if together is None:
        return Check("batch", "it takes one observation at a time")
    change = answers.change(together)
    detail = f"its answers change by {change.size:.2%} in a batch"
    if change.clear:
        return judged("batch", detail, "mixed up")
    exact = spec.deterministic and not answers.noise.any()
    return judged("batch", detail, "the last digits depend on the rest of the batch" if change.size and exact else None)


def on_speed(hz: int, seconds: Sequence[float], steps: int) -> Check:
    """Whether an answer takes longer than its ``steps`` executed actions last on a robot."""
    took, lasts = median(seconds[1:] or seconds), steps / hz
    detail = f"an answer takes {took:.2g} s, and lasts for {lasts:.2g} s at {hz} Hz"
    return judged("speed", detail, "slow" if took > lasts else None)


def on_rollouts(outcomes: Sequence[Outcome], breaks: Sequence[Break]) -> Check:
    errors = [outcome.detail for outcome in outcomes if outcome.verdict is Verdict.ERROR]
    if not errors:
        detail = f"{len(outcomes)} rollouts completed"
        if not breaks:
            return Check("rollouts", detail)
        return judged("rollouts", f"{detail}, {len(breaks)} restarted", "it breaks off at times", broken=breaks[0])
    row = on_break(breaks[0], first=False) if breaks else Check("rollouts", errors[0])
    return row._replace(
        found=f"{len(errors)} of {len(outcomes)} rollouts broke: {row.found}",
        verdict="refuse" if len(errors) > 1 or len(outcomes) == 1 else "warn",
        follows=row.follows or "`vlafuzz doctor` checks this machine",
    )


def on_nominal(outcomes: Sequence[Outcome]) -> Check:
    """Whether the policy can do the task at all, by the rollouts that did not break."""
    judgeable = [outcome for outcome in outcomes if outcome.judged]
    passed = sum(outcome.verdict is Verdict.PASSED for outcome in judgeable)
    low, high = wilson(passed, len(judgeable))
    detail = f"succeeds in {passed} of {len(judgeable)} nominal scenes, 95 % interval {low:.0%} to {high:.0%}"
    if 2 * passed >= len(judgeable):
        return Check("nominal", detail)
    if passed:
        return judged("nominal", detail, "it mostly fails")
    progress = np.mean([outcome.progress for outcome in judgeable])
    return judged("nominal", f"{detail}; mean progress {progress:.2f}", "it cannot do the task")
