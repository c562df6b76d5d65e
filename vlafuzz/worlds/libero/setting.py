"""How a scene is set up in an environment of LIBERO: places, light, camera, the arm's joints.

Where nothing deviates, the state is the suite's own, bit for bit.
"""

import math
from dataclasses import astuple

import numpy as np
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array
from vlafuzz.errors import SceneError
from vlafuzz.model import Camera, Placement, Scene
from vlafuzz.model.scene import CameraBump, Event, GripWeak, InstructionChange, LightSwitch, TargetTopple
from vlafuzz.worlds.events import NUMBERS, has_room, lit, newcomer, turned, without
from vlafuzz.worlds.libero.casts import cast, switches
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.grasps import surface, triangles
from vlafuzz.worlds.libero.pictures import CAMERAS
from vlafuzz.worlds.libero.suites import LYING
from vlafuzz.worlds.manipulation.camera import exposed
from vlafuzz.worlds.sight import CameraPose

VIEW = CAMERAS[0]
# Axes of MuJoCo's camera frame (right, up, backwards) in ours (forward, left, up)
_OURS = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_LIT = ("ambient", "diffuse", "specular")
GAP = 0.002  # metres above what carries a thing, at the start
OUTLINE = 1500  # points of a thing's surface
LOWER = 0.01  # metres by which a thing's top comes down where it falls over; what lies already would stand up
CALM = 20  # control steps after which the suite's things rest


