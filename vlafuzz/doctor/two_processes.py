"""Two processes: whether physics, pictures and a policy's answers are the same in both, and what mends it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import closing
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from vlafuzz.doctor import Check
from vlafuzz.doctor.probes import HARDLY, Answers, Moment, ask
from vlafuzz.errors import SimulatorError, VlafuzzError
from vlafuzz.model.conditions import Conditions
from vlafuzz.policies.base import CameraRequest, Policy, PolicySpec
from vlafuzz.policies.harness import WIDTH
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.setup import make_evaluator, stored_space
from vlafuzz.worlds import world_of

TRIED = 30  # scenes until one is fair; of random ones most are
PHYSICS, PICTURES, ANSWERS = "same physics", "same pictures", "same answers"
Pictures = Mapping[str, NDArray[np.uint8]]
Asked = list[list[NDArray[np.float64]]]  # by round, by moment
T = TypeVar("T")


class Rolled(NamedTuple):
    """A scene in one process: the expert's rollout, and the pictures before it by camera."""

    states_hash: str
    actions: NDArray[np.float32]
    pictures: Pictures


def check_simulation(conditions: Conditions, cameras: Sequence[CameraRequest]) -> Iterator[Check]:
    """Whether two processes roll out and draw a scene alike. Seconds, mostly for loading the simulator."""
    try:
        one, other = _twice(partial(roll, conditions, cameras), at_once=True)
    except (VlafuzzError, BrokenExecutor) as error:
        yield _broken(PHYSICS, error)
        return
    yield on_physics(one, other)
    if cameras:
        yield on_pictures(one.pictures, other.pictures)


def check_answers(conditions: Conditions, spec: PolicySpec, moments: Sequence[Moment], *, remote: bool) -> Check:
    """Whether the policy that the conditions name answers alike in two processes, each with its own.

    One process after the other, since a model may need half of the memory; ``remote``: each connects anew.
    """
    try:
        one, other = _twice(partial(answers, conditions, moments), at_once=remote)
    except (VlafuzzError, BrokenExecutor) as error:
        return _broken(ANSWERS, error)
    return on_answers(spec, one, other, remote=remote)


def roll(conditions: Conditions, cameras: Sequence[CameraRequest]) -> Rolled:
    """The first fair scene of the conditions, drawn and rolled out by the world's expert."""
    once = replace(conditions, repeats=1)
    space = stored_space(Path("the run"), conditions)
    with closing(make_evaluator(once, world_of(conditions.task).solvers()["expert"])) as evaluator:
        for number in range(TRIED):
            scene = space.sample(np.random.default_rng([conditions.seed, number]))
            (outcome,) = evaluator.evaluate([scene])
            if outcome.rollouts:
                break
        else:
            raise SimulatorError(f"no rollout: {outcome.detail}", hint="`vlafuzz doctor` checks this machine")
    pictures: Pictures = {}
    if cameras:
        eye = SimpleNamespace(spec=PolicySpec("camera", cameras=tuple(cameras)), close=lambda: None)
        with closing(make_evaluator(once, cast(Policy, eye), checked=False)) as evaluator:
            pictures = evaluator.begin(scene, conditions.seed).observe().images
    rollout = outcome.rollouts[0]
    return Rolled(rollout.states_hash, rollout.actions, pictures)


def answers(conditions: Conditions, moments: Sequence[Moment]) -> Asked:
    """Two answers of the policy to each moment."""
    policy = make_policy(conditions.policy)
    with closing(make_evaluator(conditions, policy)):  # which tells it what it has to know of the world
        return [[ask(policy, [moment])[0] for moment in moments] for _ in range(2)]


