"""What runs scenes on the tabletop, whatever simulates them: a rollout, a policy's evaluator, outlines."""

from abc import abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import product
from typing import Unpack

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.model import Conditions, Rejection, Scene, Setting
from vlafuzz.policies.base import CameraRequest, Observation, Outlines, Policy, PolicySpec, Silhouette
from vlafuzz.worlds.episode import Episode
from vlafuzz.worlds.evaluator import Options, SceneEvaluator
from vlafuzz.worlds.events import afterwards, without
from vlafuzz.worlds.manipulation.arms import hand_boxes
from vlafuzz.worlds.manipulation.camera import area_alone, blank, paint
from vlafuzz.worlds.manipulation.looks import COLOUR
from vlafuzz.worlds.manipulation.operator_set import MIN_DISTANCE, stored_visible
from vlafuzz.worlds.manipulation.rigs import rig
from vlafuzz.worlds.sight import CameraPose, Sight
from vlafuzz.worlds.tabletop.experts.expert import Calibration, Privileged
from vlafuzz.worlds.tabletop.fairness import check_events, check_static
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.objects.hulls import triangles
from vlafuzz.worlds.tabletop.objects.model import SRGB, ObjectModel
from vlafuzz.worlds.tabletop.room import Room
from vlafuzz.worlds.tabletop.tasks import TABLE, State, task as task_named

# Quality of the pictures that a policy sees: ``full`` has shadows, and takes 33 instead of 4 ms at 224 pixels on a CPU
QUALITY = Setting("quality", "fast", ("fast", "full"), served="full")


class TabletopEpisode(Episode):
    """A rollout of a scene in an environment."""

    def __init__(self, env: Room, spec: PolicySpec, scene: Scene, seed: int, conditions: Conditions) -> None:
        self._env, self._spec = env, spec
        self._state = env.begin(scene, seed)
        env.check(scene)
        self.states_hash = env.world.states_hash
        horizon = env.rig.seconds * env.control_hz
        super().__init__(scene, seed, conditions, env.monitor, hz=env.control_hz, horizon=horizon)
        if spec.silhouettes:
            self.start = replace(self.start, catalogue=env.catalogue)

    def observe(self) -> Observation:
        env, spec, scene, state = self._env, self._spec, self.scene, self._state
        return Observation(
            episode=self.start.episode,
            step=len(self.actions),
            instruction=env.instruction,
            images={camera.name: env.seen(camera.name) for camera in spec.cameras},
            state=proprioception(state, env.rig.opening) if spec.state else None,
            outlines=outlines(env.models, state, env.view, env.light, env.table_colour) if spec.silhouettes else None,
            privileged=Privileged(scene, env.models, state, self.monitor.success_now) if spec.privileged else None,
            calibration=Calibration(env.view, env.light, env.models[: env.task.targets]) if spec.calibrated else None,
        )

    def picture(self, camera: str) -> Picture:
        return self._env.picture(camera)

    def sight(self) -> Sight:
        state, names = self._state, self._names
        bodies = {names[index]: (state.positions[index], state.rotations[index]) for index in state.there}
        table = self._env.rig.table
        bodies[TABLE] = np.array([*table.centre, -table.half[2]]), np.eye(3)
        touching = (
            f"{names[index]} touches {names[other] if isinstance(other, int) else other}"
            for index, other in state.contacts
            if isinstance(other, str) or index < other
        )
        return Sight(self._env.view, state.tcp, bodies, frozenset(touching))

    def shape(self, body: str) -> tuple[Array, Array]:
        if body == TABLE:
            corners = np.array(self._env.rig.table.half) * list(product((-1, 1), repeat=3))
            return corners[triangles(corners)], np.array(self._env.table_colour) ** (1 / SRGB)
        model = self._env.models[self._names.index(body)]
        return np.concatenate([part[triangles(part)] for part in model.parts]), model.colour

    @property
    def _names(self) -> list[str]:
        """The names of the things; several of one kind are numbered."""
        names = [model.name for model in self._env.models]
        return [f"{name} {same + 1}" if (same := names[:at].count(name)) else name for at, name in enumerate(names)]

    def _execute(self, action: Array) -> None:
        self._state = self._env.advance(action, self._spec.action.relative_to)


def proprioception(state: State, opening: float) -> NDArray[np.float32]:
    """``(7,)``: the hand's position (metres), rotation vector (radians), share of its ``opening``."""
    # As ``from_matrix`` does it to the last bit, but without checks that take 2 % of a rollout
    matrix, eye = state.tcp_rotation, np.eye(3)
    if not (np.abs(matrix @ matrix.T - eye) <= 1e-12 + 1e-5 * eye).all():
        left, _, right = np.linalg.svd(matrix)
        matrix = left @ right
    turn = Rotation.from_matrix(matrix, assume_valid=True).as_rotvec()
    return np.concatenate([state.tcp, turn, [state.opening / opening]]).astype(np.float32)


