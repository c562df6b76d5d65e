"""One control step of robosuite's robot without its detours: same bits, less time.

robosuite computes the full forward dynamics three times a simulation step: before the controller, in it, and in the
step itself. Nothing of the first two is used but positions and velocities, so MuJoCo's two half steps, with the
controller between them, give the same states.
"""

from copy import copy
from types import SimpleNamespace
from typing import Any

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.worlds.libero.packages import load

# robosuite 1.4 samples its observations in the 24th of 25 simulation steps, after that step's integration,
# which moves joints but not yet bodies.
_OBSERVED = 23


class Control:
    """Applies actions to the arm of a robosuite environment.

    Attributes:
        seen: ``(nq,)`` positions that the bodies in robosuite's observation of the last step are at. seen_fingers:
        ``(2,)`` positions of the fingers in it, metres.
    """

    def __init__(self, env: Any) -> None:
        self._mujoco, self._env, robot = load("mujoco"), env, env.robots[0]
        self._model, self._data = env.sim.model._model, env.sim.data._data
        self._controller, self._gripper = robot.controller, robot.gripper
        self._controller.sim = SimpleNamespace(forward=lambda: None, model=env.sim.model, data=env.sim.data)
        self._finger_positions = np.array(robot._ref_gripper_joint_pos_indexes)
        self._steps = int(env.control_timestep / env.model_timestep)
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
            self._env._pre_action(action, policy_step=number == 0)
            self._mujoco.mj_step2(self._model, self._data)
