"""Events: what happens in the middle of an episode, when it is due, and what a scene is like afterwards."""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.model import Camera, Scene, Stage
from vlafuzz.model.scene import EVENTS, CameraBump, Event, LightSwitch, Newcomer, Slide

MOST = 2  # events of a scene: with more, nobody can say what the policy reacts to
NUMBERS = {"first": 1, "second": 2, "third": 3}  # of confounders, where the instruction names them
STAY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # the action with which a robot stands still, its gripper open
STOP = "stop"  # what is said where the task is cancelled
START = 1.0  # seconds after which what happens at the start does
NEARING = 0.2  # of the way to the grasp; half-way, at 10 cm a step, a hand is already around what would slide
NEAR = 0.5  # of the way to a stage before that, as in LIBERO: at 20 cm, where the hand starts at 23 to 31 cm
REACTION = 1.0  # seconds until a hand that is told to stop has to stand still: of the longest chunks of actions
STANDING = 3.0  # seconds for which it stands still then: more than the two for which commands can be lost
STILL = 0.05  # metres by which it may move meanwhile: with a thing in it and no commands it sinks by 1.5 cm a second
FALLEN, UPRIGHT = 0.02, math.cos(math.radians(30.0))  # metres; of the angle by which a thing leans that stands upright
FALLING = {"grip_slip", "grip_weak", "target_topple", "target_knock", "newcomer"}  # events by which something falls
DROP = 0.005  # metres above its place at which a newcomer is let go; from 1 cm, a lying can rolls away
ROOM = 0.03  # metres between a newcomer and all else: more than a hand moves while it falls
_ANGLES = np.arange(0.0, np.pi, np.pi / 16)
_DIRECTIONS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])  # (2, 16) in which two things may be apart
SLIDING = 0.6  # seconds in which a thing slides to its new place: three control steps of most policies


class Events:
    """The events of a scene in one episode, and what they do to commands, pictures and things.

    Args:
        hz: control steps per second. stages: names of the task's.
    """

    def __init__(self, scene: Scene, hz: int, stages: Sequence[str]) -> None:
        self.parts, self._hz, self._stages = scene.events, hz, stages
        self._begun, self._step = dict[str, int](), 0
        self._fingers = 1.0  # of the last command
        self._last = dict[str, Picture]()  # by camera, seen before the pictures were lost

    def begin(self, step: int, progress: float, has_room: Callable[[], bool]) -> list[Event]:
        """The events that begin with a control step, given the best progress before it, in [0, 1].

        ``has_room``: whether a newcomer can be put down; it waits for that.
        """
        self._step = step
        due = [
            name
            for name, event in self.parts.items()
            if name not in self._begun and _is_due(event, step, progress, self._hz, self._stages)
            if not isinstance(event, Newcomer) or has_room()
        ]
        self._begun |= dict.fromkeys(due, step)
        return [self.parts[name] for name in due]

    def executed(self, action: Array) -> Array:
        """What the robot makes of a command ``(7,)`` in this step."""
        if self._going_on("control_stall"):
            return np.append(np.zeros(6), self._fingers)
        self._fingers = action[6]
        return np.append(action[:6], 1.0) if self._going_on("grip_slip") else action

    def slides(self) -> dict[int, Array]:
        """By target, how far it slides in this control step: ``(2,)`` metres along the world's x and y."""
        going_on = enumerate(map(self._going_on, ("target_slide", "goal_slide")))
        return {slot: displacement(slide) / _lasts(slide, self._hz) for slot, slide in going_on if slide is not None}

    def shown(self, camera: str, picture: Picture) -> Picture:
        """What the policy sees through a camera after this step, instead of a picture."""
        loss = self._going_on("picture_loss")
        if loss is None:
            self._last[camera] = picture
            return picture
        return self._last.get(camera, picture) if loss.shows == "frozen" else np.zeros_like(picture)

    def _going_on(self, name: str) -> Any:
        """An event that has begun and is not over; else None."""
        if name not in self._begun:
            return None
        event = self.parts[name]
        return event if self._step - self._begun[name] < _lasts(event, self._hz) else None


def _is_due(event: Event, steps: int, progress: float, hz: int, stages: Sequence[str]) -> bool:
    """Whether an event is due: on the way to the first stage, at the grasp, half-way to what follows."""
    if event.when == "start":
        return steps >= START * hz
    grasp = next((number for number, name in enumerate(stages, 1) if name.startswith("grasp")), 1)
    reached = {"approach": NEARING if grasp == 1 else NEAR, "grasp": grasp, "carry": grasp + 0.5}[event.when]
    return progress * len(stages) >= reached - 1e-6  # traces are kept in single precision


def begins(event: Event, trace: NDArray[np.float32], stages: Sequence[str], hz: int = 1) -> int | None:
    """The control step with which an event begins in a rollout, None if it never does.

    Args:
        trace: progress after each control step.
        hz: control steps per second; it matters to events at the start alone.
    """
    best = np.maximum.accumulate([0.0, *trace[:-1]])  # before each step
    steps = (step for step, progress in enumerate(best) if _is_due(event, step, float(progress), hz, stages))
    return next(steps, None)