class TabletopEvaluator(SceneEvaluator):
    """Runs a policy in scenes of one task; ``catalogue`` has their objects."""

    def __init__(
        self, conditions: Conditions, policy: Policy, catalogue: Catalogue, **options: Unpack[Options]
    ) -> None:
        self._task, self.catalogue = task_named(conditions.task), catalogue
        super().__init__(conditions, policy, self._task.stage_names, **options)
        self._visible = stored_visible(conditions)
        self._env: Room | None = None

    @abstractmethod
    def room(self, cameras: Sequence[CameraRequest], hz: int, robot: str, full: Collection[str]) -> Room:
        """Where scenes are run. ``full``: the cameras whose pictures have that quality."""

    @staticmethod
    @abstractmethod
    def settled(scene: Scene, catalogue: Catalogue) -> Rejection | None:
        """Why objects do not stay in place for a second, or the task is solved at once; None for a fair scene."""

    def check(self, scene: Scene) -> Rejection | None:
        if scene.task != self._task.name:
            return Rejection("semantic", f"its task is {scene.task!r}, not {self._task.name!r}")
        distance, spec = MIN_DISTANCE.of(self._conditions), self._policy.spec
        flat = spec.silhouettes and not spec.cameras and not spec.calibrated
        first = without(scene, scene.events)
        rejection = check_static(first, self.catalogue, distance, self._visible, outlines=flat)
        rejection = rejection or check_events(scene, self.catalogue, distance, self._visible)
        rejection = rejection or self.settled(first, self.catalogue)
        if rejection is None and scene.events:
            rejection = self.settled(afterwards(scene), self.catalogue)
        return rejection

    def begin(self, scene: Scene, seed: int) -> TabletopEpisode:
        spec = self._policy.spec
        cameras = spec.cameras
        if self.recorded:  # as wide as the robot's view
            cameras += (replace(self.recorded, width=rig(scene.robot).view.width(self.recorded.height)),)
        if self._env is not None and self._env.rig.robot != scene.robot:
            self.renew()
        if self._env is None:
            full = cameras if QUALITY.of(self._conditions) == "full" else cameras[len(spec.cameras) :]  # films always
            self._env = self.room(cameras, spec.action.hz, scene.robot, [camera.name for camera in full])
        return TabletopEpisode(self._env, spec, scene, seed, self._conditions)

    def renew(self) -> None:
        if self._env is not None:
            self._env.close()
            self._env = None


HAND = 255  # label; objects are counted from 1, 0 is the background


def outlines(
    models: Sequence[ObjectModel], state: State, view: CameraPose, light: float, table: Sequence[float] = COLOUR
) -> Outlines:
    """A camera's view without a renderer: outlines of objects and hand, with their colours under the light.

    Each convex part is painted, farthest object first, into a label image 256 pixels wide. Colours, and the
    ``table``'s, are times ``light``, up to 1.
    """
    depth = [float((position - view.position) @ view.axes[0]) for position in state.positions]
    bodies = [
        [part @ turn.T + place for part in model.parts]
        for model, turn, place in zip(models, state.rotations, state.positions, strict=True)
    ]
    areas = [area_alone(body, view) for body in bodies]
    seen = blank(view)
    for index in sorted(state.there, key=lambda i: -depth[i]):
        paint(seen, bodies[index], view, index + 1)
    paint(seen, hand_boxes(state.tcp, state.tcp_rotation, state.opening), view, HAND)
    things = []
    for label, (model, area) in enumerate(zip(models, areas, strict=True), 1):
        v, u = np.nonzero(seen == label)
        if len(u):
            pixels = np.stack([(u + 0.5) / seen.shape[1], (v + 0.5) / seen.shape[0]], axis=1)
            colour = np.minimum(model.colour * light, 1.0)
            things.append(Silhouette(pixels, colour, min(len(pixels) / area, 1.0)))
    # From left to right: the scene's order would reveal which object is the target
    things.sort(key=lambda thing: float(thing.pixels[:, 0].mean()))
    hand, distance = view.project(state.tcp[None])
    visible = bool(distance[0] > 0 and np.all((hand[0] >= 0) & (hand[0] <= 1)))
    return Outlines(tuple(things), hand[0] if visible else None, np.minimum(np.array(table) * light, 1.0))
