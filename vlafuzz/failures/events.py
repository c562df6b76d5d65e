"""What events in mid-episode have to do with failures: whether they had begun when the policy failed."""

from dataclasses import replace

from vlafuzz.common.text import plural
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import EVENTS, Scene
from vlafuzz.worlds import world_of
from vlafuzz.worlds.events import begins


def came_about(scene: Scene, outcome: Outcome) -> Scene:
    """A scene that failed, without the events that had begun in none of its failing rollouts; else the scene itself."""
    if outcome.verdict is not Verdict.FAILED or not outcome.rollouts or not scene.events:
        return scene
    stages = world_of(scene.task).task(scene.task).stage_names
    failing = [rollout.trace for rollout in outcome.rollouts if not rollout.success_once]
    never = [name for name, one in scene.events.items() if all(begins(one, trace, stages) is None for trace in failing)]
    return replace(scene, **{name: EVENTS[name] for name in never}) if never else scene


def failed_before(scene: Scene, outcome: Outcome) -> bool:
    """Whether a scene has events, and the policy failed before any of them had begun."""
    return bool(scene.events) and not came_about(scene, outcome).events


def told(early: int) -> str:
    """How many failures came before their events, in words; empty for none."""
    return f"{plural(early, 'failure')} before any event had begun, which no event explains" if early else ""
