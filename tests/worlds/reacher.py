"""A world outside the package, written from its page: a two-joint arm that reaches for a ball in a plane."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, hypot, sin
from typing import Any

import numpy as np

from vlafuzz.model import Stage
from vlafuzz.policies.base import ActionChunk, ActionSpec, CameraRequest, EpisodeStart, Observation, PolicySpec
from vlafuzz.worlds.values import Parameter, Value, ValuesWorld

LINKS = (0.5, 0.4)  # metres


@dataclass(frozen=True)
class Arm:
    """Joint angles, and what the scene gives: the ball, the motors, a reading that is off, and a glove."""

    joints: tuple[float, float]
    ball: tuple[float, float]
    strength: float
    bias: float
    glove: str

    @property
    def hand(self) -> tuple[float, float]:
        first, second = self.joints[0], sum(self.joints)
        return (LINKS[0] * cos(first) + LINKS[1] * cos(second), LINKS[0] * sin(first) + LINKS[1] * sin(second))

    @property
    def gap(self) -> float:
        return hypot(self.hand[0] - self.ball[0], self.hand[1] - self.ball[1])


class Reacher(ValuesWorld[Arm]):
    """The hand has to touch the ball, after it has come near."""

    tasks = ("reach",)
    parameters = (
        Parameter("ball-x", -0.7, 0.7, nominal=0.4, step=0.02, says="where the ball is"),
        Parameter("ball-y", 0.1, 0.7, nominal=0.4, step=0.02, says="where the ball is"),
        Parameter("strength", 0.2, 2.0, nominal=1.0, step=0.05, says="how strong the motors are"),
        Parameter("bias", -0.3, 0.3, nominal=0.0, step=0.01, says="how far the angles are misread"),
        Parameter("glove", options=("none", "wool", "steel"), says="what the hand wears"),
    )
    stages = (
        Stage("near", lambda arm: arm.gap < 0.2, lambda arm: max(0.0, 1 - arm.gap)),
        Stage("touch", lambda arm: arm.gap < 0.05, lambda arm: max(0.0, 1 - arm.gap / 0.2)),
    )
    horizon = 60

    def reset(self, values: Mapping[str, Value], seed: int) -> Arm:
        ball = float(values["ball-x"]), float(values["ball-y"])
        glove = str(values["glove"])
        return Arm((0.3, 1.0), ball, float(values["strength"]), float(values["bias"]), glove)

    def step(self, state: Arm, action: np.ndarray) -> Arm:
        turned = np.clip(action[:2], -0.2, 0.2) * state.strength
        return replace(state, joints=(state.joints[0] + turned[0], state.joints[1] + turned[1]))

    def observe(self, state: Arm) -> np.ndarray:
        weight = {"none": 0.0, "wool": 0.1, "steel": 1.0}[state.glove]
        return np.array([state.joints[0] + state.bias, state.joints[1], *state.ball, weight])

    def unfair(self, values: Mapping[str, Value]) -> str | None:
        far = hypot(float(values["ball-x"]), float(values["ball-y"]))
        return None if 0.2 <= far <= 0.85 else f"the ball is {far:.2f} m away, out of reach"

    def picture(self, state: Arm) -> np.ndarray:
        drawn = np.zeros((32, 32, 3), np.uint8)
        for place, colour in ((state.hand, 0), (state.ball, 1)):
            column, row = (int(16 + 15 * part) for part in place)
            drawn[31 - row, column, colour] = 255
        return drawn

    def expert(self) -> "Downhill":
        return Downhill(sees_all=True, width=self.action_width)


class Narrow(Reacher):
    """The same by as many numbers as the arm has joints."""

    action_width = 2


class Downhill:
    """Turns both joints so that the hand comes nearer; the policy believes what it reads, and fears steel."""

    attempt = 0

    def __init__(self, *, sees_all: bool = False, width: int = 7) -> None:
        self._sees_all, action = sees_all, ActionSpec(width=width)
        name = "expert" if sees_all else "downhill"
        self.spec = PolicySpec(name, action=action, state=True, privileged=sees_all)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None: ...

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(self._answer(seen)[None]) for seen in observations]

    def close(self) -> None: ...

    def _answer(self, seen: Observation) -> np.ndarray:
        answer, state = np.zeros(self.spec.action.width), seen.privileged
        assert seen.state is not None
        first, second, x, y, weight = (float(number) for number in seen.state)
        if self._sees_all:
            first, gain = state.joints[0], 1 / state.strength
        else:
            gain = 0.0 if weight > 0.5 else 1.0
        arm = Arm((first, second), (x, y), 1.0, 0.0, "none")
        moved = [replace(arm, joints=at) for at in ((first + 0.01, second), (first, second + 0.01))]
        slope = [arm.gap - one.gap for one in moved]
        answer[:2] = np.array(slope) * 12 * gain * min(1.0, 4 * arm.gap)
        return answer


def downhill() -> Any:
    return Downhill()


def narrow() -> Any:
    return Downhill(width=2)


class Watching(Downhill):
    """Turns by what it sees of hand and ball."""

    def __init__(self) -> None:
        super().__init__()
        self.spec = PolicySpec("watching", cameras=(CameraRequest("eye", 32, 32),))

    def _answer(self, seen: Observation) -> np.ndarray:
        red, green, _ = np.moveaxis(seen.images["eye"].astype(float), -1, 0)
        across = [float(np.argmax(layer.max(axis=0)) - 16) / 100 for layer in (red, green)]
        return np.array([across[1] - across[0], across[1], 0, 0, 0, 0, 1.0])


def watching() -> Any:
    return Watching()
