"""Executors by name."""

import importlib.util
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from vlafuzz.errors import PrerequisiteError, UsageError, check_number, install
from vlafuzz.model.conditions import check_choice
from vlafuzz.policies.base import Policy
from vlafuzz.policies.harness import release
from vlafuzz.rollouts.capacity import most_workers
from vlafuzz.rollouts.executor import Executor, LocalExecutor
from vlafuzz.rollouts.lockstep import LockstepExecutor, lanes_for
from vlafuzz.rollouts.policies import is_built_in, is_shared, make_policy
from vlafuzz.rollouts.processes import ProcessExecutor
from vlafuzz.rollouts.shared import SharedPolicy, share
from vlafuzz.rollouts.worker_pool import TIMEOUT
from vlafuzz.worlds.evaluator import SceneEvaluator

EXECUTORS = ("local", "processes", "ray")


@dataclass(frozen=True)
class Place:
    """Where scenes are evaluated. ``executor``: see ``kind``; ``address``: of a ray cluster, None to start one."""

    workers: int = 1
    executor: str | None = None
    address: str | None = None

    @property
    def kind(self) -> str:
        return self.executor or ("local" if self.workers == 1 else "processes")

    def check(self) -> None:
        """Raise UsageError for a wrong flag, PrerequisiteError when ray is not installed."""
        check_number("--workers", self.workers, 1)
        check_choice("executor", self.kind, EXECUTORS)
        if self.kind == "local" and self.workers > 1:
            message = f"--executor local: it has one worker, not {self.workers}"
            raise UsageError(message, hint="--executor processes")
        if self.address not in (None, "auto") and not re.fullmatch(r"[^/:]+:\d{1,5}", self.address or ""):
            message = f"--executor ray:{self.address}: no address of a ray cluster"
            raise UsageError(message, hint="expected ray:auto or ray:HOST:PORT")
        if self.kind == "ray" and importlib.util.find_spec("ray") is None:
            raise PrerequisiteError("--executor ray needs the package 'ray'", install("ray"))


def place_of(workers: int, executor: str | None) -> Place:
    """The place that the flags name: ``ray:ADDRESS`` is a cluster. Errors: see ``Place.check``."""
    kind, _, address = (executor or "").partition(":")
    place = Place(workers, *((kind, address or None) if kind == "ray" else (executor, None)))
    place.check()
    return place


def default_workers(policy: str, most: int | None = None) -> int:
    """Processes for a policy of that name, and for as many tasks at a time as there are at most.

    A policy of the user's own gets one, as it may hold a model of any size. So does one that workers share.
    """
    workers = most_workers() if is_built_in(policy) and not is_shared(policy) else 1
    return workers if most is None else min(workers, most)


def lanes_at(place: Place, policy: Policy) -> int:
    """Scenes at a time in this process: as many as the server of a policy takes in a batch."""
    return lanes_for(policy) if place.kind == "local" else 1


def policy_at(place: Place, name: str, task: str) -> Policy:
    """The policy of that name in a task, or its stand-in when workers share it."""
    if place.kind != "local" and is_shared(name):
        return share(name, everywhere=place.kind == "ray")
    return make_policy(name, task)


def executor_at(place: Place, make: Callable[..., SceneEvaluator], policy: Policy) -> Executor:
    """The executor at that place; PrerequisiteError when no ray cluster answers.

    Args:
        make: creates an evaluator from a policy, or without one from a policy of its own; picklable.
        policy: from ``policy_at``; closed with the executor at the latest.
    """
    if place.kind == "local":
        lanes = lanes_at(place, policy)
        return LockstepExecutor(make, policy, lanes) if lanes > 1 else LocalExecutor(make(policy))
    if isinstance(policy, SharedPolicy):
        return workers_at(place, make, policy)
    release(policy)  # each worker creates its own
    return workers_at(place, make)


def workers_at(place: Place, make: Callable[..., Any], policy: SharedPolicy | None = None, **options: Any) -> Executor:
    """The workers of a place, each with an evaluator of its own; ``policy`` is what they share, if anything."""
    if place.kind == "local":
        return LocalExecutor(make())
    if policy is not None:
        make = partial(make, policy)
        # Workers may wait for each other at every step.
        options |= {"timeout": TIMEOUT * place.workers, "after": policy.close}
    if place.kind == "processes":
        return ProcessExecutor(make, place.workers, **options)
    from vlafuzz.rollouts.ray import RayExecutor  # loads ray

    return RayExecutor(make, place.workers, address=place.address, **options)
