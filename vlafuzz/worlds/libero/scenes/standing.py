"""How things stand that the suite's initial states do not have: turned as LIBERO turns its own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.expert.grasps import triangles

Array = NDArray[np.float64]
GAP = 0.002  # metres above what carries a thing, at the start
CALM = 20  # control steps after which the suite's things rest


class Standing:
    """Knows the table or floor of an environment, which has the suite's things now, and how others stand."""

    def __init__(self, env: LiberoEnv) -> None:
        self._env = env
        self._rests = dict[str, tuple[Array, float]]()
        env.reset()
        env.settle(CALM)
        self._ground = min(_lowest(env, name) for name in env.task.things)

    def pose(self, name: str, place: Array, bottom: float = -np.inf) -> Array:
        """``(7,)`` of a thing's joint.

        Args:
            place: ``(2,)`` metres.
            bottom: the height of its lowest point, metres; at least that of table or floor.
        """
        if name not in self._rests:
            self._rests[name] = self._rest(name)
        quaternion, below = self._rests[name]
        height = max(bottom, self._ground) + below + GAP
        return np.concatenate([place, [height], quaternion])

    def bottom(self, positions: Array, name: str) -> float:
        """The height of a thing's lowest point where everything is at ``(nq,)`` positions, metres."""
        self._env.arrange(positions)
        return _lowest(self._env, name)

    def show(self, name: str) -> Array:
        """Turn a thing as LIBERO does, alone in the middle of everything; returns its quaternion."""
        quaternion = _usual_turn(self._env.robosuite.objects_dict[name])
        positions = self._env.states[0][1 : 1 + self._env.model.nq].copy()
        at = self._env.address(name)
        positions[at : at + 7] = [0.0, 0.0, 0.0, *quaternion]
        self._env.arrange(positions)
        return quaternion

    def _rest(self, name: str) -> tuple[Array, float]:
        """A thing's quaternion, and how far its lowest point is below its middle."""
        return self.show(name), -_lowest(self._env, name)


def _usual_turn(thing: Any) -> Array:
    """``(4,)`` w, x, y, z, as LIBERO's samplers turn an object of its own: at the first end of each range."""
    turns = thing.rotation if isinstance(thing.rotation, dict) else {thing.rotation_axis: thing.rotation}
    turn = Rotation.identity()
    for axis, angles in turns.items():
        turn = Rotation.from_euler(axis, np.ravel(angles)[0]) * turn
    return np.asarray(turn.as_quat())  # x, y, z, w: LIBERO writes it so, and MuJoCo takes it for w, x, y, z


def _lowest(env: LiberoEnv, name: str) -> float:
    return min(float(triangles(env, int(geom))[..., 2].min()) for geom in env.shapes(name))