class Setting:
    """Sets scenes up in one environment. It knows the environment's own light and camera."""

    def __init__(self, env: LiberoEnv) -> None:
        self.env, self._task, model = env, env.task, env.model
        lamps = [(model, f"light_{part}") for part in _LIT] + [(model.vis.headlight, part) for part in _LIT]
        self._lamps = [(owner, name, getattr(owner, name).copy()) for owner, name in lamps]
        self._fingers = env.robosuite.robots[0]._ref_joint_gripper_actuator_indexes
        self._press = model.actuator_forcerange[self._fingers].copy()
        self._camera = model.camera(VIEW).id
        self._eye, self._turn = model.cam_pos[self._camera].copy(), model.cam_quat[self._camera].copy()
        self._standing = Standing(env) if env.more else None
        self._addresses = env.away.addresses

    def begin(self, scene: Scene) -> None:
        """Begin an episode in a scene; a SceneError if the task has no such things, or no such initial state."""
        env, number = self.env, scene.start.state
        there = without(scene, scene.events).confounders
        task, added = cast(self._task, scene), tuple(placed.object for placed in there)
        if number >= len(env.states):
            problem = f"start.state: {task} has {len(env.states)} initial states, not {number + 1}"
            raise SceneError(problem)
        env.cast(task, added)
        state = env.states[number].copy()
        positions = state[1 : 1 + env.model.nq]
        if self._standing:
            self._swap(self._standing, positions)
        self._place(scene, positions)
        if self._standing:
            for placed in there:
                self._stand(self._standing, placed, positions)
        self._light(exposed(scene).light.intensity)
        self._aim(scene.camera)
        self._grip(1.0)
        env.restore(state)

    @property
    def view(self) -> CameraPose:
        """The camera's present pose."""
        data, fov = self.env.data, float(self.env.model.cam_fovy[self._camera])
        axes = _OURS @ data.cam_xmat[self._camera].reshape(3, 3).T
        return CameraPose(data.cam_xpos[self._camera].copy(), axes, fov, 1.0)

    def let_in(self, scene: Scene) -> bool:
        """Put down the newcomer of a scene if it has room beside things and hand; whether it had."""
        env, late, standing = self.env, newcomer(scene), self._standing
        assert late is not None
        assert standing is not None
        placed, positions = scene.placements[late], env.data.qpos.copy()
        bodies = [surface(env, env.bodies[name], OUTLINE) for name in env.movable]
        fingers = (env.model.geom(name).id for name in env.robosuite.robots[0].gripper.contact_geoms)
        bodies += [triangles(env, geom).reshape(-1, 3) for geom in fingers]
        self._stand(standing, placed, positions)
        before = env.data.qpos.copy()
        env.cast(env.task, tuple(thing.object for thing in scene.confounders))
        env.arrange(positions)
        env.data.qvel[env.away.freedoms[placed.object]] = 0.0
        free = has_room(surface(env, env.bodies[placed.object], OUTLINE), bodies)
        if not free:
            env.cast(env.task, tuple(thing.object for thing in without(scene, scene.events).confounders))
            env.arrange(before)
        return free

    def happen(self, scene: Scene, event: Event) -> None:
        """What begins with an event of a scene in mid-episode, and stays."""
        if isinstance(event, CameraBump):
            self._aim(turned(scene.camera, event))
        elif isinstance(event, LightSwitch):
            self._light(exposed(lit(scene, event)).light.intensity)
        elif isinstance(event, GripWeak):
            self._grip(event.force)
        elif isinstance(event, InstructionChange) and event.to in NUMBERS:
            self.env.task = switches(self.env.task)[NUMBERS[event.to] - 1]
        elif isinstance(event, TargetTopple):
            self._lay(self.env.data.qpos.copy(), scene.targets[0].object)
            self.env.data.qvel[self.env.away.freedoms[scene.targets[0].object]] = 0.0

    def slide(self, slot: int, shift: Array) -> None:
        """Move a thing of the task by ``(2,)`` metres; it keeps its height and does not begin to roll."""
        name, data = self.env.task.things[slot], self.env.data
        at, free = self._addresses[name], self.env.away.freedoms[name]
        data.qpos[at : at + 2] += shift
        data.qvel[free] *= [0, 0, 1, 0, 0, 0]

    def _stand(self, standing: "Standing", placed: Placement, positions: Array) -> None:
        """Have a thing that is added at its place, in ``(nq,)`` positions."""
        at, place = self._addresses[placed.object], np.array([placed.x, placed.y])
        positions[at : at + 7] = standing.pose(placed.object, place)
        _turned(positions, at, place, placed)

    def _grip(self, force: float) -> None:
        self.env.model.actuator_forcerange[self._fingers] = force * self._press

    def _light(self, intensity: float) -> None:
        for owner, name, usual in self._lamps:
            getattr(owner, name)[:] = usual * intensity

    def _swap(self, standing: "Standing", positions: Array) -> None:
        for own, name in zip(self._task.things, self.env.task.things, strict=True):
            if name != own:
                at, new = self._addresses[own], self._addresses[name]
                bottom = standing.bottom(positions, own)
                positions[new : new + 7] = standing.pose(name, positions[at : at + 2].copy(), bottom)
                self.env.away.put(positions, own)

    def _place(self, scene: Scene, positions: Array) -> None:
        """Move things and joints in the ``(nq,)`` positions of an initial state."""
        placed, riders = {placement.object: placement for placement in scene.targets}, self.env.task.riders
        start = {name: positions[at : at + 2].copy() for name, at in self._addresses.items() if name in placed}
        for name in placed:
            at, carrier, chain = self._addresses[name], riders.get(name), [placed[name]]
            while carrier is not None:  # what stands on something goes along with it
                chain.append(placed[carrier])
                _turned(positions, at, start[carrier], placed[carrier])
                carrier = riders.get(carrier)
            _turned(positions, at, positions[at : at + 2].copy(), placed[name])
            for axis, offset in enumerate((sum(p.x for p in chain), sum(p.y for p in chain))):
                if offset:
                    positions[at + axis] += offset
        if scene.targets[0].rest == LYING:
            self._lay(positions, scene.targets[0].object)
        arm = self.env.robosuite.robots[0]._ref_joint_pos_indexes
        for joint, degrees in zip(arm, astuple(scene.initial_pose), strict=True):
            if degrees:
                positions[joint] += math.radians(degrees)

    def _lay(self, positions: Array, name: str) -> None:
        """Have a thing, and ``(nq,)`` positions, lie on its lowest side; a SceneError if it cannot fall over.

        It falls over its lower edge, along one of its own axes and towards the robot, which reaches it there.
        """
        env, at = self.env, self._addresses[name]
        env.arrange(positions)
        place, axes = env.place(name), env.data.xmat[env.bodies[name]].reshape(3, 3).T
        before = np.concatenate([triangles(env, int(geom)).reshape(-1, 3) for geom in env.away.shapes[name]]) - place
        nearer = env.robosuite.robots[0].base_pos - place
        ways = [math.copysign(1.0, axis @ nearer) * axis for axis in axes if abs(axis[2]) < 0.5]
        turns = (Rotation.from_rotvec(math.pi / 2 * np.cross([0.0, 0.0, 1.0], way)) for way in ways)
        falls = ((turn.apply(before), way, turn) for way, turn in zip(ways, turns, strict=True))
        after, way, turn = min(falls, key=lambda fall: np.ptp(fall[0][:, 2]))
        if np.ptp(after[:, 2]) > np.ptp(before[:, 2]) - LOWER:
            raise SceneError(f"target-knock: {name} cannot fall over")
        own = Rotation.from_quat(positions[at + 3 : at + 7], scalar_first=True)
        positions[at : at + 3] += ((before @ way).max() - (after @ way).min()) * way
        positions[at + 2] = place[2] + before[:, 2].min() - after[:, 2].min() + GAP
        positions[at + 3 : at + 7] = (turn * own).as_quat(scalar_first=True)
        env.arrange(positions)

    def _aim(self, camera: Camera) -> None:
        model, number = self.env.model, self._camera
        model.cam_pos[number], model.cam_quat[number] = self._eye, self._turn
        if camera == Camera():
            return
        model.cam_pos[number] = self._eye + camera.offset
        turn = Rotation.from_euler("ZYX", [camera.yaw, camera.pitch, camera.roll], degrees=True)
        own = Rotation.from_matrix(_OURS.T @ turn.as_matrix() @ _OURS)
        turned = Rotation.from_quat(self._turn, scalar_first=True) * own
        model.cam_quat[number] = turned.as_quat(scalar_first=True)


