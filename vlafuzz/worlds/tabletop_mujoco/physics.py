"""Robot, table and objects simulated by MuJoCo: metric actions, contacts, grasps. Equal scenes repeat bit by bit."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array
from vlafuzz.model import InitialPose, Placement, Scene
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.manipulation.rotations import quaternion
from vlafuzz.worlds.tabletop.fairness.footprint import pose_of
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.room import GRASP_COSINE, GRASP_FORCE
from vlafuzz.worlds.tabletop.tasks import ARM, HAND, TABLE, State
from vlafuzz.worlds.tabletop_mujoco.build import FINGERS, FORCE, RESISTANCE, STEP, STIFFNESS, TCP, compiled

ARM_JOINTS = PANDA.arm_joints
CLOSED, OPEN = -0.01, 0.04  # metres: drive targets of a finger for commands of -1 and +1, as in ManiSkill
TOUCH = 1e-4  # newtons: the tabletop's smallest impulse over a physics step there
IK_ITERATIONS, IK_DAMPING = 50, 1e-6
REACHED = 1e-4  # metres and radians
FARTHEST = 0.2  # radians in an iteration


Aim = tuple[Array, Rotation]


class Placed(NamedTuple):
    """A pose: metres, and a quaternion w, x, y, z."""

    p: Array
    q: Array


class MujocoPhysics:
    """A robot at a table with the objects of one scene at a time; see ``World`` in ``tabletop.sim``."""

    def __init__(self, control_hz: int) -> None:
        self._substeps = round(1 / (STEP * control_hz))

    def begin(self, scene: Scene, models: Sequence[ObjectModel], *, touched: bool = False) -> State:
        """Place the objects at rest and reset the robot; the state at the start.

        ``touched``: whether to look for contacts before the gripper first closes.
        """
        self.model = model = compiled(models, scene.placements, scene.backdrop)
        self.data, self._planned = mujoco.MjData(model), mujoco.MjData(model)
        self._tcp, self._fingers = model.body(TCP).id, [model.body(name).id for name in FINGERS]
        self._low, self._high = model.jnt_range[:ARM_JOINTS].T
        names = [model.body(body).name for body in range(model.nbody)]
        self._labels: list[int | str] = [HAND if "hand" in name or "finger" in name else ARM for name in names]
        self._labels[0] = TABLE
        self._order = list(range(len(models)))  # of things as states have them
        self._label()
        rest, turns = np.array(PANDA.rest), np.radians(astuple(scene.initial_pose)[:ARM_JOINTS])
        self._targets = rest + np.append(turns, [0.0, 0.0])
        self.data.qpos[: len(rest)] = self._targets
        offsets = np.degrees(self.data.qpos[:ARM_JOINTS] - rest[:ARM_JOINTS]).tolist()
        self.initial_pose = InitialPose(**{f"j{joint}": offset for joint, offset in enumerate(offsets, 1)})
        mujoco.mj_forward(model, self.data)
        self._aim = self._pose(self._targets)
        self._touched = touched
        self._before: tuple[Array, Array] | None = None
        self.states_hash = hashlib.blake2b(digest_size=16)
        return self.read()

    @property
    def poses(self) -> tuple[Placed, ...]:
        poses = self.data.qpos[len(self._targets) :].reshape(-1, 7)[self._order]
        return tuple(Placed(pose[:3], pose[3:]) for pose in poses)

    @staticmethod
    def place(model: ObjectModel, placement: Placement) -> Placed:
        turn, position = pose_of(placement, model)
        return Placed(position, quaternion(turn))

    def step(self, action: Array, relative_to: str = "target", slides: Mapping[int, Array] | None = None) -> State:
        if relative_to == "current":
            self._aim = self._pose(self.data.qpos[: len(self._targets)])
        place, turn = self._aim
        aim = place + action[:3], Rotation.from_rotvec(action[3:6]) * turn
        joints = self._joints(aim)
        if joints is not None:
            self._aim, self._targets = aim, joints
        self._targets[ARM_JOINTS:] = CLOSED + (OPEN - CLOSED) * (min(max(action[6], -1.0), 1.0) + 1) / 2
        self.data.ctrl[:] = self._targets
        self._touched = self._touched or action[6] < 0
        for _ in range(self._substeps if slides else 1):
            for index, shift in (slides or {}).items():  # it keeps its height and does not begin to roll
                pose, speed = self._state_of(index)
                pose[:2] += shift / self._substeps
                speed[[0, 1, 3, 4, 5]] = 0.0
            mujoco.mj_step(self.model, self.data, nstep=1 if slides else self._substeps)
        return self.read()

    def put(self, number: int, pose: Placed, up: float = 0.0, *, floats: bool = False) -> None:
        now, speed = self._state_of(number)
        now[2:], speed[:] = [pose.p[2] + up, *pose.q], 0.0
        self.model.body_gravcomp[self.model.body(str(number)).id] = float(floats)

    def exchange(self, number: int) -> State:
        self._order[0], self._order[number] = self._order[number], self._order[0]
        self._label()
        return self.read()

    def grip(self, force: float) -> None:
        for finger in range(ARM_JOINTS, len(self._targets)):
            self.model.actuator_gainprm[finger, 0] = force * STIFFNESS
            self.model.actuator_biasprm[finger, 1:3] = -force * STIFFNESS, -RESISTANCE
            self.model.actuator_forcerange[finger] = -force * FORCE, force * FORCE

    def _label(self) -> None:
        """Bodies are labelled by the place of a thing in states; the things are the last bodies."""
        first = self.model.nbody - len(self._order)
        for index, number in enumerate(self._order):
            self._labels[first + number] = index
        self._bodies = [first + number for number in self._order]

    def _state_of(self, number: int) -> tuple[Array, Array]:
        """Views of pose (7,) and speed (6,) of a thing, by its place in the scene."""
        joints = len(self._targets)
        at, moves = joints + 7 * number, joints + 6 * number
        return self.data.qpos[at : at + 7], self.data.qvel[moves : moves + 6]

    def read(self) -> State:
        """The present state, which is added to the hash."""
        data = self.data
        self.states_hash.update(data.qpos.tobytes() + data.qvel.tobytes())
        contacts, held = self._contacts() if self._touched else (frozenset(), None)
        mujoco.mj_kinematics(self.model, data)  # a step leaves the positions of its beginning
        positions = data.xpos[self._bodies].copy()
        rotations = data.xmat[self._bodies].reshape(-1, 3, 3).copy()
        earlier, self._before = self._before, (positions, rotations)
        return State(
            positions=positions,
            rotations=rotations,
            tcp=data.xpos[self._tcp].copy(),
            tcp_rotation=data.xmat[self._tcp].reshape(3, 3).copy(),
            opening=float(data.qpos[ARM_JOINTS : ARM_JOINTS + 2].sum()),
            held=held,
            contacts=contacts,
            earlier=earlier,
            seconds=self._substeps * STEP,
        )

    def _contacts(self) -> tuple[frozenset[tuple[int, int | str]], int | None]:
        """Contacts of the first object and of the hand in the last physics step, and what both fingers press on."""
        model, data, wrench = self.model, self.data, np.zeros(6)
        pairs = set[tuple[int, int | str]]()
        pushes: dict[int, dict[int, Array]] = {finger: {} for finger in self._fingers}
        for number in range(data.ncon):
            contact = data.contact[number]
            first, second = (int(model.geom_bodyid[geom]) for geom in contact.geom)
            label, other = self._labels[first], self._labels[second]
            if not (label == 0 or other == 0 or label == HAND or other == HAND):
                continue
            mujoco.mj_contactForce(model, data, number, wrench)
            if np.abs(wrench[:3]).max() < TOUCH:
                continue
            push = contact.frame.reshape(3, 3).T @ wrench[:3]
            for index, label_of_other, body in ((label, other, second), (other, label, first)):
                if isinstance(index, int):
                    pairs.add((index, label_of_other))
                    if body in pushes:
                        signed = push if body == first else -push
                        pushes[body][index] = pushes[body].get(index, 0.0) + signed
        common = sorted(set.intersection(*map(set, pushes.values())))
        held = (index for index in common if all(self._presses(finger, pushes[finger][index]) for finger in pushes))
        return frozenset(pairs), next(held, None)

    def _presses(self, finger: int, push: Array) -> bool:
        size, along = float(np.linalg.norm(push)), float(self.data.xmat[finger].reshape(3, 3)[:, 1] @ push)
        return size >= GRASP_FORCE and abs(along) >= GRASP_COSINE * size

    def _pose(self, joints: Array) -> Aim:
        """Place and orientation of the tool centre point, by forward kinematics."""
        self._planned.qpos[: len(joints)] = joints
        mujoco.mj_kinematics(self.model, self._planned)
        turn = self._planned.xmat[self._tcp].reshape(3, 3)
        return self._planned.xpos[self._tcp].copy(), Rotation.from_matrix(turn)

    def _joints(self, aim: Aim) -> Array | None:
        """The joint positions of a pose by damped least squares within the limits; None if it is out of reach."""
        joints: Array = self._targets.copy()
        shift, turn = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
        for _ in range(IK_ITERATIONS):
            place, orientation = self._pose(joints)
            off = np.append(aim[0] - place, (aim[1] * orientation.inv()).as_rotvec())
            if np.abs(off).max() < REACHED:
                return joints
            mujoco.mj_comPos(self.model, self._planned)
            mujoco.mj_jacBody(self.model, self._planned, shift, turn, self._tcp)
            jacobian = np.vstack([shift, turn])[:, :ARM_JOINTS]
            change = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + IK_DAMPING * np.eye(6), off)
            change *= FARTHEST / max(float(np.abs(change).max()), FARTHEST)
            joints[:ARM_JOINTS] = np.clip(joints[:ARM_JOINTS] + change, self._low, self._high)
        return None
