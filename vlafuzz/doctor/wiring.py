"""Wiring: whether a swapped or inverted convention makes a policy fail; then one correction lets it succeed.

A correction may also help a policy that is wired correctly: shorter moves make up for noise, for example. So it must
add more than ``SHIFT`` of progress, about a stage, in scenes other than those in which it was chosen among all
corrections.

In the test, a bet against "it adds at most ``bound`` on average" multiplies the bettor's wealth by ``1 + stake (gain -
bound)`` after every scene, which is no expected gain as long as that holds, and never goes below 0. By Ville's
inequality (1939), the wealth then ever reaches ``1 / ALPHA`` with probability at most ``ALPHA``, whatever the
distribution of the gains (Waudby-Smith and Ramdas 2024, <https://doi.org/10.1093/jrsssb/qkad009>).
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from statistics import fmean

import numpy as np

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.common.check import Check
from vlafuzz.doctor.probes import Lent
from vlafuzz.model import Outcome, Scene, Verdict
from vlafuzz.policies.base import ActionChunk, Observation, PolicySpec
from vlafuzz.policies.harness import WIDTH

Pair = tuple[Scene, Outcome]
FEWEST = 2  # failures among successes from which on a fault of wiring is looked for
SCREENED = 2  # failed scenes in which every correction is tried
CLEARLY = 0.1  # mean gain in progress from which on a correction is tried in further scenes
SHIFT = 0.3  # mean gain in progress that a correctly wired policy may have, too
ALPHA = 0.05  # significance level: probability of naming a correction that adds at most SHIFT
KEPT = 3  # solved scenes in which the correction must do no harm
MOST = 50  # further scenes for the best correction
HOPELESS = 0.1  # wealth below which it is not tried any further
# Stakes, as shares of the largest with which the wealth cannot go below 0, and how the wealth is split.
_STAKES = np.array([0.5, 0.95])
_SPLIT = np.array([1, 2]) / 3


@dataclass(frozen=True)
class Correction:
    """A transformation of pictures on their way to the policy, or of actions on their way back.

    ``fault``: what is wrong if it helps. ``advice``: what the user should change. ``actions``: transforms a chunk
    ``(steps, 7)`` in the units of the spec.
    """

    fault: str
    advice: str
    actions: Callable[[Array, PolicySpec], Array] = lambda chunk, _: chunk
    picture: Callable[[Picture], Picture] = lambda picture: picture


Roll = Callable[[Scene, Correction | None], Outcome]


class Corrected(Lent):
    """A policy with an exchangeable correction; None for the policy as it is."""

    correction: Correction | None = None

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        if self.correction is None:
            return super().act(observations)
        change, convert = self.correction.picture, self.correction.actions
        shown = [
            replace(seen, images={name: np.ascontiguousarray(change(of)) for name, of in seen.images.items()})
            for seen in observations
        ]
        return [ActionChunk(convert(np.array(chunk.actions), self.spec)) for chunk in super().act(shown)]


def corrections(spec: PolicySpec, longest: int) -> list[Correction]:
    """The corrections that apply to a policy whose longest chunk has ``longest`` actions.

    Scales come last, since shorter moves make up for many other faults, above all for delayed actions.
    """
    pictures = _PICTURES if spec.cameras else ()
    if spec.action.width != WIDTH:
        return list(pictures)  # what other numbers mean is not known
    late = (_late(number) for number in range(1, min(longest, 3)))
    return [*_ACTIONS, *late, *pictures, *_LENGTHS]


def _turned(fault: str, moves: object, turns: object = None, advice: str = "") -> Correction:
    """A correction that gives moves and turns in another frame, by ``(3, 3)`` matrices; None for the same one."""
    both = [np.eye(3) if matrix is None else np.array(matrix) for matrix in (moves, turns)]

    def actions(chunk: Array, _: PolicySpec) -> Array:
        return np.hstack([chunk[:, :3] @ both[0].T, chunk[:, 3:6] @ both[1].T, chunk[:, 6:]])

    return Correction(fault, advice or "give moves and turns in the frame of the robot's base", actions)


def _scaled(factor: float) -> Correction:
    scale = f"{factor:g} times" if factor > 1 else f"1/{1 / factor:g} of"
    advice = f"make position_scale about {scale} its present value"
    by = np.array([factor] * 3 + [1.0] * 4)
    return Correction("its moves have the wrong length", advice, lambda chunk, _: chunk * by)


def _late(number: int) -> Correction:
    steps = f"{number} step{'s' * (number > 1)}"
    return Correction(
        f"its chunks begin {steps} too early",
        f"begin chunks with the action for the current step: the first {steps} are in the past",
        lambda chunk, _: chunk[number:] if len(chunk) > number else chunk,
    )


def _seen(fault: str, advice: str, picture: Callable[[Picture], Picture]) -> Correction:
    return Correction(fault, f"{advice} before the model sees them", picture=picture)


def _grip(chunk: Array, spec: PolicySpec) -> Array:
    chunk[:, 6] = (1.0 if spec.action.gripper.endswith("01") else 0.0) - chunk[:, 6]
    return chunk


BGR = "its model was trained on BGR pictures"
_QUARTER = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
_HALF = np.diag([-1, -1, 1])
_ACTIONS = (
    _turned("x and y of its moves are swapped", [[0, 1, 0], [1, 0, 0], [0, 0, 1]]),
    *(
        _turned(f"{axis} of its moves has the wrong sign", np.diag(1 - 2 * np.eye(3, dtype=int)[number]))
        for number, axis in enumerate("xyz")
    ),
    _turned("its frame is turned by a quarter about z", _QUARTER, _QUARTER),
    _turned("its frame is turned by a quarter about z", _QUARTER.T, _QUARTER.T),
    _turned("its frame is turned by half about z", _HALF, _HALF),
    _turned(
        "its yaw has the wrong sign",
        None,
        np.diag([1, 1, -1]),
        "turn it the other way: a negative rotation_scale, if the other turns are wrong, too",
    ),
    Correction("its gripper opens where it should close", "give the other convention of gripper=", _grip),
)
_LENGTHS = tuple(_scaled(factor) for factor in (20, 5, 1 / 5, 1 / 20))
_PICTURES = (
    _seen("it gets red and blue exchanged", f"{BGR}: exchange the channels", lambda of: of[..., ::-1]),
    _seen("it gets its pictures upside down", "flip them", lambda of: of[::-1]),
    _seen("it gets its pictures mirrored", "mirror them", lambda of: of[:, ::-1]),
    _seen("it gets its pictures turned by half", "turn them by 180 degrees", lambda of: of[::-1, ::-1]),
)


class CorrectionTrial:
    """One correction in further scenes: progress without it and with it."""

    def __init__(self) -> None:
        self.progress: list[tuple[float, float]] = []

    def see(self, without: Outcome, corrected: Outcome) -> None:
        """Add a scene; it does not count if a rollout was invalid or broke."""
        if min(without.verdict, corrected.verdict) >= Verdict.PASSED:
            self.progress.append((without.progress, corrected.progress))

    def wealth(self, bound: float, more: int = 0) -> float:
        """The bettor's wealth, from 1, after these and ``more`` of the largest possible gains."""
        gains = np.array([*(corrected - without for without, corrected in self.progress), *[1.0] * more])
        return float(_SPLIT @ (1 + np.outer(_STAKES / (1 + bound), gains - bound)).prod(axis=1))

    def adds(self, bound: float) -> bool:
        """Whether the correction significantly adds more than ``bound`` of progress."""
        return self.wealth(bound) >= 1 / ALPHA


