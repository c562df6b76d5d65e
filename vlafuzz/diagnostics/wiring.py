"""Wiring: whether a swapped or inverted convention makes a policy fail; then one correction clearly helps."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from vlafuzz.diagnostics import Check
from vlafuzz.diagnostics.recorder import Lent
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.policies.base import ActionChunk, Observation, PolicySpec
from vlafuzz.regression.e_process import wealth
from vlafuzz.scene import Scene

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Matrix = Sequence[Sequence[int]]
_SAME = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
SCREENED = 2  # failed scenes in which every correction is tried
CLEARLY = 0.1  # smallest difference in progress that counts
ALPHA = 0.05  # significance level: probability of naming a correction that does not help
KEPT = 3  # solved scenes in which the correction must do no harm
MOST = 25  # further scenes for the best correction


@dataclass(frozen=True, kw_only=True)
class Correction:
    """A transformation of pictures on their way to the policy, or of actions on their way back.

    ``fault``: what is wrong if it helps. ``advice``: what the user should change. ``actions``: transforms a
    chunk ``(steps, 7)`` in the units of the spec.
    """

    fault: str
    advice: str
    actions: Callable[[Array, PolicySpec], Array] | None = None
    picture: Callable[[Picture], Picture] | None = None


class Corrected(Lent):
    """A policy with an exchangeable correction; None for the policy as it is."""

    correction: Correction | None = None

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        correction = self.correction
        if correction is None:
            return super().act(observations)
        if correction.picture is not None:
            observations = [_pictured(seen, correction.picture) for seen in observations]
        chunks = super().act(observations)
        if correction.actions is None:
            return chunks
        return [ActionChunk(correction.actions(np.array(chunk.actions), self.spec)) for chunk in chunks]


def corrections(spec: PolicySpec, longest: int) -> list[Correction]:
    """The corrections that apply to a policy whose longest chunk has ``longest`` actions.

    Scales come last, since shorter moves make up for many other faults, above all for delayed actions.
    """
    late = (_late(number) for number in range(1, min(longest, 3)))
    return [*_ACTIONS, *late, *(_PICTURES if spec.cameras else ()), *_LENGTHS]


def _pictured(seen: Observation, change: Callable[[Picture], Picture]) -> Observation:
    images = {name: np.ascontiguousarray(change(picture)) for name, picture in seen.images.items()}
    return replace(seen, images=images)


def _axes(fault: str, moves: Matrix = _SAME, turns: Matrix = _SAME) -> Correction:
    """Translations and rotations in another frame, by ``(3, 3)`` matrices."""

    def actions(chunk: Array, _: PolicySpec) -> Array:
        chunk[:, :3] = chunk[:, :3] @ np.transpose(moves)
        chunk[:, 3:6] = chunk[:, 3:6] @ np.transpose(turns)
        return chunk

    advice = "give moves and turns in the frame of the robot's base"
    return Correction(fault=fault, advice=advice, actions=actions)


def _scaled(factor: float) -> Correction:

    def actions(chunk: Array, _: PolicySpec) -> Array:
        chunk[:, :3] *= factor
        return chunk

    scale = f"{factor:g} times" if factor > 1 else f"1/{1 / factor:g} of"
    advice = f"make position_scale about {scale} its present value"
    return Correction(fault="its moves have the wrong length", advice=advice, actions=actions)


def _late(number: int) -> Correction:
    steps = f"{number} step{'s' * (number > 1)}"
    return Correction(
        fault=f"its chunks begin {steps} too early",
        advice=f"begin chunks with the action for the current step: the first {steps} are in the past",
        actions=lambda chunk, _: chunk[number:] if len(chunk) > number else chunk,
    )


def _grip(chunk: Array, spec: PolicySpec) -> Array:
    chunk[:, 6] = (1.0 if spec.action.gripper.endswith("01") else 0.0) - chunk[:, 6]
    return chunk


_QUARTER = ((0, -1, 0), (1, 0, 0), (0, 0, 1))
_BACK = ((0, 1, 0), (-1, 0, 0), (0, 0, 1))
_HALF = ((-1, 0, 0), (0, -1, 0), (0, 0, 1))
_ACTIONS = (
    _axes("x and y of its moves are swapped", ((0, 1, 0), (1, 0, 0), (0, 0, 1))),
    _axes("x of its moves has the wrong sign", ((-1, 0, 0), (0, 1, 0), (0, 0, 1))),
    _axes("y of its moves has the wrong sign", ((1, 0, 0), (0, -1, 0), (0, 0, 1))),
    _axes("z of its moves has the wrong sign", ((1, 0, 0), (0, 1, 0), (0, 0, -1))),
    _axes("its frame is turned by a quarter about z", _QUARTER, _QUARTER),
    _axes("its frame is turned by a quarter about z", _BACK, _BACK),
    _axes("its frame is turned by half about z", _HALF, _HALF),
    replace(
        _axes("its yaw has the wrong sign", turns=((1, 0, 0), (0, 1, 0), (0, 0, -1))),
        advice="turn it the other way: a negative rotation_scale, if the other turns are wrong, too",
    ),
    Correction(
        fault="its gripper opens where it should close",
        advice="give the other convention of gripper=",
        actions=_grip,
    ),
)
_LENGTHS = tuple(_scaled(factor) for factor in (20, 5, 1 / 5, 1 / 20))
_PICTURES = (
    Correction(
        fault="it gets red and blue exchanged",
        advice="its model was trained on BGR pictures: exchange the channels before the model sees them",
        picture=lambda picture: picture[..., ::-1],
    ),
    Correction(
        fault="it gets its pictures upside down",
        advice="flip them before the model sees them",
        picture=lambda picture: picture[::-1],
    ),
    Correction(
        fault="it gets its pictures mirrored",
        advice="mirror them before the model sees them",
        picture=lambda picture: picture[:, ::-1],
    ),
    Correction(
        fault="it gets its pictures turned by half",
        advice="turn them by 180 degrees before the model sees them, as LIBERO requires",
        picture=lambda picture: picture[::-1, ::-1],
    ),
)


Roll = Callable[[Scene, Correction | None], Outcome]


@dataclass(kw_only=True)
class Trial:
    """One correction in further scenes: progress with it against progress without it.

    The test is valid at any stopping time, see ``regression.e_process``.
    """

    pairs: int = 0
    better: int = 0
    worse: int = 0
    without: float = 0.0
    corrected: float = 0.0

    def see(self, without: Outcome, corrected: Outcome) -> None:
        """Add a scene; it does not count if a rollout was invalid or broke."""
        if min(without.verdict, corrected.verdict) < Verdict.PASSED:
            return
        gain = corrected.progress - without.progress
        self.pairs += 1
        self.better += gain > CLEARLY
        self.worse += gain < -CLEARLY
        self.without += without.progress
        self.corrected += corrected.progress

    def helps(self, more: int = 0) -> bool:
        """Whether the correction significantly helps, or would after ``more`` successes in a row."""
        return wealth(self.better + more, self.worse) >= 1 / ALPHA


def check_wiring(
    outcomes: Sequence[tuple[Scene, Outcome]],
    fresh: Iterable[Scene],
    candidates: Sequence[Correction],
    roll: Roll,
) -> Check:
    """Try all corrections where the policy failed, then the best of them in similar scenes.

    ``outcomes``: of nominal scenes, without a correction. ``fresh``: further nominal scenes.
    """
    failed = [(scene, outcome) for scene, outcome in outcomes if outcome.verdict is Verdict.FAILED][:SCREENED]
    if not failed:
        return Check("wiring", "it succeeds as it is: nothing to correct", "ok")

    best, gain = _best(failed, candidates, roll)
    if gain > CLEARLY:
        trial = _try(best, _alike([scene for scene, _ in failed], fresh), roll)
        if trial.helps() and _keeps(best, outcomes, roll):
            before, after = trial.without / trial.pairs, trial.corrected / trial.pairs
            rise = f"raises its progress from {before:.2f} to {after:.2f}"
            detail = f"{best.fault}: correcting this {rise} in {trial.pairs} scenes like those that failed"
            return Check("wiring", detail, "refuse", f"miswired: {best.advice}")
    return Check("wiring", f"none of {len(candidates)} corrections clearly raises its progress", "ok")


def _best(
    failed: Sequence[tuple[Scene, Outcome]], candidates: Sequence[Correction], roll: Roll
) -> tuple[Correction, float]:
    """The correction with the largest minimal gain; the search stops when all scenes pass with one."""
    gains: dict[Correction, float] = {}
    for correction in candidates:
        gains[correction], passed = 1.0, 0
        for scene, before in failed:
            corrected = roll(scene, correction)
            passed += corrected.verdict is Verdict.PASSED
            gains[correction] = min(gains[correction], corrected.progress - before.progress)
            if gains[correction] <= CLEARLY:
                break
        if passed == len(failed):
            break
    best = max(gains, key=gains.__getitem__)
    return best, gains[best]


def _keeps(correction: Correction, outcomes: Sequence[tuple[Scene, Outcome]], roll: Roll) -> bool:
    """Whether at least half of the scenes solved without the correction are solved with it."""
    solved = [scene for scene, outcome in outcomes if outcome.verdict is Verdict.PASSED][:KEPT]
    return 2 * sum(roll(scene, correction).verdict is Verdict.PASSED for scene in solved) >= len(solved)


def _alike(failed: Sequence[Scene], fresh: Iterable[Scene]) -> Iterator[Scene]:
    """Scenes with the same objects and orientations in fresh places: a fault may affect few objects only."""
    for scene, other in zip(cycle(failed), fresh, strict=False):
        pairs = zip(scene.targets, other.targets, strict=True)
        yield replace(scene, targets=tuple(replace(target, x=place.x, y=place.y) for target, place in pairs))


def _try(correction: Correction, scenes: Iterable[Scene], roll: Roll) -> Trial:
    """Roll out scenes until the correction significantly helps, or cannot within ``MOST`` scenes."""
    trial = Trial()
    for number, scene in enumerate(scenes):
        if trial.helps() or not trial.helps(MOST - number):
            break
        trial.see(roll(scene, None), roll(scene, correction))
    return trial
