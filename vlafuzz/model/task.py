"""Task, Stage and Monitor: what the robot is to do, its milestones, and the progress of a rollout.

Stages and progress are pure functions of a situation; what that is depends on the world.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Stage:
    """A milestone, reached when ``holds`` has been true for ``steps`` consecutive control steps.

    ``nearness`` measures in [0, 1] how close a situation is to it.
    """

    name: str
    holds: Callable[[Any], bool]
    nearness: Callable[[Any], float]
    steps: int = 2


@dataclass(frozen=True)
class Task:
    """A task says what the robot is to do. ``targets``: how many objects it names; ``stages``: the last is success."""

    name: str
    targets: int
    stages: tuple[Stage, ...]

    @property
    def stage_names(self) -> tuple[str, ...]:
        return tuple(stage.name for stage in self.stages)


class Monitor:
    """Tracks ``stages``, as of a ``Task``, and progress of a rollout."""

    def __init__(self, stages: tuple[Stage, ...]) -> None:
        self.stages, self._trace = stages, list[float]()
        self._streaks, self.reached, self._open = [0] * len(stages), list[str](), list(range(len(stages)))

    def observe(self, situation: Any) -> None:
        """Take notice of the situation after a control step."""
        stages, streaks, last, progress = self.stages, self._streaks, len(self.stages) - 1, 1.0
        for index in self._open:
            holds = stages[index].holds  # a variable, since Python is slow to call what is in a slot
            streaks[index] = streak = streaks[index] + 1 if holds(situation) else 0
            if streak and streak >= stages[index].steps and index in (len(self.reached), last):
                self.reached = [stage.name for stage in stages[: index + 1]]
                self._open = list(range(min(index + 1, last), last + 1))  # success may be lost again
        if (done := len(self.reached)) <= last:
            nearness = stages[done].nearness
            near = nearness(situation)
            if streaks[done] or not 0.0 <= near <= 0.99:
                near = min(max(near, streaks[done] / stages[done].steps), 0.99)
            progress = (done + near) / len(stages)
        self._trace.append(float(progress))

    def cancel(self, stages: tuple[Stage, ...]) -> None:
        """Success is something else from now on; the other stages stay as they are."""
        self.stages, self._streaks[-1] = stages, 0

    def begin_anew(self) -> None:
        """The task is about something else from now on: no stage is reached. The progress so far remains on record."""
        self._streaks, self.reached, self._open = [0] * len(self.stages), [], list(range(len(self.stages)))

    @property
    def success_now(self) -> bool:
        """Whether success holds at the last step, and has for long enough."""
        return self._streaks[-1] >= self.stages[-1].steps

    @property
    def success_once(self) -> bool:
        """Whether success has been reached at any step."""
        return len(self.reached) == len(self.stages)

    @property
    def progress(self) -> float:
        """The best progress so far, in [0, 1]."""
        return max(self._trace, default=0.0)

    @property
    def trace(self) -> NDArray[np.float32]:
        """``(steps,)`` progress after each step."""
        return np.array(self._trace, dtype=np.float32)