def on_physics(one: Rolled, other: Rolled) -> Check:
    steps = min(len(one.actions), len(other.actions))
    if one.states_hash == other.states_hash:
        return Check(PHYSICS, f"all states of {steps} steps are equal in two processes", "ok")
    apart = np.abs(one.actions[:steps] - other.actions[:steps]).max(axis=1)
    since = f"the actions from step {np.argmax(apart > 0)} on, by up to {apart.max():.2g}"
    answered = since if apart.any() else "not the actions that the expert answers to them"
    found = f"the states of {steps} steps differ between two processes; {answered}"
    advice = "replays differ: run both on one kind of processor with one build of simulator and NumPy"
    return Check(PHYSICS, found, "warn", advice)


def on_pictures(one: Pictures, other: Pictures) -> Check:
    apart = {name: np.abs(one[name].astype(int) - other[name]).max(axis=-1) for name in one}
    pixels = sum(picture.size for picture in apart.values())
    changed = sum(int(np.count_nonzero(picture)) for picture in apart.values())
    if not changed:
        return Check(PICTURES, f"all {pixels} pixels are equal in two processes", "ok")
    most = max(int(picture.max()) for picture in apart.values())
    found = f"{changed} of {pixels} pixels differ between two processes, by up to {most} of 255"
    advice = "usually multisampling, or two devices that draw: leave one device visible, update its driver"
    return Check(PICTURES, found, "warn", advice)


def on_answers(spec: PolicySpec, one: Asked, other: Asked, *, remote: bool) -> Check:
    """``remote``: two connections to a server instead of two policies."""
    two = "two connections" if remote else "two processes"
    between = Answers(spec, one[0], other[0])
    itself = Answers(spec, *one).noise.any()
    if not between.noise.any() and not itself:
        detail = f"{two} get the same answers to {len(one[0])} observations"
        return Check(ANSWERS, detail, "ok")
    if not spec.deterministic:
        return Check(ANSWERS, f"it samples, as declared: {_spread(spec, one + other)}", "ok")
    size = between.relative(float(np.mean(between.noise)))
    share = f"{np.count_nonzero(between.noise)} of {len(between.noise)} observations"
    found = f"{two} get different answers to {share}, by {size:.2g} of what differs from moment to moment"
    if remote:
        advice = "the server samples, or batches unlike requests: fix its seed there, or say deterministic=0"
    elif itself:
        advice = "unseeded: it draws from a global generator; seed its own with each rollout's seed in reset"
    elif size < HARDLY:
        advice = "autotuned or parallel kernels: cudnn.benchmark = False, one thread, or say deterministic=False"
    else:
        advice = "it depends on its process: no time, process id or hash() in seeds; PYTHONHASHSEED=0 tells"
    return Check(ANSWERS, found, "warn", advice)


def _spread(spec: PolicySpec, asked: Asked) -> str:
    """How far repeated answers to one moment are spread: the mean standard deviation."""
    steps = min(len(answer) for round_ in asked for answer in round_)
    numbers = np.array([[answer[:steps] for answer in round_] for round_ in asked])
    deviations = numbers.std(axis=0, ddof=1).mean(axis=(0, 1))
    if spec.action.width != WIDTH:
        return f"its actions spread by up to {deviations.max():.2g} (standard deviation)"
    move = 1000 * abs(spec.action.position_scale) * deviations[:3].max()
    turn = abs(spec.action.rotation_scale) * deviations[3:6].max()
    return f"its actions spread by {move:.2g} mm and {np.degrees(turn):.2g}° (standard deviation)"


def _twice(work: Callable[[], T], *, at_once: bool) -> tuple[T, T]:
    """The results of two fresh processes, one after the other if not ``at_once``."""
    context = get_context("spawn")
    with ProcessPoolExecutor(1, context) as one, ProcessPoolExecutor(1, context) as other:
        first = one.submit(work)
        if not at_once:
            first.result()
            one.shutdown()
        second = other.submit(work)
        return first.result(), second.result()


def _broken(check: str, error: Exception) -> Check:
    hint = getattr(error, "hint", None) or "a process of its own may lack memory, or a second connection"
    return Check(check, f"unknown: {' '.join(str(error).split())}", "warn", hint)
