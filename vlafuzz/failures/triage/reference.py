"""Reference: the passing scene towards which a failing one is shrunk."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from vlafuzz.failures.triage.contrast import EFFECT
from vlafuzz.failures.triage.oracle import LEAD, Answer, Oracle
from vlafuzz.model import Scene, Space

BACKGROUND = 8  # rollouts of the nominal scene where a policy may fail by chance
FREQUENT = 0.3  # share of them that fail, or rollouts of the finding that pass, from which on cheap answers would err
LEAST = 0.3  # above the background, that a failing scene is taken to fail: less than 0.2 makes no cause
SUREST = 0.98  # rate of a scene that failed whenever it was tried
NEAREST = 6  # passing scenes that are tried where the nominal one fails


class Reference(NamedTuple):
    """Where shrinking goes.

    Attributes:
        scene: that passes; None for the nominal one.
        stages: those of which none is lost there: all, or those up to the finding's.
    """

    scene: Scene | None
    stages: tuple[str, ...]


def find_reference(scene: Scene, oracle: Oracle, space: Space, passing: Iterable[Scene]) -> Reference | None:
    """The nominal scene of the same targets if it passes, else the nearest scene known to pass.

    If there is none, but the nominal scene fails at a later stage than the finding, the nominal scene serves, since
    what makes the policy fail earlier is a cause of its own. Else there is no reference: the finding has no cause.

    Args:
        passing: scenes in which the policy has passed; those of other targets are tried with the finding's.
    """
    usual = Reference(None, oracle.stages)
    nominal = space.nominal(like=scene)
    if oracle.lead > 1 and _expect_background(scene, nominal, oracle):
        return usual
    answer = oracle.answers([nominal], oracle.stages, lead=LEAD)[0]
    if answer in (Answer.PASSES, Answer.UNTRIED):
        return usual
    for candidate in _nearest(scene, space, passing)[:NEAREST]:
        if oracle.answers([candidate], oracle.stages, lead=LEAD)[0] is Answer.PASSES:
            return Reference(candidate, oracle.stages)
    if answer is not Answer.FAILS:
        return usual  # whose operators may still be reset one by one
    later = oracle.answers([nominal])[0] is Answer.PASSES
    return Reference(None, oracle.counted) if later else None


def _expect_background(scene: Scene, nominal: Scene, oracle: Oracle) -> bool:
    """Let the oracle expect failures of the nominal scene, or passes of the finding, where this has clearly more."""
    usual, found = oracle.repeated(nominal, BACKGROUND, oracle.stages), oracle.rate(scene).share
    if (usual.share < FREQUENT and found > 1 - FREQUENT) or found - usual.share < EFFECT:
        return False
    oracle.expect(usual.share, min(max(found, usual.share + LEAST), SUREST))
    return True


def _nearest(scene: Scene, space: Space, passing: Iterable[Scene]) -> Sequence[Scene]:
    """The passing scenes with the targets of another one, the most similar to it first."""
    values, place = space.values(scene), space.embed(scene)
    targets = {gene.path: values[gene.path] for gene in space.genes if gene.operator == space.subject}
    composed = set()
    for candidate in passing:
        known = space.values(candidate)
        if candidate.task == scene.task and not any(map(math.isnan, known.values())):
            composed.add(space.compose(known | targets))
    distances = {other: float(np.linalg.norm(space.embed(other) - place)) for other in composed - {scene}}
    return sorted(distances, key=lambda other: (distances[other], other.digest))
