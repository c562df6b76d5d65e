"""Room: a robot at a table with one scene at a time, whatever simulates and draws it.

It has the camera, light, noise, late commands, events and stages of a rollout, and compares what the simulator contains
with the scene. Here are also the numbers of physics that simulators have in common.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import astuple, replace
from typing import Any

import numpy as np

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.errors import SimulatorError
from vlafuzz.model import Placement, Scene, scene as kinds
from vlafuzz.model.scene import EVENTS, EXTRAS, Event, Exposure, Start
from vlafuzz.worlds.episode import DelayedCommands, SensorNoise
from vlafuzz.worlds.events import DROP, NUMBERS, STOP, Events, afterwards, cancelled, has_room, lit, newcomer, turned
from vlafuzz.worlds.manipulation.arms import hand_boxes
from vlafuzz.worlds.manipulation.camera import camera_pose, exposed
from vlafuzz.worlds.manipulation.looks import PAINTS
from vlafuzz.worlds.manipulation.rigs import rig
from vlafuzz.worlds.sight import CameraPose
from vlafuzz.worlds.tabletop.fairness.footprint import solid
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, models_of
from vlafuzz.worlds.tabletop.tasks import (
    AWAY,
    State,
    StateMonitor,
    corners,
    looked_at,
    say,
    task as task_named,
    wordings_of,
)

# In the hand's frame: in front of the palm, 5 cm off its middle, looking along the fingers.
WRIST_CAMERA = ((0.05, 0.0, 0.03), (0.0, 0.5**0.5, 0.0, 0.5**0.5))
FRICTION = 0.6  # of the table
# PhysX has no rolling friction, and a polygonal can even accelerates: pushed at 0.1 m/s it rolls forever with
# a damping of 0.5 1/s, sometimes with 2, and stops within 5 cm with 5.
DAMPING, ROLLING_DAMPING = 0.5, 5.0
GRASP_FORCE = 0.5  # newtons per finger, as in ManiSkill's is_grasping
GRASP_COSINE = math.cos(math.radians(85.0))
METRES = 1e-5
TURN = 1e-4  # of a quaternion's components


class Room(ABC):
    """A robot at a table with one scene at a time.

    Attributes:
        models: of the scene's objects; ``instruction``, ``view``, ``light`` and ``monitor`` are those of the moment.
        table_colour: mean colour of the table top.
        world: the simulated robot, table and objects: PhysX's ``World`` in ``sim``, or what has the same methods.
    """

    world: Any

    def __init__(self, task: str, catalogue: Catalogue, robot: str, control_hz: int) -> None:
        self.task, self.rig, self.catalogue = task_named(task), rig(robot), catalogue
        self.control_hz = self.rig.control_hz or control_hz

    @abstractmethod
    def build(self, scene: Scene) -> State:
        """Simulate a scene from its start on, and show it as ``view`` and ``light`` say; the state at its start."""

    @abstractmethod
    def aim(self) -> None:
        """Turn the third-person cameras to ``view``."""

    @abstractmethod
    def relight(self) -> None:
        """Light the scene as ``light`` says."""

    @abstractmethod
    def measured(self) -> tuple[float, Any, kinds.Backdrop]:
        """Light, camera pose, and what table and wall are painted with, read back from what draws the pictures."""

    @abstractmethod
    def camera(self, view: CameraPose) -> Any:
        """The pose as the simulator has it: ``p`` (3,) in metres, and a quaternion ``q`` w, x, y, z."""

    @abstractmethod
    def picture(self, camera: str) -> Picture:
        """``(height, width, 3)``: what a camera shows at present."""

    @abstractmethod
    def close(self) -> None:
        """Release simulator and renderer."""

    def begin(self, scene: Scene, seed: int = 0) -> State:
        """Build a scene for a rollout with this seed; the state at its start."""
        self.models = models_of(scene.placements, self.catalogue)
        self._scene, self.instruction = scene, scene.instruction
        self.view = camera_pose(self.rig.view, scene.camera)
        shown = exposed(scene)
        self.light, self.table_colour = shown.light.intensity, PAINTS[scene.backdrop.colour]
        start, self._late = self.build(scene), newcomer(scene)
        if self._late is not None:
            self._put(self._late, scene.placements[self._late], AWAY, floats=True)
            start = self.world.read()
        self._state = start
        self._step, self._noise = 0, SensorNoise(shown.noise, seed)
        self._commands = DelayedCommands(scene.latency)
        self.monitor = StateMonitor(self.task, self.models, start)
        self._events = Events(scene, self.control_hz, self.task.stage_names)
        return start

    def advance(self, action: Array, relative_to: str = "target") -> State:
        """Execute a metric action for one control step (see ``MetricArm``); the state after it."""
        events, slides = self._events, None
        if events.parts:
            for event in events.begin(self._step, self.monitor.progress, self._has_room):
                self._happen(event)
            slides = events.slides()
        command, relative_to = self._commands.exchange(action, relative_to)
        self._state = self.world.step(events.executed(command), relative_to, slides)
        self.monitor.observe(self._state)
        self._step += 1
        return self._state

    def _put(self, number: int, placed: Placement, up: float = 0.0, *, floats: bool = False) -> None:
        (model,) = models_of([placed], self.catalogue)
        self.world.put(number, self.world.place(model, placed), up, floats=floats)

    def _has_room(self) -> bool:
        """Whether what is still to be put down has room where it belongs, beside things and hand."""
        assert self._late is not None
        state, late = self._state, self._scene.placements[self._late]
        others = [corners(self.models[index], state, index) for index in state.there]
        hand = hand_boxes(state.tcp, state.tcp_rotation, state.opening)
        return has_room(solid(late, self.catalogue[late.object]), [*others, *hand])

    def _happen(self, event: Event) -> None:
        """What begins with an event, and stays."""
        if isinstance(event, kinds.CameraBump):
            self.view = camera_pose(self.rig.view, turned(self._scene.camera, event))
            self.aim()
        elif isinstance(event, kinds.LightSwitch):
            self.light = exposed(lit(self._scene, event)).light.intensity
            self.relight()
        elif isinstance(event, kinds.TargetTopple):
            self._put(0, replace(self._scene.targets[0], rest=event.rest))
        elif isinstance(event, kinds.Newcomer) and self._late is not None:
            self._put(self._late, self._scene.placements[self._late], DROP)
        elif isinstance(event, kinds.GripWeak):
            self.world.grip(event.force)
        elif isinstance(event, kinds.InstructionChange) and event.to == STOP:
            self.instruction, left = STOP, self.rig.seconds * self.control_hz - self._step
            self.monitor.cancel(cancelled(self.task.stages, looked_at, self.control_hz, left))
        elif isinstance(event, kinds.InstructionChange):
            self.models = models_of(afterwards(self._scene).placements, self.catalogue)
            self.instruction = say(wordings_of(self.task.name)[0], [model.spoken for model in self.models])
            start = self.world.exchange(self.task.targets - 1 + NUMBERS[event.to])
            self.monitor.about(self.models, start)

    def seen(self, camera: str) -> Picture:
        """``(height, width, 3)``: what a policy sees through a camera at present."""
        shown = self._noise.degraded(self.picture(camera), self._step, camera)
        return self._events.shown(camera, shown) if self._events.parts else shown

    def check(self, scene: Scene) -> None:
        """Read the simulator back before the first step; a SimulatorError if it does not contain this scene."""
        names, built = [thing.object for thing in scene.placements], [model.name for model in self.models]
        if names != built:
            _fail("objects", names, built)
        models = models_of(scene.placements, self.catalogue)
        for number, (model, placement, pose) in enumerate(zip(models, scene.placements, self.world.poses, strict=True)):
            up = AWAY if number == newcomer(scene) else 0.0
            _check_pose(placement.object, self.world.place(model, placement), pose, up)
        light, camera, backdrop = self.measured()
        scene = exposed(scene)
        if abs(light - scene.light.intensity) > 1e-4 * scene.light.intensity:
            _fail("light", scene.light.intensity, light)
        _check_pose("camera", self.camera(camera_pose(self.rig.view, scene.camera)), camera)
        in_effect = {
            "backdrop": backdrop,
            "initial_pose": self.world.initial_pose,
            "noise": self._noise.noise,
            "latency": self._commands.latency,
            "start": Start(),  # there is only one
            "exposure": Exposure(),  # light and noise have it
            **EVENTS,
            **self._events.parts,
        }
        for part in EXTRAS:
            expected = getattr(scene, part)
            if part not in in_effect or not _alike(expected, in_effect[part]):
                _fail(part.replace("_", " "), expected, in_effect.get(part))


def _alike(expected: Any, actual: Any) -> bool:
    """Whether two parts of scenes are equal up to the simulator's single precision."""
    return all(
        one == other if isinstance(one, str) else math.isclose(one, other, rel_tol=1e-5, abs_tol=1e-4)
        for one, other in zip(astuple(expected), astuple(actual), strict=True)
    )


def _check_pose(name: str, expected: Any, actual: Any, up: float = 0.0) -> None:
    distance = float(np.abs(expected.p + np.array([0.0, 0.0, up]) - actual.p).max())
    turn = float(min(np.abs(expected.q - actual.q).max(), np.abs(expected.q + actual.q).max()))
    if not (distance <= METRES and turn <= TURN):
        _fail(f"pose of {name}", expected, actual)


def _fail(part: str, expected: object, actual: object) -> None:
    raise SimulatorError(f"{part}: asked for {expected}, the simulator has {actual}", hint="this is a bug in vlafuzz")
