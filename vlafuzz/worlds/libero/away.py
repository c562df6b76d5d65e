"""Things put away: in the model of an environment, not in its scene, so that nothing is built for a scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.worlds.libero.packages import load

Array = NDArray[np.float64]
BELOW = -5.0  # metres: the height at which things are put away, in a row
APART = 0.5  # metres between them
NOBODY = 1 << 30  # a kind of shape that no other one collides with
HIDDEN = 5  # a group of shapes that neither pictures nor rays show
STIFF = 1e6  # damping that keeps a thing from falling: micrometres in a rollout


def with_more(problem: type[Any], more: tuple[str, ...]) -> type[Any]:
    """A problem's class of LIBERO, whose environments have more objects, apart from one another."""
    if not more:
        return problem
    make = load("libero.libero.envs.objects").get_object_fn

    def load_objects(env: Any, arena: Any) -> None:
        problem._load_objects_in_arena(env, arena)
        for index, name in enumerate(more):
            thing = env.objects_dict[name] = make(name)(name=name)
            thing.get_obj().set("pos", f"{APART * index - 2.0} 2.0 2.0")

    return type(problem.__name__, (problem,), {"_load_objects_in_arena": load_objects})


class Away:
    """Puts things of a robosuite environment away and takes them out again.

    Attributes:
        addresses: by thing, where its seven numbers begin in the positions.
        shapes: by thing, the numbers of its shapes that collide.
    """

    def __init__(self, env: Any) -> None:
        self._env, self._model = env, env.sim.model._model
        model, roots = self._model, self._model.body_rootid
        self._geoms, self._dofs = dict[str, NDArray[np.int64]](), dict[str, slice]()
        self.addresses, self.shapes = dict[str, int](), dict[str, NDArray[np.int64]]()
        for name, thing in env.objects_dict.items():
            joint = model.joint(thing.joints[0])
            start = int(joint.dofadr[0])
            self.addresses[name] = int(joint.qposadr[0])
            self._dofs[name] = slice(start, start + 6)
            geoms = np.flatnonzero(roots[model.geom_bodyid] == env.obj_body_id[name])
            self._geoms[name], self.shapes[name] = geoms, geoms[model.geom_contype[geoms] > 0]
        self._usual = {
            array: getattr(model, array).copy()
            for array in ("geom_contype", "geom_conaffinity", "geom_group", "dof_damping")
        }

    def states(self, own: Array, more: tuple[str, ...]) -> Array:
        """``(n, 1 + nq + nv)``: a suite's ``initial_states``, with ``more`` things away."""
        nq, nv = self._model.nq, self._model.nv
        positions, speeds = np.ones(nq, bool), np.ones(nv, bool)
        for name in more:
            positions[self.addresses[name] : self.addresses[name] + 7] = False
            speeds[self._dofs[name]] = False
        states = np.zeros((len(own), 1 + nq + nv))
        states[:, np.concatenate([[True], positions, speeds])] = own
        for state in states:
            for name in more:
                self.put(state[1 : 1 + nq], name)
        return states

    def put(self, positions: Array, name: str) -> None:
        """Change ``(nq,)`` positions so that a thing is away."""
        at = self.addresses[name]
        place = [APART * list(self.addresses).index(name), 0.0, BELOW]
        positions[at : at + 7] = [*place, 1.0, 0.0, 0.0, 0.0]

    def leave(self, present: set[str]) -> dict[str, int]:
        """Have some things in the scene and no others; returns the bodies of them and of the furniture."""
        model = self._model
        for array, usual in self._usual.items():
            getattr(model, array)[:] = usual
        for name in self.addresses.keys() - present:
            geoms = self._geoms[name]
            model.geom_contype[geoms], model.geom_conaffinity[geoms] = 0, NOBODY
            model.geom_group[geoms] = HIDDEN
            model.dof_damping[self._dofs[name]] = STIFF
        away = self.addresses.keys() - present
        return {name: body for name, body in self._env.obj_body_id.items() if name not in away}
