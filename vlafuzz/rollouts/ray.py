"""Ray executor: evaluates scenes in actors, on this machine or on the machines of a ray cluster."""

import logging
import os
import socket
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import ray
from ray._private import services, worker as driver
from ray.exceptions import RayActorError, RayError

from vlafuzz.errors import PrerequisiteError, UsageError, VlafuzzError
from vlafuzz.model import Outcome
from vlafuzz.rollouts.processes import Make, ProcessExecutor
from vlafuzz.rollouts.worker_pool import TIMEOUT, TRIES, Lost, WorkerPool

REPLY = 5.0  # seconds for a cluster to accept a connection; ray itself tries for minutes
STORE = 100 * 2**20  # bytes of shared memory for our own ray instance: scenes and outcomes are small


class RayExecutor(WorkerPool):
    """Actors that are started once and replaced when they die, each with one worker process.

    The process works under the rules of ``ProcessExecutor``: a crash or a timeout is noticed at once, on whichever
    machine, and the scene is tried once more. When an actor is lost, for instance with its machine, its
    scene is tried once more by another one. UsageError when the cluster is too small, PrerequisiteError when none
    answers.

    Args:
        make: creates an evaluator, in the process; picklable, with its modules on every machine. workers: number of
        actors, each taking one CPU of the cluster.
        address: ``auto`` or host:port of a cluster; None for a new ray instance on this machine. A connection that this
            process already has is used and left open.
        timeout, options: see ``ProcessExecutor``.
    """

    def __init__(
        self, make: Make, workers: int, *, address: str | None = None, timeout: float = TIMEOUT, **options: Any
    ) -> None:
        self._ours = _connect(address, workers)
        super().__init__(partial(_Actor, make, timeout), _wait, workers, **options)
        room = int(ray.cluster_resources().get("CPU", 0))
        if room < workers:
            self.close()
            message = f"--workers {workers}: the ray cluster has {room} CPUs, and every worker takes one"
            raise UsageError(message, f"give --workers {room} or fewer, or add machines with `ray start`")

    def close(self) -> None:
        """End all actors, and the connection if this object opened it."""
        self._kill()
        if self._ours:
            self._ours = False
            ray.shutdown()
        self._after()


class _Actor:
    """A ``Worker`` as the driver sees it: an actor and its pending call."""

    def __init__(self, make: Make, timeout: float) -> None:
        actor: Any = ray.remote(num_cpus=1)(_RemoteWorker)
        self._actor = actor.remote(make, timeout)
        self._allowed = TRIES * (TIMEOUT + timeout)  # seconds, more than its process has
        self.pending: Any = self._actor.greet.remote()

    def ready(self) -> bool:
        return bool(ray.wait([self.pending], timeout=0)[0])

    def begin(self, scene: Any) -> None:
        self.pending = self._actor.evaluate.remote(scene)
        self._began = time.monotonic()

    def answer(self) -> Sequence[Outcome]:
        if not self.ready():
            if time.monotonic() - self._began > self._allowed:
                raise Lost(f"no answer of its actor within {self._allowed:.0f} s")
            return ()
        try:
            result = ray.get(self.pending)
        except RayActorError as error:
            lines = str(error).strip().splitlines()  # the last one may say that its machine lacks a package
            raise Lost(f"its actor died{f': {lines[-1]}' if 'creation task' in lines[0] else ''}") from None
        except RayError as error:
            raise Lost(f"its actor broke: {type(error).__name__}") from None
        if isinstance(result, BaseException):
            raise result
        return (result,)

    def kill(self) -> None:
        ray.kill(self._actor)


class _RemoteWorker:
    """The class of the actors, which runs on the worker's machine and keeps the process that evaluates."""

    def __init__(self, make: Make, timeout: float) -> None:
        if os.environ.get("CUDA_VISIBLE_DEVICES") == "":
            del os.environ["CUDA_VISIBLE_DEVICES"]  # older ray hides GPUs from actors that request none
        self._executor = ProcessExecutor(make, 1, timeout=timeout)

    def greet(self) -> None:
        """Return as soon as the actor exists."""

    def evaluate(self, scene: Any) -> Outcome | BaseException:
        """The outcome, or the error to raise: ray would wrap an exception that is raised here."""
        try:
            ((_, outcome),) = self._executor.run([(0, scene)])
        except (VlafuzzError, KeyboardInterrupt) as error:
            return error
        return outcome


def _wait(workers: Sequence[Any], seconds: float) -> None:
    ray.wait([worker.pending for worker in workers], timeout=seconds)


def _connect(address: str | None, workers: int) -> bool:
    """Connect to ray unless this process is connected already; whether it made a connection."""
    if ray.is_initialized():
        return False
    # Ray prints messages about dead actors to stdout, which is for data; they are reported as outcomes.
    driver.listen_error_messages = lambda *_: None
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    quiet: Any = {"log_to_driver": False, "logging_level": logging.ERROR}
    try:
        if address is None:
            ray.init("local", num_cpus=workers, include_dashboard=False, object_store_memory=STORE, **quiet)
        else:
            bootstrap = services.canonicalize_bootstrap_address(address)
            machine, _, port = (bootstrap or "").rpartition(":")
            socket.create_connection((machine, int(port)), REPLY).close()
            ray.init(bootstrap, **quiet)
    except Exception as error:  # ray raises many types
        why = (str(error) or type(error).__name__).splitlines()[0].partition(". ")[0]
        if address is None:
            raise PrerequisiteError(f"ray does not start here: {why}", hint="--executor processes") from None
        hint = "`ray start --head` starts one; where it has a token, set RAY_AUTH_MODE=token here"
        raise PrerequisiteError(f"--executor ray:{address}: no ray cluster answers: {why}", hint) from None
    return True
