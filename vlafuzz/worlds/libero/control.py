"""One control step of robosuite's operational space controller without its detours: same bits, less time.

robosuite computes the full forward dynamics three times a simulation step: before the controller, in it, and in the
step itself. Nothing of the first two is used but positions and velocities, so MuJoCo's two half steps, with the
controller between them, give the same states.
"""

from copy import copy
from typing import Any

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.worlds.libero.packages import load

# robosuite 1.4 samples its observations in the 24th of 25 simulation steps, after that step's integration,
# which moves joints but not yet bodies.
_OBSERVED = 23


class Control:
    """Applies actions to the arm of a robosuite environment.

    The environment's own controller is kept; ``_update`` instead of its own method tells it the arm's state.

    Attributes:
        seen: ``(nq,)`` positions that the bodies in robosuite's observation of the last step are at. seen_fingers:
        ``(2,)`` positions of the fingers in it, metres.
    """

    def __init__(self, env: Any) -> None:
        self._mujoco = load("mujoco")
        robot = env.robots[0]
        self._model, self._data = env.sim.model._model, env.sim.data._data
        self._controller, self._gripper = robot.controller, robot.gripper
        self._site = env.sim.model.site_name2id(self._controller.eef_name)
        self._arm = np.array(robot._ref_joint_actuator_indexes)
        self._fingers = np.array([env.sim.model.actuator_name2id(name) for name in self._gripper.actuators])
        self._limits = robot.torque_limits
        self._finger_positions = np.array(robot._ref_gripper_joint_pos_indexes)
        ranges = self._model.actuator_ctrlrange[self._fingers]
        self._middle = 0.5 * (ranges[:, 1] + ranges[:, 0])
        self._half = 0.5 * (ranges[:, 1] - ranges[:, 0])
        self._steps = int(env.control_timestep / env.model_timestep)
        self._velocities = np.array(self._controller.qvel_index)
        self._mass = np.zeros((self._model.nv, self._model.nv))
        self._jacobians = np.zeros((2, 3, self._model.nv))
        self._controller.update = self._update
        # robosuite's first action of an episode starts from the arm as built, not from the initial state
        self._start = {
            name: copy(value) for name, value in vars(self._controller).items() if isinstance(value, np.ndarray | bool)
        }
        self._first_command = copy(self._gripper.current_action)
        self.reset()

    def reset(self) -> None:
        """Forget earlier actions: controller and gripper are as they were built."""
        vars(self._controller).update({name: copy(value) for name, value in self._start.items()})
        self._gripper.current_action = copy(self._first_command)
        self.seen, self.seen_fingers = self._data.qpos.copy(), self._data.qpos[self._finger_positions].copy()

    def step(self, action: Array) -> None:
        """Simulate one control step. ``action``: ``(7,)``."""
        for number in range(self._steps):
            if number == _OBSERVED:
                self.seen = self._data.qpos.copy()
            elif number == _OBSERVED + 1:
                self.seen_fingers = self._data.qpos[self._finger_positions].copy()
            self._mujoco.mj_step1(self._model, self._data)
            if number == 0:
                self._controller.set_goal(action[:-1])
            torques = np.clip(self._controller.run_controller(), *self._limits)
            fingers = self._gripper.format_action(action[-1:])
            self._data.ctrl[self._fingers] = self._middle + self._half * fingers
            self._data.ctrl[self._arm] = torques
            self._mujoco.mj_step2(self._model, self._data)

    def _update(self, force: bool = False) -> None:  # noqa: FBT001, FBT002 - robosuite's signature
        controller, data = self._controller, self._data
        if not (controller.new_update or force):
            return
        translation, rotation = self._jacobians
        self._mujoco.mj_jacSite(self._model, data, translation, rotation, self._site)
        controller.ee_pos = np.array(data.site_xpos[self._site])
        controller.ee_ori_mat = np.array(data.site_xmat[self._site].reshape([3, 3]))
        controller.ee_pos_vel = np.dot(translation, data.qvel)
        controller.ee_ori_vel = np.dot(rotation, data.qvel)
        controller.joint_pos = np.array(data.qpos[controller.qpos_index])
        controller.joint_vel = np.array(data.qvel[controller.qvel_index])
        controller.J_pos = np.array(translation[:, self._velocities])
        controller.J_ori = np.array(rotation[:, self._velocities])
        controller.J_full = np.vstack([controller.J_pos, controller.J_ori])
        self._mujoco.mj_fullM(self._model, data, self._mass)
        controller.mass_matrix = self._mass[self._velocities, :][:, self._velocities]
        controller.new_update = False
