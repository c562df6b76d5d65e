"""Whether what a task says of its start is true: the problem's predicates, and where the instruction points.

Judged after the settling steps, when things have come down: LIBERO's own predicates need contact.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.scenes.objects import kind_of
from vlafuzz.worlds.libero.suites import PLACING, Atom

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


def broken_premises(env: LiberoEnv, *, regions: bool = True) -> Iterator[str]:
    """What the task says of its start and is not true now, one sentence each.

    ``regions``: whether things must be in the parts of table or floor that the suite gives them.
    """
    for atom in env.task.initial:
        if (regions or not _is_floor(env, atom)) and not _holds(env, atom):
            yield f"{' '.join(atom[1:2])} is not {atom[0]} {' '.join(atom[2:])}".strip()
    yield from _misleading(env)


def _holds(env: LiberoEnv, atom: Atom) -> bool:
    """LIBERO's own judgement, with slack.

    Its regions of tables and floors have no contact, and those of furniture are a little beside or above it.
    """
    if _is_floor(env, atom):
        return bool((_outside(env, atom)[:2] <= OUTSIDE).all())
    if env.holds(atom):
        return True
    place = env.robosuite.object_sites_dict.get(atom[-1])
    if atom[0] != "on" or place is None or (_outside(env, atom) > OUTSIDE).any():
        return False
    return _touches(env, atom[1], place.parent_name)


def _outside(env: LiberoEnv, atom: Atom) -> NDArray[np.float64]:
    """``(3,)`` metres from the borders of a region to something, along the region's axes; negative inside."""
    site = env.data.site(atom[-1])
    way = site.xmat.reshape(3, 3).T @ (_position(env, atom[1]) - site.xpos)
    return np.asarray(np.abs(way) - env.model.site_size[site.id])


def _is_floor(env: LiberoEnv, atom: Atom) -> bool:
    """Whether a predicate places something in a region of table or floor."""
    place = env.robosuite.object_sites_dict.get(atom[-1])
    return atom[0] in PLACING and place is not None and not getattr(place, "parent_name", None)


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
    """How badly words fit where something is: 0 perfectly, from 1 on not at all."""
    place, first = _position(env, name), _position(env, anchors[0])
    if relation == "between" and len(anchors) == 2:
        second = _position(env, anchors[1])
        line = (second - first)[:2]
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


def _position(env: LiberoEnv, name: str) -> NDArray[np.float64]:
    return np.asarray(env.data.xpos[env.bodies[name]])
