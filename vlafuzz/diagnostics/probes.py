"""Probes: a moment of a real rollout with one thing in it changed, shown to the policy again."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vlafuzz.clients.wire import with_retries
from vlafuzz.diagnostics.recorder import Moment
from vlafuzz.policies.base import Finishing, Observation, Outlines, Policy, PolicySpec
from vlafuzz.policies.harness import blamed_on, check_chunks

Array = NDArray[np.float64]
MOVED = 0.05  # metres along each axis, in proprioception

# What the policy is shown in place of a moment; the second one is of another scene.
Probe = Callable[[Moment, Moment], Moment]
_numbers = itertools.count()


def same(moment: Moment, _: Moment) -> Moment:
    """Nothing is changed."""
    return moment


def black(moment: Moment, _: Moment) -> Moment:
    """The light is off: black pictures, no outlines."""
    images = {name: np.zeros_like(picture) for name, picture in moment.seen.images.items()}
    outlines = moment.seen.outlines and Outlines((), None, moment.seen.outlines.table)
    return _shown(moment, replace(moment.seen, images=images, outlines=outlines))


def noise(moment: Moment, _: Moment) -> Moment:
    """Pictures of noise; the same one again for the same moment."""
    rng = np.random.default_rng([moment.start.seed, moment.seen.step])
    images = {
        name: rng.integers(0, 256, picture.shape, np.uint8) for name, picture in moment.seen.images.items()
    }
    return _shown(moment, replace(moment.seen, images=images))


def elsewhere(moment: Moment, other: Moment) -> Moment:
    """What the eyes see is of another scene."""
    seen = other.seen
    return _shown(
        moment,
        replace(moment.seen, images=seen.images, outlines=seen.outlines, privileged=seen.privileged),
    )


def told(otherwise: Mapping[str, str]) -> Probe:
    """Another instruction: what ``otherwise`` has for it, else the other scene's."""

    def probe(moment: Moment, other: Moment) -> Moment:
        said = otherwise.get(moment.start.instruction, other.start.instruction)
        start, seen = replace(moment.start, instruction=said), replace(moment.seen, instruction=said)
        return replace(moment, start=start, seen=seen)

    return probe


def moved(moment: Moment, _: Moment) -> Moment:
    """Proprioception says that the hand is elsewhere, and closed where it was open."""
    if moment.seen.state is None:
        return moment
    state = moment.seen.state.copy()
    state[:3] += MOVED
    state[6] = 1 - state[6]
    return _shown(moment, replace(moment.seen, state=state))


def sights(spec: PolicySpec) -> Mapping[str, Probe]:
    """What is to be changed for a policy that looks; nothing for one that asks for nothing to look at."""
    if spec.cameras:
        return {"black pictures": black, "noise": noise, "another scene's picture": elsewhere}
    if spec.silhouettes:
        return {"an empty table": black, "another scene's outlines": elsewhere}
    return {"another scene's state": elsewhere} if spec.privileged else {}


def ask(policy: Policy, moments: Sequence[Moment]) -> list[Array]:
    """The policy's answers, in a rollout of its own for each moment; all of them in one call.

    Raises:
        PolicyError: it breaks, and when that is the connection, more than once.
    """
    return with_retries(lambda: _ask(policy, moments))


def _ask(policy: Policy, moments: Sequence[Moment]) -> list[Array]:
    begun = [replace(each.start, episode=f"checkup-{next(_numbers)}") for each in moments]
    shown = [
        replace(each.seen, episode=start.episode, step=0) for each, start in zip(moments, begun, strict=True)
    ]
    try:
        with blamed_on(policy.spec.name):
            policy.reset(begun)
            return check_chunks(policy.act(shown), len(shown), policy.spec.name)
    finally:
        if isinstance(policy, Finishing):
            policy.finish(begun)


def _shown(moment: Moment, seen: Observation) -> Moment:
    return replace(moment, seen=seen)
