"""Verdicts on the observations of a policy: functions from facts to checks."""

import math
from collections.abc import Mapping, Sequence
from statistics import median

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.statistics import wilson
from vlafuzz.doctor import Check, Rating
from vlafuzz.doctor.probes import Answers, Break, Change
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.policies.base import PolicySpec
from vlafuzz.policies.harness import WIDTH

Array = NDArray[np.float64]
FASTEST = 2.0, 2 * math.pi  # metres and radians per second that such an arm can reach
OFTEN = 0.1  # share of steps above that speed from which on actions are out of range
STILL = 0.001  # metres and radians per step below which the hand does not really move
SAME = 1e-6
AT_END = 0.8  # share of steps at an end of its range from which on a number counts as clipped
CUT = 3  # clipped numbers; fewer may be intended, as in a straight descent at constant speed
ANYWAY = " (100%: as much as from moment to moment)"


def on_spec(spec: PolicySpec) -> Check:
    """Whether the spec is complete."""
    if guessed := [name for name, source in spec.provenance.items() if source == "default"]:
        options = " and ".join(f"{name}=…" for name in guessed)
        detail = f"neither server nor options declare {' and '.join(guessed)}"
        return Check("spec", detail, "warn", f"guessed: say {options} in the policy's name")
    views = [camera.name for camera in spec.cameras]
    views += ["outlines"] * spec.silhouettes + ["the simulator's state"] * spec.privileged
    if not views:
        advice = "where scenes are seen in pictures, none matters to it; a policy that sees asks for cameras"
        return Check("spec", "it asks for no pictures", "warn", advice)
    words = [f"sees {', '.join(views)}", *["proprioception"] * spec.state, f"{spec.action.hz} Hz"]
    return Check("spec", ", ".join(words), "ok")


def on_break(broken: Break, *, first: bool) -> Check:
    """A break of the policy: in an answer, before the first one (``first``), or later."""
    message, hint = " ".join(broken.error.message.split()), broken.error.hint
    if broken.error.cause == "bad_action":
        return Check("actions", message, "refuse", hint or "answer with finite numbers, (steps, 7)")
    if first:
        return Check("connects", message, "refuse", hint or "it refused: its own log says why")
    advice = hint or "it broke off: its own log says why"
    return Check("rollouts", f"broke {broken.where}: {message}", "refuse", advice)


def on_actions(spec: PolicySpec, executed: Array) -> Check:
    """Whether executed actions ``(n, width)`` of several scenes vary, are not clipped, and are in range."""
    if np.ptp(executed, axis=0).max() < SAME:
        numbers = ", ".join(f"{number:.3g}" for number in executed[0])
        advice = "constant: its actions do not depend on the scene; look at how pictures are prepared"
        return Check("actions", f"{len(executed)} times the same: {numbers}", "refuse", advice)
    of_hand = spec.action.width == WIDTH
    moves = executed[:, :6] if of_hand else executed
    moving = moves[:, np.ptp(moves, axis=0) >= SAME]
    clipped = sum(_is_clipped(column) for column in moving.T)
    if clipped >= CUT and 2 * clipped > moving.shape[1]:
        detail = f"{clipped} of {moving.shape[1]} numbers are nearly always at an end of their range"
        advice = "saturated: they are clipped; look at the statistics by which it scales its actions"
        return Check("actions", detail, "refuse", advice)
    return _on_range(spec, executed) if of_hand else Check("actions", f"{len(executed)} of them", "ok")


def _is_clipped(numbers: Array) -> bool:
    sizes = np.abs(numbers[numbers != 0])
    return bool(np.mean(sizes >= 0.999 * sizes.max()) >= AT_END)


def _on_range(spec: PolicySpec, executed: Array) -> Check:
    action = spec.action
    shifts = np.linalg.norm(executed[:, :3], axis=1) * abs(action.position_scale)
    turns = np.linalg.norm(executed[:, 3:6], axis=1) * abs(action.rotation_scale)
    detail = f"{len(executed)} of them, at most {shifts.max():.2g} m and {turns.max():.2g} rad a step"
    scales = (shifts, FASTEST[0], "position_scale"), (turns, FASTEST[1], "rotation_scale")
    for sizes, fastest, scale in scales:
        if np.mean(sizes * action.hz > fastest) > OFTEN:
            advice = f"out of range: no arm is as fast at {action.hz} Hz; {scale}=… says what their unit is"
            return Check("actions", detail, "warn", advice)
    if max(shifts.max(), turns.max()) < STILL:
        advice = "out of range: it hardly moves; position_scale=… says what their unit is"
        return Check("actions", detail, "warn", advice)
    return Check("actions", detail, "ok")


def on_determinism(spec: PolicySpec, answers: Answers) -> Check:
    """Whether the same moment gets the same answer, compared with what the spec declares."""
    if not answers.noise.any():
        detail = "the same moments get the same answers"
        return Check("determinism", detail if spec.deterministic else f"{detail}, though it may vary", "ok")
    noise = answers.relative(float(np.mean(answers.noise)))
    detail = f"asked again, its answers change by {noise:.1%}{ANYWAY}"
    if not spec.deterministic:
        return Check("determinism", detail, "ok")
    advice = "not deterministic: seed it with each rollout's seed, or say deterministic=False"
    return Check("determinism", detail, "warn", advice)