def _turned(positions: Array, at: int, about: Array, placement: Placement) -> None:
    """Turn the free joint at an address by a placement's yaw about a vertical through a point."""
    if not placement.yaw:
        return
    turn = Rotation.from_euler("z", placement.yaw, degrees=True)
    away = np.array([*(positions[at : at + 2] - about), 0.0])
    positions[at : at + 2] = about + turn.apply(away)[:2]
    quaternion = Rotation.from_quat(positions[at + 3 : at + 7], scalar_first=True)
    positions[at + 3 : at + 7] = (turn * quaternion).as_quat(scalar_first=True)


class Standing:
    """Knows the table or floor of an environment, which has the suite's things now, and how others stand."""

    def __init__(self, env: LiberoEnv) -> None:
        self._env = env
        self._rests = dict[str, tuple[Array, float]]()  # its quaternion, and metres from its middle down
        env.reset()
        env.settle(CALM)
        self._ground = min(self._lowest(name) for name in env.task.things)

    def pose(self, name: str, place: Array, bottom: float = -np.inf) -> Array:
        """``(7,)`` of a thing's joint at a ``(2,)`` place.

        ``bottom``: the height of its lowest point; at least that of table or floor. Metres.
        """
        if name not in self._rests:
            self._rests[name] = self.show(name), -self._lowest(name)
        quaternion, below = self._rests[name]
        return np.concatenate([place, [max(bottom, self._ground) + below + GAP], quaternion])

    def bottom(self, positions: Array, name: str) -> float:
        """The height of a thing's lowest point where everything is at ``(nq,)`` positions, metres."""
        self._env.arrange(positions)
        return self._lowest(name)

    def show(self, name: str) -> Array:
        """Turn a thing as LIBERO's samplers do, alone in the middle of everything; returns its quaternion.

        They turn it by the first end of each range of angles, and write x, y, z, w, which MuJoCo takes for w, x, y, z.
        """
        thing = self._env.robosuite.objects_dict[name]
        turns = thing.rotation if isinstance(thing.rotation, dict) else {thing.rotation_axis: thing.rotation}
        turn = Rotation.identity()
        for axis, angles in turns.items():
            turn = Rotation.from_euler(axis, np.ravel(angles)[0]) * turn
        quaternion = np.asarray(turn.as_quat())
        positions = self._env.states[0][1 : 1 + self._env.model.nq].copy()
        at = self._env.away.addresses[name]
        positions[at : at + 7] = [0.0, 0.0, 0.0, *quaternion]
        self._env.arrange(positions)
        return quaternion

    def _lowest(self, name: str) -> float:
        env = self._env
        return min(float(triangles(env, int(geom))[..., 2].min()) for geom in env.away.shapes[name])
