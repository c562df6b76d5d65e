"""Defects of what LIBERO's environment is in: it should be at rest, unsolved, and as the task says.

What a task says of its start, by the problem's predicates and by where the instruction points, is judged after the
settling steps, when things have come down: LIBERO's own predicates need contact.
"""

import re
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.worlds.libero.casts import kind_of
from vlafuzz.worlds.libero.env import HZ, LiberoEnv
from vlafuzz.worlds.libero.suites import PLACING, SETTLING, Atom

STEPS = 2 * HZ  # for which the robot keeps still
OVERLAP = 0.005  # metres
SLID = 0.01  # metres sideways; straight down is no defect: all of LIBERO's objects begin in the air
MOVING = 0.005  # metres, after the settling steps
TIPPED = 20.0  # degrees
DROPPED = 0.25  # metres: from a table to the floor
LULL, REST = 5, 3e-5  # control steps in which nothing moves by so much (metres, radians): it has come to rest
# "next to the plate", "between the plate and the ramekin", "in the top drawer of the wooden cabinet"
_WHERE = re.compile(
    r"pick up the .+? (?P<relation>between|next to|on|in) the "
    r"(?P<first>.+?)( and the (?P<second>.+?))? and place it"
)
# Words of instructions that objects' names do not have.
_WORDS = {"cookie": "cookies", "box": "cookies"}
BESIDE = 0.25  # metres between two centres, for "next to"
ASIDE = 0.1  # metres from the line between two things, for "between"
CLEAR = 0.6  # share of these bounds: what is so near fits the words, too, if not better than the target
OUTSIDE = 0.02  # metres beyond a region's border, which LIBERO's own states reach


class Defect(NamedTuple):
    """A defect of a state: the check that found it, and a sentence with its amount.

    ``overlaps``: two things begin inside each other; ``slides``, ``falls``: something moves while the robot keeps
    still; ``moving``: still so after the settling steps; ``solved``: the goal holds at the start; ``premise``: what
    problem or instruction say of the start is not true; ``region``: the same of a part of table or floor.
    """

    check: str
    reason: str

    @property
    def kind(self) -> tuple[str, str]:
        """The check and the things that it is about, without the amount."""
        return self.check, self.reason.split(" by ")[0]


def defects(env: LiberoEnv, begin: Callable[[], None]) -> Iterator[Defect]:
    """All defects of a state, as ``begin`` sets it up; those that cost least come first."""
    names = env.movable
    bodies = [env.bodies[name] for name in names]
    begin()
    start, upright, solved = env.data.xpos[bodies].copy(), _upward(env, bodies), env.solved()
    for pair, depth in _overlaps(env).items():
        yield Defect("overlaps", f"{' and '.join(pair)} overlap by {1000 * depth:.0f} mm")
    env.settle(SETTLING)
    seen, solved = env.data.xpos[bodies].copy(), solved or env.solved()
    yield from broken_premises(env)
    _come_to_rest(env, STEPS - SETTLING)
    if solved or env.solved():
        yield Defect("solved", "the goal holds at the start")
    end = env.data.xpos[bodies].copy()
    tilts = np.degrees(np.arccos(np.clip((upright * _upward(env, bodies)).sum(axis=1), -1.0, 1.0)))
    for name, way, later, tilt in zip(names, end - start, end - seen, tilts.tolist(), strict=True):
        yield from _moved(name, way, float(np.linalg.norm(later)), tilt)


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


def _moved(name: str, way: Array, later: float, tilt: float) -> Iterator[Defect]:
    """Defects of a thing that went ``way`` from the start on, ``later`` after the settling steps."""
    slid = float(np.linalg.norm(way[:2]))
    if slid > SLID:
        yield Defect("slides", f"{name} slides by {100 * slid:.1f} cm")
    if tilt > TIPPED:
        yield Defect("falls", f"{name} topples by {tilt:.0f}°")
    elif -way[2] > DROPPED:
        yield Defect("falls", f"{name} falls by {100 * -way[2]:.0f} cm")
    if later > MOVING:
        yield Defect("moving", f"{name} still moves by {100 * later:.1f} cm")


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


