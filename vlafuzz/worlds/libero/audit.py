"""Audits the initial states of a suite of LIBERO: they should be at rest, unsolved, and as the task says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vlafuzz.common.files import writing
from vlafuzz.errors import UsageError
from vlafuzz.worlds.audit import AuditedSuite, AuditedTask, Defect, Scope
from vlafuzz.worlds.libero.env import HZ, LiberoEnv
from vlafuzz.worlds.libero.packages import versions
from vlafuzz.worlds.libero.premise import broken_premises
from vlafuzz.worlds.libero.suites import SETTLING, LiberoTask, find_task, find_tasks

Array = NDArray[np.float64]
STEPS = 2 * HZ  # for which the robot keeps still
OVERLAP = 0.005  # metres
SLID = 0.01  # metres sideways; straight down is no defect: all of LIBERO's objects begin in the air
MOVING = 0.005  # metres, after the settling steps
TIPPED = 20.0  # degrees
DROPPED = 0.25  # metres: from a table to the floor
LULL, REST = 5, 3e-5  # control steps in which nothing moves by so much (metres, radians): it has come to rest


def audit(name: str, scope: Scope) -> AuditedSuite:
    """Audit all tasks of a suite, or the one that ``SUITE/NUMBER`` names.

    Raises:
        UsageError: there is no such suite, or a picture cannot be written.
        PrerequisiteError: LIBERO is not installed.
    """
    tasks, audited = [find_task(name)] if "/" in name else find_tasks(name), []
    for done, task in enumerate(tasks):
        scope.watch.progress(name, done, len(tasks))
        audited.append(_audited(task, scope))
    return AuditedSuite(name, str(versions()), tuple(audited))


def _audited(task: LiberoTask, scope: Scope) -> AuditedTask:
    try:
        env = LiberoEnv(task)
    except UsageError as error:
        return AuditedTask(str(task), task.instruction, 0, (Defect(0, "setup", error.message, 0.0),))
    known: list[Defect] = []
    try:
        count = len(env.states) if scope.states is None else min(scope.states, len(env.states))
        for number in range(count):
            found = list(defects(env, number, partial(env.reset, number)))
            if scope.pictures:
                for check in sorted({one.check for one in found} - {one.check for one in known}):
                    picture = f"{task.suite}-{task.number}-{check}-{number}.png"
                    _write_sheet(env, number, scope.pictures / picture)
            known += found
    finally:
        env.close()
    return AuditedTask(str(task), task.instruction, count, tuple(known))


def _write_sheet(env: LiberoEnv, number: int, place: Path) -> None:
    """Write a PNG: both cameras (columns) at the start, after the settling steps, and at the end (rows)."""
    env.reset(number)
    rows = []
    for steps in (0, SETTLING, STEPS - SETTLING):
        env.settle(steps)
        rows.append(np.hstack(list(env.observe().pictures.values())))
    with writing(place):
        Image.fromarray(np.vstack(rows)).save(place)


def defects(env: LiberoEnv, number: int, begin: Callable[[], None], *, regions: bool = True) -> Iterator[Defect]:
    """All defects of initial state ``number``, as ``begin`` sets it up; those that cost least come first.

    ``regions``: see ``broken_premises``.
    """
    names = env.movable
    bodies = [env.bodies[name] for name in names]
    begin()
    start, upright, solved = env.data.xpos[bodies].copy(), _upward(env, bodies), env.solved()
    for pair, depth in _overlaps(env).items():
        yield Defect(number, "overlaps", f"{' and '.join(pair)} overlap by {1000 * depth:.0f} mm", depth)
    env.settle(SETTLING)
    seen, solved = env.data.xpos[bodies].copy(), solved or env.solved()
    for reason in broken_premises(env, regions=regions):
        yield Defect(number, "premise", reason, 0.0)
    _come_to_rest(env, STEPS - SETTLING)
    if solved or env.solved():
        yield Defect(number, "solved", "the goal holds at the start", 0.0)
    end = env.data.xpos[bodies].copy()
    tilts = np.degrees(np.arccos(np.clip((upright * _upward(env, bodies)).sum(axis=1), -1.0, 1.0)))
    for name, way, later, tilt in zip(names, end - start, end - seen, tilts.tolist(), strict=True):
        yield from _moved(number, name, way, float(np.linalg.norm(later)), tilt)


def _upward(env: LiberoEnv, bodies: list[int]) -> Array:
    """``(n, 3)``: which way is up, in the frames of the bodies."""
    return np.asarray(env.data.xmat[bodies].reshape(-1, 3, 3)[:, 2].copy())


def _come_to_rest(env: LiberoEnv, steps: int) -> None:
    """Keep the robot still for that long, or until nothing else moves: the rest changes no verdict."""
    robot = env.robosuite.robots[0]
    own = [*robot._ref_joint_pos_indexes, *robot._ref_gripper_joint_pos_indexes]
    for _ in range(0, steps, LULL):
        before = env.data.qpos.copy()
        env.settle(LULL)
        if np.delete(np.abs(env.data.qpos - before), own).max() < REST:
            return


def _moved(number: int, name: str, way: Array, later: float, tilt: float) -> Iterator[Defect]:
    """Defects of a thing that went ``way`` from the start on, ``later`` after the settling steps."""
    slid = float(np.linalg.norm(way[:2]))
    if slid > SLID:
        yield Defect(number, "slides", f"{name} slides by {100 * slid:.1f} cm", slid)
    if tilt > TIPPED:
        yield Defect(number, "falls", f"{name} topples by {tilt:.0f}°", tilt)
    elif -way[2] > DROPPED:
        yield Defect(number, "falls", f"{name} falls by {100 * -way[2]:.0f} cm", -float(way[2]))
    if later > MOVING:
        yield Defect(number, "moving", f"{name} still moves by {100 * later:.1f} cm", later)


def _overlaps(env: LiberoEnv) -> dict[tuple[str, str], float]:
    """Depth in metres by the names of two things that begin inside each other."""
    model, contact = env.model, env.data.contact
    names = {body: name for name, body in env.bodies.items()}
    depths: dict[tuple[str, str], float] = {}
    for geoms, gap in zip(contact.geom, contact.dist, strict=True):
        roots = [int(model.body_rootid[model.geom_bodyid[geom]]) for geom in geoms]
        if roots[0] == roots[1] or -gap <= OVERLAP or not set(roots) & set(names):
            continue
        first, second = sorted(names.get(root) or model.body(root).name for root in roots)
        depths[first, second] = max(depths.get((first, second), 0.0), -float(gap))
    return depths
