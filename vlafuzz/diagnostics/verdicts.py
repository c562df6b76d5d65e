"""Verdicts on what was observed of a policy: each a function from facts to a row."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import median

import numpy as np
from numpy.typing import NDArray

from vlafuzz.clients.remote import divisor
from vlafuzz.diagnostics.answers import Answers, Change
from vlafuzz.diagnostics.check import Check, Rating
from vlafuzz.diagnostics.recorder import Break
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.policies.base import PolicySpec
from vlafuzz.statistics import wilson

Array = NDArray[np.float64]
FASTEST = 2.0, 2 * math.pi  # metres and radians a second: what an arm of this kind can do
OFTEN = 0.1  # share of steps
STILL = 0.001  # metres, and radians, a step: who never does more does not move
SAME = 1e-6
AT_END = 0.8  # share of steps at an end of its range from which on a number says no more than its sign
CUT = 3  # numbers: who only moves straight down may well do it at one speed
ANYWAY = " (100%: as much as from moment to moment)"


def on_spec(spec: PolicySpec) -> Check:
    """Whether it says all that is needed, and nothing that cannot be."""
    if wrong := list(_wrong(spec)):
        return Check("spec", "; ".join(wrong), "refuse", "correct it in the policy's spec")
    if guessed := [name for name, source in spec.provenance.items() if source == "default"]:
        options = " and ".join(f"{name}=…" for name in guessed)
        found = f"nobody says what {' and '.join(guessed)} mean"
        return Check("spec", found, "warn", f"guessed: say {options} in the policy's name")
    looks = [camera.name for camera in spec.cameras]
    looks += ["outlines"] * spec.silhouettes + ["the simulator's state"] * spec.privileged
    if not looks:
        follows = "sees nothing: no scene matters to it; a policy that sees has to ask for cameras"
        return Check("spec", "it asks for nothing to look at", "warn", follows)
    words = [f"sees {', '.join(looks)}", *["proprioception"] * spec.state, f"{spec.action.hz} Hz"]
    return Check("spec", ", ".join(words), "ok")


def _wrong(spec: PolicySpec) -> list[str]:
    action, names = spec.action, [camera.name for camera in spec.cameras]
    found = []
    try:
        divisor(action.hz)
    except ValueError as error:
        found.append(f"hz: {error}")
    for name in ("position_scale", "rotation_scale"):
        scale = getattr(action, name)
        if not math.isfinite(scale) or scale == 0:
            found.append(f"{name} is {scale}")
    if len(set(names)) < len(names):
        found.append(f"two cameras have one name: {', '.join(names)}")
    found += [
        f"the camera {each.name} has no pixels" for each in spec.cameras if each.width * each.height < 1
    ]
    if (spec.execute or 1) < 1 or spec.max_batch < 1:
        found.append(f"execute is {spec.execute}, max_batch is {spec.max_batch}")
    return found


def on_break(broken: Break, *, first: bool) -> Check:
    """What broke: before anything was answered, in an answer, or on the way."""
    told, hint = " ".join(broken.message.split()), broken.hint
    if broken.cause == "bad_action":
        return Check("actions", told, "refuse", hint or "answer with finite numbers, (steps, 7)")
    if first:
        return Check("connects", told, "refuse", hint or "it refused: its own log says why")
    found = f"broke {broken.where}: {told}"
    return Check("rollouts", found, "refuse", hint or "it broke off: its own log says why")


def on_actions(spec: PolicySpec, executed: Array) -> Check:
    """On ``(n, 7)`` actions that were executed in several scenes: not constant, not cut off, in range."""
    if np.ptp(executed, axis=0).max() < SAME:
        told = ", ".join(f"{number:.3g}" for number in executed[0])
        follows = "constant: it does the same whatever it is shown; look at how pictures are prepared"
        return Check("actions", f"{len(executed)} times the same: {told}", "refuse", follows)
    moves = executed[:, :6]
    moving = moves[:, np.ptp(moves, axis=0) >= SAME]
    cut = sum(_is_cut(column) for column in moving.T)
    if cut >= CUT and 2 * cut > moving.shape[1]:
        found = f"{cut} of {moving.shape[1]} numbers are nearly always at an end of their range"
        follows = "saturated: they are cut off; look at the statistics by which it scales its actions"
        return Check("actions", found, "refuse", follows)
    return _on_range(spec, executed)


def _is_cut(numbers: Array) -> bool:
    sizes = np.abs(numbers[numbers != 0])
    return bool(np.mean(sizes >= 0.999 * sizes.max()) >= AT_END)


def _on_range(spec: PolicySpec, executed: Array) -> Check:
    action = spec.action
    shifts = np.linalg.norm(executed[:, :3], axis=1) * abs(action.position_scale)
    turns = np.linalg.norm(executed[:, 3:6], axis=1) * abs(action.rotation_scale)
    found = f"{len(executed)} of them, at most {shifts.max():.2g} m and {turns.max():.2g} rad a step"
    for sizes, fastest, scale in (
        (shifts, FASTEST[0], "position_scale"),
        (turns, FASTEST[1], "rotation_scale"),
    ):
        if np.mean(sizes * action.hz > fastest) > OFTEN:
            follows = f"out of range: no arm is as fast at {action.hz} Hz; {scale}=… says what their unit is"
            return Check("actions", found, "warn", follows)
    if max(shifts.max(), turns.max()) < STILL:
        follows = "out of range: it hardly moves; position_scale=… says what their unit is"
        return Check("actions", found, "warn", follows)
    return Check("actions", found, "ok")


def on_determinism(spec: PolicySpec, answers: Answers) -> Check:
    """Whether the same moment gets the same answer, beside what the spec says of it."""
    if not answers.noise.any():
        found = "the same moments get the same answers"
        return Check("determinism", found if spec.deterministic else f"{found}, though it may vary", "ok")
    found = f"asked again, its answers change by {answers.share(float(np.mean(answers.noise))):.1%}{ANYWAY}"
    if not spec.deterministic:
        return Check("determinism", found, "ok")
    follows = "not deterministic: seed it with each rollout's seed, or say deterministic=False"
    return Check("determinism", found, "warn", follows)


def on_sight(changes: Mapping[str, Change]) -> Check:
    """Whether it sees, by what each sight does to its answers; of another scene's the last."""
    if not changes:
        return Check("sight", "it asks for nothing to look at", "ok")
    told = ", ".join(f"{change.size:.0%} with {name}" for name, change in changes.items())
    found = f"its answers change by {told}{ANYWAY}"
    if not any(change.clear for change in changes.values()):
        follows = "blind: nothing that it is shown matters; look at its cameras and its libraries' versions"
        return Check("sight", found, "refuse", follows)
    *_, (name, last) = changes.items()
    if not last.clear:
        return Check("sight", found, "warn", f"nearly blind: it notices darkness, but {name} changes nothing")
    return Check("sight", found, "ok")


