"""Events in mid-episode: whether they had begun when the policy failed, and how soon there is progress after them."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from math import inf, isfinite
from statistics import median_high

from vlafuzz.common.text import plural
from vlafuzz.model import Outcome, Scene
from vlafuzz.worlds import world_of
from vlafuzz.worlds.events import begins, without


def came_about(scene: Scene, outcome: Outcome) -> Scene:
    """A scene that failed, without the events that had begun in none of its failing rollouts; else the scene itself."""
    failing = [rollout.trace for rollout in outcome.rollouts if not rollout.success_once]
    if not (failing and scene.events):
        return scene
    stages = world_of(scene.task).task(scene.task).stage_names
    never = [name for name, one in scene.events.items() if all(begins(one, trace, stages) is None for trace in failing)]
    return without(scene, never) if never else scene


def failed_before(scene: Scene, outcome: Outcome) -> bool:
    """Whether a scene has events, and the policy failed before any of them had begun."""
    return bool(scene.events) and not came_about(scene, outcome).events


def told(early: int) -> str:
    """How many failures came before their events, in words; empty for none."""
    return f"{plural(early, 'failure')} before any event had begun, which no event explains" if early else ""


@dataclass(frozen=True)
class Recovery:
    """Control steps from the end of an event until progress resumes, see ``Rollout.recovery``.

    Attributes:
        policy: the median of ``rollouts`` in which the event had begun; None if there was no progress in one half.
        solution: of what solves the cause's scene; None if unknown.
    """

    policy: int | None
    rollouts: int
    solution: int | None = None

    def __str__(self) -> str:
        policy = "never" if self.policy is None else plural(self.policy, "step")
        solution = "" if self.solution is None else f"; its solution in {self.solution}"
        return f"{policy} (median of {plural(self.rollouts, 'rollout')}{solution})"


def recovery_of(
    trials: Iterable[tuple[Scene, Outcome]], events: Collection[str], solution: int | None
) -> Recovery | None:
    """How soon a policy recovers from some events, by the names of their fields; None where it met none."""
    took = list[float]()
    for scene, outcome in trials:
        if came_about(scene, outcome).events.keys() & events:
            # where an event began late in a success, no progress was left to make
            rollouts = (one for one in outcome.rollouts if one.recovery is not None or not one.success_once)
            took += (inf if one.recovery is None else one.recovery for one in rollouts)
    middle = median_high(took) if took else inf
    return Recovery(int(middle) if isfinite(middle) else None, len(took), solution) if took else None