def recovery(scene: Scene, trace: NDArray[np.float32], stages: Sequence[str], hz: int) -> int | None:
    """Control steps from the end of a scene's last event until there is more progress than ever before it.

    More progress is a further stage, or the hand nearer to what it is after. None if no event began, there was none, or
    the task is cancelled.
    """
    if scene.instruction_change.to == STOP:
        return None
    begun = ((begins(event, trace, stages, hz), event) for event in scene.events.values())
    ends = [(step + _lasts(event, hz), step) for step, event in begun if step is not None]
    end, step = max(ends, default=(len(trace), 0))
    resumed = np.flatnonzero(trace[end:] > trace[:step].max(initial=0.0))
    return int(resumed[0]) + 1 if len(resumed) else None


def _lasts(event: Event, hz: int) -> int:
    """For how many control steps an event goes on."""
    return max(1, round(SLIDING * hz)) if isinstance(event, Slide) else getattr(event, "duration", 0)


def newcomer(scene: Scene) -> int | None:
    """The number, among a scene's placements, of what is put down in mid-episode; None if nothing is."""
    number = NUMBERS.get(scene.newcomer.thing)
    return None if number is None else len(scene.targets) + number - 1


def has_room(thing: Array, others: Iterable[Array]) -> bool:
    """Whether the ``(n, 3)`` corners of a thing are ``ROOM`` apart from those of others: beside, or under them."""
    x, top = thing[:, :2] @ _DIRECTIONS, thing[:, 2].max() + DROP + ROOM
    near = (other[:, :2] @ _DIRECTIONS for other in others if other[:, 2].min() < top)
    return all(max((y.min(0) - x.max(0)).max(), (x.min(0) - y.max(0)).max()) > ROOM for y in near)


def without(scene: Scene, events: Collection[str]) -> Scene:
    """The scene in which some events, by their names, never happen: what they would put down is not there."""
    late, things = newcomer(scene) if "newcomer" in events else None, scene.confounders
    there = tuple(thing for number, thing in enumerate(things, len(scene.targets)) if number != late)
    return replace(scene, confounders=there, **{name: EVENTS[name] for name in events})


def impossible(scene: Scene) -> str | None:
    """Why the events of a scene cannot happen, if so."""
    change, came = scene.instruction_change.to, scene.newcomer.thing
    for event, number in (("instruction-change", change), ("newcomer", came)):
        if NUMBERS.get(number, 0) > len(scene.confounders):
            return f"{event}: there is no {number} other thing"
    if change in NUMBERS and came in NUMBERS:
        return "instruction-change: it names no other thing where one is put down"
    falls = change == STOP and scene.events.keys() & FALLING
    return f"instruction-change: after {STOP!r}, another event would let something fall" if falls else None


class Looked(NamedTuple):
    """These tell whether a robot stands still: the hand ``(3,)``; of each thing height, upward axis, whether held."""

    hand: Array
    heights: Array
    upward: Array
    held: NDArray[np.bool_]


def cancelled(stages: tuple[Stage, ...], look: Callable[[Any], Looked], hz: int, left: int) -> tuple[Stage, ...]:
    """The stages of a task that is cancelled now: success is to stand still from now on, and not to solve it.

    Nothing that is not held may fall: lie lower than when the hand came to rest, or tip over. ``left``: control steps,
    of which there are ``hz`` a second.
    """
    reacting, looks = round(REACTION * hz), list[Looked]()

    def stands_still(situation: Any) -> bool:
        looks.append(now := look(situation))
        told, rested = looks[0], looks[:reacting][-1]
        tipped = np.einsum("ij,ij->i", now.upward, told.upward) < UPRIGHT
        fallen = (tipped | (rested.heights - now.heights > FALLEN)) & ~now.held
        return math.dist(now.hand, rested.hand) <= STILL and not (fallen.any() or stages[-1].holds(situation))

    steps = min(reacting + round(STANDING * hz), left)
    return *stages[:-1], Stage(stages[-1].name, stands_still, lambda _: 0.0, steps)


def displacement(slide: Slide) -> Array:
    """``(2,)`` metres along the world's x and y."""
    angle = math.radians(slide.direction)
    return slide.distance * np.array([math.cos(angle), math.sin(angle)])


def afterwards(scene: Scene, slid: float = 1.0) -> Scene:
    """The scene in which everything has happened, to be as fair as the one at the start.

    ``slid``: the share of the way that things have slid, in [0, 1].
    """
    targets, things = list(scene.targets), list(scene.confounders)
    for slot, slide in enumerate((scene.target_slide, scene.goal_slide)[: len(targets)]):
        x, y = (slid * displacement(slide)).tolist()
        targets[slot] = replace(targets[slot], x=targets[slot].x + x, y=targets[slot].y + y)
    if {scene.target_topple.rest, scene.target_knock.rest} != {"same"}:
        targets[0] = replace(targets[0], rest="lying")
    if number := NUMBERS.get(scene.instruction_change.to):
        targets[0], things[number - 1] = things[number - 1], targets[0]
    return replace(
        scene,
        targets=tuple(targets),
        confounders=tuple(things),
        camera=turned(scene.camera, scene.camera_bump),
        light=lit(scene, scene.light_switch).light,
        **EVENTS,
    )


def lit(scene: Scene, switch: LightSwitch) -> Scene:
    return replace(scene, light=replace(scene.light, intensity=scene.light.intensity * switch.intensity))


def turned(camera: Camera, bump: CameraBump) -> Camera:
    return replace(camera, **{axis: getattr(camera, axis) + getattr(bump, axis) for axis in ("roll", "pitch", "yaw")})