def on_hearing(change: Change | None) -> Check:
    """Whether the instruction matters; None for a policy that need not hear it."""
    follows = "deaf: it does the same whatever it is told; look at how the instruction gets to it"
    found = "its answers change by {:.0%} with another instruction"
    return _on_sense("hearing", change, "it knows the scene, whatever it is told", found, follows)


def on_proprioception(change: Change | None) -> Check:
    """Whether the state that it asks for matters; None when it asks for none."""
    follows = "it asks for the pose of the hand and does not use it: look at the layout, state=…"
    found = "its answers change by {:.0%} with another pose of the hand"
    return _on_sense("proprioception", change, "it asks for none", found, follows)


def _on_sense(check: str, change: Change | None, spared: str, found: str, follows: str) -> Check:
    if change is None:
        return Check(check, spared, "ok")
    told = found.format(change.size) + ANYWAY
    return Check(check, told, "ok") if change.clear else Check(check, told, "warn", follows)


def on_batch(spec: PolicySpec, answers: Answers, together: Sequence[Array] | None) -> Check:
    """Whether several at once get what each gets alone; None where it takes one at a time."""
    if together is None:
        return Check("batch", "it takes one observation at a time", "ok")
    change = answers.change(together)
    found = f"its answers change by {change.size:.2%} when several are asked for at once"
    if answers.crossed(together):
        follows = "mixed up: they belong to other observations; answer in the order in which they came"
        return Check("batch", found, "refuse", follows)
    if change.clear:
        return Check(
            "batch", found, "refuse", "mixed up: an answer is to depend on its own observation alone"
        )
    if change.size and spec.deterministic and not answers.noise.any():
        follows = "the last digits depend on the company: say deterministic=False, or max_batch=1"
        return Check("batch", found, "warn", follows)
    return Check("batch", found, "ok")


def on_speed(spec: PolicySpec, seconds: Sequence[float], steps: int) -> Check:
    """Whether an answer takes longer than the actions of it, ``steps`` of them, last on a robot."""
    took, lasts = median(seconds[1:] or seconds), steps / spec.action.hz
    found = f"{took:.2g} s an answer, which lasts for {lasts:.2g} s at {spec.action.hz} Hz"
    if took <= lasts:
        return Check("speed", found, "ok")
    follows = "slow: a robot would wait for it, here it only takes long; execute more of a chunk, or lower hz"
    return Check("speed", found, "warn", follows)


def on_rollouts(outcomes: Sequence[Outcome], breaks: Sequence[Break]) -> Check:
    """Whether it lasts for whole rollouts."""
    errors = [outcome.detail for outcome in outcomes if outcome.verdict is Verdict.ERROR]
    if not errors:
        found = f"{len(outcomes)} rollouts to their end"
        if not breaks:
            return Check("rollouts", found, "ok")
        follows = f"it breaks off at times, the first time {breaks[0].where}: {breaks[0].message}"
        return Check("rollouts", f"{found}, {len(breaks)} begun again", "warn", follows)
    found = f"{len(errors)} of {len(outcomes)} rollouts broke"
    verdict: Rating = "refuse" if len(errors) > 1 or len(outcomes) == 1 else "warn"
    if not breaks:
        return Check("rollouts", f"{found}: {errors[0]}", verdict, "`vlafuzz doctor` checks this machine")
    row = on_break(breaks[0], first=False)
    return row._replace(found=f"{found}: {row.found}", verdict=verdict)


def on_nominal(outcomes: Sequence[Outcome]) -> Check:
    """Whether it can do the task at all, by the rollouts that did not break."""
    judged = [outcome for outcome in outcomes if outcome.verdict >= Verdict.PASSED]
    passed = sum(outcome.verdict is Verdict.PASSED for outcome in judged)
    low, high = wilson(passed, len(judged))
    found = f"succeeds in {passed} of {len(judged)} nominal scenes, 95 % interval {low:.0%} to {high:.0%}"
    if 2 * passed >= len(judged):
        return Check("nominal", found, "ok")
    if passed:
        return Check("nominal", found, "warn", "most of its failures will say nothing about the scenes")
    progress = np.mean([outcome.progress for outcome in judged])
    follows = "it cannot do the task: its failures say nothing about the scenes"
    return Check("nominal", f"{found}; mean progress {progress:.2f}", "refuse", follows)
