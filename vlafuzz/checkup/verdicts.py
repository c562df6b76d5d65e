"""Verdicts on what was observed of a subject: each a function from facts to a row."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import median

import numpy as np
from numpy.typing import NDArray

from vlafuzz.checkup.answers import Answers, Change
from vlafuzz.checkup.check import Check
from vlafuzz.checkup.recorder import Break
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.scoring import wilson
from vlafuzz.subjects.base import SubjectSpec
from vlafuzz.subjects.remote import divisor

Array = NDArray[np.float64]
FASTEST = 2.0, 2 * math.pi  # metres and radians a second: what an arm of this kind can do
STILL = 0.001  # metres, and radians, a step: who never does more does not move
AT_END = 0.8  # share of steps at the end of its range from which on a number says nothing but its sign


def on_spec(spec: SubjectSpec) -> Check:
    """Whether it says all that is needed, and nothing that cannot be."""
    if wrong := list(_wrong(spec)):
        return Check("spec", "; ".join(wrong), "refuse", "correct it in the subject's spec")
    if guessed := [name for name, source in spec.provenance.items() if source == "default"]:
        options = " and ".join(f"{name}=…" for name in guessed)
        found = f"nobody says what {' and '.join(guessed)} mean: it is guessed"
        return Check("spec", found, "warn", f"say {options} in the subject's name")
    looks = [camera.name for camera in spec.cameras]
    looks += ["outlines"] * spec.silhouettes + ["the simulator's state"] * spec.privileged
    if not looks:
        follows = "no scene can matter to it: a policy that sees has to ask for cameras"
        return Check("spec", "it asks for nothing to look at", "warn", follows)
    words = [f"sees {', '.join(looks)}", *["proprioception"] * spec.state, f"{spec.action.hz} Hz"]
    return Check("spec", ", ".join(words), "ok")


def _wrong(spec: SubjectSpec) -> list[str]:
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
    hint = broken.hint or ""
    if broken.cause == "bad_action":
        return Check("actions", broken.message, "refuse", hint or "its actions have to be finite numbers")
    if first:
        return Check("connects", broken.message, "refuse", hint or "see what its own log says")
    found = f"broke after {broken.answers} answers of a rollout: {broken.message}"
    return Check(
        "rollouts", found, "refuse", hint or "see what its own log says; every such scene is an ERROR"
    )


def on_actions(spec: SubjectSpec, executed: Array) -> list[Check]:
    """On ``(n, 7)`` actions that were executed in several scenes: not constant, not saturated, in range."""
    return [
        Check("actions", f"{len(executed)} actions, all of them finite", "ok"),
        _on_constant(executed),
        _on_saturated(executed),
        _on_range(spec, executed),
    ]


def _on_constant(executed: Array) -> Check:
    if np.ptp(executed, axis=0).max() > 1e-6:
        return Check("constant", "actions differ", "ok")
    told = ", ".join(f"{number:.3g}" for number in executed[0])
    follows = "whatever it is shown: look at how its pictures are prepared, and how its actions are scaled"
    return Check("constant", f"always the same action: {told}", "refuse", follows)


def _on_saturated(executed: Array) -> Check:
    sizes = np.abs(executed[:, :6])
    most = sizes.max(axis=0)
    moving = (most > 0) & (np.ptp(executed[:, :6], axis=0) > 0)
    there = [column[column > 0] for column in sizes.T[moving]]
    ended = sum(np.mean(column >= 0.999 * column.max()) >= AT_END for column in there)
    found = f"{ended} of {len(there)} numbers that move it are nearly always at the end of their range"
    if ended * 2 <= max(len(there), 1):
        return Check("saturated", "actions are nowhere cut off" if not ended else found, "ok")
    follows = "they are cut off: look at the statistics by which it scales its actions"
    return Check("saturated", found, "refuse", follows)


def _on_range(spec: SubjectSpec, executed: Array) -> Check:
    action = spec.action
    sizes = np.stack([
        np.linalg.norm(executed[:, :3], axis=1) * abs(action.position_scale),
        np.linalg.norm(executed[:, 3:6], axis=1) * abs(action.rotation_scale),
    ])  # fmt: skip
    far, wide = sizes.max(axis=1)
    found = f"at most {far:.2g} m and {wide:.2g} rad a step"
    fast = (sizes * action.hz > np.array(FASTEST)[:, None]).mean(axis=1)
    if fast.max() > 0.1:
        scale = ("position_scale", "rotation_scale")[int(fast.argmax())]
        told = f"{found}: faster than an arm at {action.hz} Hz"
        return Check("range", told, "warn", f"is that the unit of its actions? {scale}=… says it")
    if max(far, wide) < STILL:
        return Check(
            "range", f"{found}: it hardly moves", "warn", "is that the unit? position_scale=… says it"
        )
    return Check("range", found, "ok")


def on_determinism(spec: SubjectSpec, answers: Answers) -> Check:
    """Whether the same moment gets the same answer, beside what the spec says of it."""
    apart = float(answers.noise.max())
    if apart == 0:
        found = "the same moments get the same answers"
        return Check(
            "deterministic", found if spec.deterministic else f"{found}, though it says stochastic", "ok"
        )
    found = f"asked again, its answers change by {np.mean(answers.noise) / answers.spread:.1%}"
    if not spec.deterministic:
        return Check("deterministic", f"{found}, and it says stochastic", "ok")
    follows = "it says deterministic: deterministic=False in its spec, or one seed a rollout"
    return Check("deterministic", found, "warn", follows)


def on_sight(changes: Mapping[str, Change]) -> Check:
    """Whether it sees, from what each sight does to its answers."""
    if not changes:
        return Check("blind", "it asks for nothing to look at", "ok")
    told = ", ".join(f"{name} {change.size:.0%}" for name, change in changes.items())
    found = f"change of its answers with {told}"
    if not any(change.clear for change in changes.values()):
        follows = (
            "blind: what it is shown changes nothing; look at its cameras and the versions of its libraries"
        )
        return Check("blind", found, "refuse", follows)
    *_, (name, last) = changes.items()
    if not last.clear:
        return Check("blind", found, "warn", f"it notices that there is light, but {name} changes nothing")
    return Check("blind", found, "ok")


def on_hearing(change: Change | None) -> Check:
    """Whether the instruction matters; None for a subject that need not hear it."""
    if change is None:
        return Check("deaf", "it knows the scene, whatever it is told", "ok")
    found = f"change of its answers with another instruction {change.size:.0%}"
    if change.clear:
        return Check("deaf", found, "ok")
    follows = "deaf: it does the same whatever it is told; look at how the instruction gets to it"
    return Check("deaf", found, "warn", follows)


def on_proprioception(change: Change | None) -> Check:
    """Whether the state that it asks for matters."""
    if change is None:
        return Check("proprioception", "it asks for none", "ok")
    found = f"change of its answers with another pose of the hand {change.size:.0%}"
    if change.clear:
        return Check("proprioception", found, "ok")
    follows = "it asks for it and does not use it: look at its layout, state=…"
    return Check("proprioception", found, "warn", follows)


def on_batch(spec: SubjectSpec, answers: Answers, together: Sequence[Array] | None) -> Check:
    """Whether several at once get what each gets alone; None where it never gets several."""
    if together is None:
        return Check("batch", "it takes one observation at a time", "ok")
    change = answers.change(together)
    found = f"change of its answers when {len(together)} are asked for at once {change.size:.2%}"
    if answers.crossed(together):
        return Check(
            "batch",
            f"{found}: they are in another order",
            "refuse",
            "answer in the order of the observations",
        )
    if change.clear:
        return Check("batch", found, "refuse", "an answer is to depend on its own observation alone")
    if change.size and spec.deterministic:
        follows = "the last digits depend on the company: deterministic=False in its spec, or max_batch=1"
        return Check("batch", found, "warn", follows)
    return Check("batch", found, "ok")


def on_speed(spec: SubjectSpec, seconds: Sequence[float], steps: int) -> Check:
    """Whether an answer takes longer than the actions of it, ``steps`` of them, last on a robot."""
    took, lasts = median(seconds[1:] or seconds), steps / spec.action.hz
    found = f"{took:.2g} s an answer, whose actions last {lasts:.2g} s at {spec.action.hz} Hz"
    if took <= lasts:
        return Check("speed", found, "ok")
    follows = "slow: a robot would wait for it, here it only takes long; execute more of a chunk, or lower hz"
    return Check("speed", found, "warn", follows)


def on_rollouts(outcomes: Sequence[Outcome], breaks: Sequence[Break]) -> Check:
    """Whether it lasts for whole rollouts."""
    errors = [outcome.detail for outcome in outcomes if outcome.verdict is Verdict.ERROR]
    if not errors:
        return Check("rollouts", f"{len(outcomes)} rollouts to their end", "ok")
    found = f"{len(errors)} of {len(outcomes)} rollouts broke"
    if not breaks:
        return Check("rollouts", f"{found}: {errors[0]}", "refuse", "`vlafuzz doctor` checks this machine")
    row = on_break(breaks[0], first=False)
    return row._replace(found=f"{found}: {row.found}")


def on_nominal(outcomes: Sequence[Outcome]) -> Check:
    """Whether it can do the task at all."""
    passed = sum(outcome.verdict is Verdict.PASSED for outcome in outcomes)
    low, high = wilson(passed, len(outcomes))
    found = f"succeeds in {passed} of {len(outcomes)} nominal scenes, 95 % interval {low:.0%} to {high:.0%}"
    if 2 * passed >= len(outcomes):
        return Check("nominal", found, "ok")
    if passed:
        return Check("nominal", found, "warn", "most of its failures will say nothing about the scenes")
    progress = np.mean([outcome.progress for outcome in outcomes])
    follows = "it cannot do the task: its failures say nothing about the scenes"
    return Check("nominal", f"{found}; mean progress {progress:.2f}", "refuse", follows)