def broken_premises(env: LiberoEnv) -> Iterator[Defect]:
    """The statements of the task about its start that are not true now."""
    for atom in env.task.initial:
        place = env.robosuite.object_sites_dict.get(atom[-1]) if atom[0] in PLACING else None
        bare = place is not None and not getattr(place, "parent_name", None)  # a part of table or floor: no contact
        if (_outside(env, atom)[:2] > OUTSIDE).any() if bare else not _holds(env, atom, place):
            reason = f"{' '.join(atom[1:2])} is not {atom[0]} {' '.join(atom[2:])}".strip()
            yield Defect("region" if bare else "premise", reason)
    for reason in _misleading(env):
        yield Defect("premise", reason)


def _holds(env: LiberoEnv, atom: Atom, place: Any) -> bool:
    """LIBERO's own judgement, with slack: its regions of furniture are a little aside or above it."""
    if env.holds(atom):
        return True
    if atom[0] != "on" or place is None or (_outside(env, atom) > OUTSIDE).any():
        return False
    return _touches(env, atom[1], place.parent_name)


def _outside(env: LiberoEnv, atom: Atom) -> Array:
    """``(3,)`` metres from the borders of a region to something, along the region's axes; negative inside."""
    site = env.data.site(atom[-1])
    way = site.xmat.reshape(3, 3).T @ (env.place(atom[1]) - site.xpos)
    return np.asarray(np.abs(way) - env.model.site_size[site.id])


def _misleading(env: LiberoEnv) -> Iterator[str]:
    """Where the target is not where the instruction says, or something of its kind is there instead."""
    found = _WHERE.search(env.task.instruction)
    if not (found and env.task.carried):
        return
    target = env.task.carried[0]
    anchors = [_named(env, found[part], target) for part in ("first", "second") if found[part]]
    if None in anchors:
        return
    relation, known = found["relation"], [anchor for anchor in anchors if anchor]
    words = f"{relation} the {' and the '.join(found[part] for part in ('first', 'second') if found[part])}"
    own = _misfit(env, relation, target, known)
    if own >= 1.0:
        yield f"{target} is not {words}, as the instruction says"
    for other in env.movable:
        alike = other != target and kind_of(other) == kind_of(target)
        if alike and relation != "in" and _misfit(env, relation, other, known) < min(max(own, CLEAR), 1.0):
            yield f"{other} is {words}, too"


def _misfit(env: LiberoEnv, relation: str, name: str, anchors: list[str]) -> float:
    """How badly words fit the place of a thing: 0 perfectly, from 1 on not at all."""
    place, first = env.place(name), env.place(anchors[0])
    if relation == "between" and len(anchors) == 2:
        line = (env.place(anchors[1]) - first)[:2]
        share = float((place - first)[:2] @ line / (line @ line))
        aside = float(np.linalg.norm((place - first)[:2] - share * line))
        return aside / ASIDE if 0.0 < share < 1.0 else np.inf
    if relation == "next to":
        on = env.holds(("on", name, anchors[0]))  # what touches it at its rim only is next to it
        return np.inf if on else float(np.linalg.norm((place - first)[:2])) / BESIDE
    return 0.0 if _touches(env, name, anchors[0]) else np.inf


def _touches(env: LiberoEnv, name: str, anchor: str) -> bool:
    get = env.robosuite.get_object
    return bool(env.robosuite.check_contact(get(name), get(anchor)))


def _named(env: LiberoEnv, words: str, target: str) -> str | None:
    """The thing that words of an instruction mean, or None."""
    wanted = {_WORDS.get(word, word) for word in words.split()}
    things = [name for name in env.bodies if name != target]
    shared = {name: len(wanted & set(name.split("_"))) for name in things}
    best = max(shared, key=lambda name: shared[name], default=None)
    return best if best and shared[best] else None
