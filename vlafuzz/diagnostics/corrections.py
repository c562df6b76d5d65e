"""Corrections: what may be wrong between a policy and the robot, each with what would put it right."""

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


@dataclass(frozen=True)
class Correction:
    """One thing that is put right on the way to the policy or from it.

    Attributes:
        fault: what is wrong if this helps, in a sentence's end.
        advice: what the user does about it.
        actions: of a chunk, ``(steps, 7)`` in the units of the spec.
    """

    fault: str
    advice: str
    actions: Callable[[Array, PolicySpec], Array] | None = None
    picture: Callable[[Picture], Picture] | None = None


class Corrected(Lent):
    """A policy with a correction that can be exchanged; None for as it is."""

    correction: Correction | None = None

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        """See ``Policy``."""
        correction = self.correction
        if correction is None:
            return super().act(observations)
        if correction.picture is not None:
            observations = [_pictured(seen, correction.picture) for seen in observations]
        chunks = super().act(observations)
        if correction.actions is None:
            return chunks
        return [ActionChunk(correction.actions(np.array(each.actions), self.spec)) for each in chunks]


def corrections(spec: PolicySpec, longest: int) -> list[Correction]:
    """Those that make sense for a policy whose longest chunk has so many actions.

    Lengths come last: shorter moves make up for much that is wrong, late actions above all.
    """
    late = (_late(number) for number in range(1, min(longest, 3)))
    return [*_ACTIONS, *late, *(_PICTURES if spec.cameras else ()), *_LENGTHS]


def _pictured(seen: Observation, change: Callable[[Picture], Picture]) -> Observation:
    images = {name: np.ascontiguousarray(change(picture)) for name, picture in seen.images.items()}
    return replace(seen, images=images)


def _axes(fault: str, moves: Matrix = _SAME, turns: Matrix = _SAME) -> Correction:
    """Moves and turns along other axes: ``(3, 3)`` each."""

    def actions(chunk: Array, _: PolicySpec) -> Array:
        chunk[:, :3] = chunk[:, :3] @ np.transpose(moves)
        chunk[:, 3:6] = chunk[:, 3:6] @ np.transpose(turns)
        return chunk

    return Correction(fault, "give moves and turns in the frame of the robot's base", actions)


def _scaled(factor: float) -> Correction:
    """Moves of another length."""

    def actions(chunk: Array, _: PolicySpec) -> Array:
        chunk[:, :3] *= factor
        return chunk

    scale = f"{factor:g} times" if factor > 1 else f"1/{1 / factor:g} of"
    return Correction(
        "its moves have the wrong length", f"make position_scale {scale} what it is, or near that", actions
    )


def _late(number: int) -> Correction:
    """Without the first actions of each chunk."""
    steps = f"{number} step{'s' * (number > 1)}"
    return Correction(
        f"its chunks begin {steps} too early",
        f"answer with what is to be done now: the first {steps} of each chunk are of before",
        lambda chunk, _: chunk[number:] if len(chunk) > number else chunk,
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
        advice="turn it the other way: a negative rotation_scale, where the other turns are wrong, too",
    ),
    Correction("its gripper opens where it should close", "give the other convention of gripper=", _grip),
)
_LENGTHS = tuple(_scaled(factor) for factor in (20, 5, 1 / 5, 1 / 20))
_PICTURES = (
    Correction(
        "it gets red and blue exchanged",
        "its model was trained on BGR pictures: exchange the channels before it sees them",
        picture=lambda picture: picture[..., ::-1],
    ),
    Correction(
        "it gets its pictures upside down",
        "turn them over before the model sees them",
        picture=lambda picture: picture[::-1],
    ),
    Correction(
        "it gets its pictures mirrored",
        "mirror them before the model sees them",
        picture=lambda picture: picture[:, ::-1],
    ),
    Correction(
        "it gets its pictures turned by half",
        "turn them by 180 degrees before the model sees them, as LIBERO's have to be",
        picture=lambda picture: picture[::-1, ::-1],
    ),
)