def on_sight(changes: Mapping[str, Change]) -> Check:
    """Whether the policy sees, by the changes from visual probes; the last probe shows another scene."""
    if not changes:
        return Check("sight", "it asks for nothing to look at", "ok")
    effects = ", ".join(f"{change.size:.0%} with {name}" for name, change in changes.items())
    detail = f"its answers change by {effects}{ANYWAY}"
    if not any(change.clear for change in changes.values()):
        advice = "blind: nothing that it is shown matters; look at its cameras and its libraries' versions"
        return Check("sight", detail, "refuse", advice)
    *_, (name, last) = changes.items()
    if not last.clear:
        advice = f"nearly blind: it notices darkness, but {name} changes nothing"
        return Check("sight", detail, "warn", advice)
    return Check("sight", detail, "ok")


# By sense: what is changed, what is said without a change, and what follows where it does not matter.
_SENSES = {
    "hearing": (
        "instruction",
        "it knows the scene, whatever the instruction",
        "deaf: it ignores its instruction; look at how the instruction gets to it",
    ),
    "proprioception": (
        "pose of the hand",
        "it asks for none",
        "it asks for the pose of the hand and does not use it: look at the layout, state=…",
    ),
}


def on_sense(sense: str, change: Change | None) -> Check:
    """Whether the instruction or the proprioception matters; None where it need not, or is not asked for."""
    other, without, advice = _SENSES[sense]
    if change is None:
        return Check(sense, without, "ok")
    detail = f"its answers change by {change.size:.0%} with another {other}{ANYWAY}"
    return Check(sense, detail, "ok") if change.clear else Check(sense, detail, "warn", advice)


def on_batch(spec: PolicySpec, answers: Answers, together: Sequence[Array] | None) -> Check:
    """Whether observations get the same answers in a batch as alone; None for policies without batches."""
    if together is None:
        return Check("batch", "it takes one observation at a time", "ok")
    change = answers.change(together)
    detail = f"its answers change by {change.size:.2%} in a batch"
    if answers.crossed(together):
        advice = "mixed up: they belong to other observations; answer in the order of the observations"
        return Check("batch", detail, "refuse", advice)
    if change.clear:
        advice = "mixed up: an answer must depend on its own observation alone"
        return Check("batch", detail, "refuse", advice)
    if change.size and spec.deterministic and not answers.noise.any():
        advice = "the last digits depend on the rest of the batch: say deterministic=False, or max_batch=1"
        return Check("batch", detail, "warn", advice)
    return Check("batch", detail, "ok")


def on_speed(spec: PolicySpec, seconds: Sequence[float], steps: int) -> Check:
    """Whether an answer takes longer than its ``steps`` executed actions last on a robot."""
    took, lasts = median(seconds[1:] or seconds), steps / spec.action.hz
    detail = f"an answer takes {took:.2g} s, and lasts for {lasts:.2g} s at {spec.action.hz} Hz"
    if took <= lasts:
        return Check("speed", detail, "ok")
    advice = "slow: a robot would wait for it, here it only takes long; execute more of a chunk, or lower hz"
    return Check("speed", detail, "warn", advice)


def on_rollouts(outcomes: Sequence[Outcome], breaks: Sequence[Break]) -> Check:
    """Whether the policy completes its rollouts."""
    errors = [outcome.detail for outcome in outcomes if outcome.verdict is Verdict.ERROR]
    if not errors:
        detail = f"{len(outcomes)} rollouts completed"
        if not breaks:
            return Check("rollouts", detail, "ok")
        advice = f"it breaks off at times, the first time {breaks[0].where}: {breaks[0].error.message}"
        return Check("rollouts", f"{detail}, {len(breaks)} restarted", "warn", advice)
    detail = f"{len(errors)} of {len(outcomes)} rollouts broke"
    verdict: Rating = "refuse" if len(errors) > 1 or len(outcomes) == 1 else "warn"
    if not breaks:
        return Check("rollouts", f"{detail}: {errors[0]}", verdict, "`vlafuzz doctor` checks this machine")
    row = on_break(breaks[0], first=False)
    return row._replace(found=f"{detail}: {row.found}", verdict=verdict)


def on_nominal(outcomes: Sequence[Outcome]) -> Check:
    """Whether the policy can do the task at all, by the rollouts that did not break."""
    judged = [outcome for outcome in outcomes if outcome.verdict >= Verdict.PASSED]
    passed = sum(outcome.verdict is Verdict.PASSED for outcome in judged)
    low, high = wilson(passed, len(judged))
    detail = f"succeeds in {passed} of {len(judged)} nominal scenes, 95 % interval {low:.0%} to {high:.0%}"
    if 2 * passed >= len(judged):
        return Check("nominal", detail, "ok")
    if passed:
        return Check("nominal", detail, "warn", "most of its failures will say nothing about the scenes")
    progress = np.mean([outcome.progress for outcome in judged])
    advice = "it cannot do the task: its failures say nothing about the scenes"
    return Check("nominal", f"{detail}; mean progress {progress:.2f}", "refuse", advice)
