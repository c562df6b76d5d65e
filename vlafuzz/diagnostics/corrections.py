"""Corrections: possible faults between a policy and the robot, with transformations that undo them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vlafuzz.diagnostics.recorder import Lent
from vlafuzz.policies.base import ActionChunk, Observation, PolicySpec

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Matrix = Sequence[Sequence[int]]
_SAME = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


@dataclass(frozen=True, kw_only=True)
class Correction:
    """A transformation of pictures on their way to the policy, or of actions on their way back.

    Attributes:
        fault: what is wrong if the correction helps.
        advice: what the user should change.
        actions: transforms a chunk ``(steps, 7)`` in the units of the spec.
        picture: transforms one picture.
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
