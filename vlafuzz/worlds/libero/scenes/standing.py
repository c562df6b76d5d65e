"""How things stand that the suite's initial states do not have: turned as LIBERO turns its own."""

from __future__ import annotations

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