def check_wiring(
    outcomes: Sequence[Pair], fresh: Iterable[Scene], candidates: Sequence[Correction], roll: Roll
) -> Check:
    """Try all corrections where the policy failed, then the best of them in similar scenes.

    ``outcomes``: of nominal scenes, without a correction. ``fresh``: further nominal scenes.
    """
    failed = [(scene, outcome) for scene, outcome in outcomes if outcome.verdict is Verdict.FAILED][:SCREENED]
    if not failed:
        return Check("wiring", "it succeeds as it is: nothing to correct", "ok")
    if len(failed) < FEWEST and any(outcome.passed for _, outcome in outcomes):
        few = f"{len(failed)} failure in {len(outcomes)} nominal scenes: too few to look for a fault"
        return Check("wiring", few, "ok", "a larger --n tells more")

    best, gain = _best(failed, candidates, roll)
    if gain > CLEARLY:
        trial = _try(best, _alike([scene for scene, _ in failed], fresh), roll)
        solved = [scene for scene, outcome in outcomes if outcome.verdict is Verdict.PASSED][:KEPT]
        if trial.adds(SHIFT) and fmean([roll(scene, best).passed for scene in solved] or [1]) >= 0.5:
            without, corrected = np.mean(trial.progress, axis=0)
            rise = f"raises its progress from {without:.2f} to {corrected:.2f}"
            detail = f"{best.fault}: correcting this {rise} in {len(trial.progress)} scenes like those that failed"
            return Check("wiring", detail, "refuse", f"miswired: {best.advice}")
    return Check("wiring", f"none of {len(candidates)} corrections clearly raises its progress", "ok")


def most_rollouts(candidates: Sequence[Correction]) -> int:
    """The most that ``check_wiring`` takes; mostly it ends sooner."""
    return SCREENED * len(candidates) + 2 * MOST + KEPT


def _best(failed: Sequence[Pair], candidates: Sequence[Correction], roll: Roll) -> tuple[Correction, float]:
    """The correction with the largest mean gain; the search stops when all scenes pass with one.

    Beyond the first scene only those are tried that raised the progress there, or all if none did.
    """
    gains: dict[Correction, list[float]] = {}

    def passes(correction: Correction, scene: Scene, before: Outcome) -> bool:
        after = roll(scene, correction)
        gains.setdefault(correction, []).append(after.progress - before.progress)
        return after.verdict is Verdict.PASSED

    for correction in candidates:
        if all(passes(correction, *pair) for pair in failed):
            return correction, fmean(gains[correction])
    raised = [correction for correction in candidates if gains[correction][0] > 0] or candidates
    for correction in raised:
        for pair in failed[len(gains[correction]) :]:
            passes(correction, *pair)
    best = max(raised, key=lambda correction: fmean(gains[correction]))
    return best, fmean(gains[best])


def _alike(failed: Sequence[Scene], fresh: Iterable[Scene]) -> Iterator[Scene]:
    """Scenes with the same objects and orientations in fresh places: a fault may affect few objects only."""
    for scene, other in zip(cycle(failed), fresh, strict=False):
        pairs = zip(scene.targets, other.targets, strict=True)
        yield replace(scene, targets=tuple(replace(target, x=place.x, y=place.y) for target, place in pairs))


def _try(correction: Correction, scenes: Iterable[Scene], roll: Roll) -> CorrectionTrial:
    """Roll out scenes until the correction adds more than ``SHIFT``, or hardly can within ``MOST`` scenes."""
    trial = CorrectionTrial()
    for number, scene in enumerate(scenes):
        hopeless = trial.wealth(SHIFT) < HOPELESS or trial.wealth(SHIFT, MOST - number) < 1 / ALPHA
        if hopeless or trial.adds(SHIFT):
            break
        trial.see(roll(scene, None), roll(scene, correction))
    return trial
