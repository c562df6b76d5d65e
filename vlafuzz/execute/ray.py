"""RayExecutor: scenes are evaluated by actors, on this machine or on those of a ray cluster."""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import ray
from ray._private import services
from ray._private import worker as driver
from ray.exceptions import RayActorError, RayError

from vlafuzz.errors import PrerequisiteError, UsageError, VlafuzzError
from vlafuzz.execute.processes import ProcessExecutor, share
from vlafuzz.execute.worker_pool import LOOK, TIMEOUT, TRIES, Lost, WorkerPool
from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene
from vlafuzz.sim.base import Evaluator

REPLY = 5.0  # seconds for a cluster to take a connection; ray itself tries for minutes
STORE = 100 * 2**20  # bytes of shared memory for a ray of our own: scenes and outcomes are small


class RayExecutor:
    """Actors that are started once and replaced when they die, each with one worker process.

    The process does the work under the rules of ``ProcessExecutor``: whatever a scene does to it (death, no
    answer, memory) is noticed on the spot, on whichever machine, and costs the scene one more try. A batch
    whose actor is lost, as a machine can be, is tried once more by another one.

    Args:
        make: makes an evaluator, in the process; picklable, and its modules are on every machine.
        workers: number of actors, each of which takes one CPU of the cluster.
        address: ``auto`` or host:port of a cluster; None for a ray of our own on this machine. Where this
            process is connected to one already, that is used and left as it is.
        timeout, memory, after: see ``ProcessExecutor``.

    Raises:
        UsageError: the cluster is too small.
        PrerequisiteError: no cluster answers.
    """

    def __init__(
        self,
        make: Callable[[], Evaluator],
        workers: int,
        *,
        address: str | None = None,
        timeout: float = TIMEOUT,
        memory: int | None = None,
        after: Callable[[], None] = lambda: None,
    ) -> None:
        self._ours = _connect(address, workers)
        hire = partial(_Actor, make, timeout, memory, workers)
        self._crew, self._after = WorkerPool(hire, _wait, workers), after
        room = int(ray.cluster_resources().get("CPU", 0))
        if room < workers:
            self.close()
            raise UsageError(
                f"--workers {workers}: the ray cluster has {room} CPUs, and every worker takes one",
                hint=f"give --workers {room} or fewer, or add machines with `ray start`",
            )

    def run(self, batches: Iterable[tuple[int, Sequence[Scene]]]) -> Iterator[tuple[int, list[Outcome]]]:
        """See ``Executor``."""
        return self._crew.run(batches)

    def close(self) -> None:
        """End all actors, and the connection if it is ours."""
        self._crew.kill()
        if self._ours:
            self._ours = False
            ray.shutdown()
        self._after()


class _Actor:
    """A worker, seen from here: an actor and what it was last asked."""

    def __init__(
        self, make: Callable[[], Evaluator], timeout: float, memory: int | None, workers: int
    ) -> None:
        hand: Any = ray.remote(num_cpus=1)(_Hand)
        self._actor = hand.remote(make, timeout, memory, workers)
        self._timeout = timeout
        self.asked: Any = self._actor.greet.remote()

    def ready(self) -> bool:
        """See ``Worker``."""
        return bool(ray.wait([self.asked], timeout=0)[0])

    def begin(self, scenes: Sequence[Scene]) -> None:
        """See ``Worker``."""
        self.asked = self._actor.evaluate.remote(list(scenes))
        self._allowed = TRIES * (TIMEOUT + self._timeout * max(len(scenes), 1))  # its process has less
        self._began = time.monotonic()

    def answer(self) -> list[Outcome] | None:
        """See ``Worker``."""
        if not self.ready():
            if time.monotonic() - self._began > self._allowed:
                raise Lost(f"no answer of its actor within {self._allowed:.0f} s")
            return None
        try:
            told = ray.get(self.asked)
        except RayActorError as error:
            raise Lost(f"its actor died{_unmade(error)}") from None
        except RayError as error:
            raise Lost(f"its actor broke: {type(error).__name__}") from None
        if isinstance(told, BaseException):
            raise told
        return told  # type: ignore[no-any-return]

    def kill(self) -> None:
        """See ``Worker``."""
        ray.kill(self._actor)


class _Hand:
    """A worker, where it works: keeps the process that evaluates."""

    def __init__(
        self, make: Callable[[], Evaluator], timeout: float, memory: int | None, workers: int
    ) -> None:
        if os.environ.get("CUDA_VISIBLE_DEVICES") == "":  # older ray's, for actors that ask for no GPU
            del os.environ["CUDA_VISIBLE_DEVICES"]  # but pictures are rendered with one
        beside = min(workers, os.cpu_count() or 1)  # so many may be on this machine
        self._executor = ProcessExecutor(make, 1, timeout=timeout, memory=memory or share(beside))

    def greet(self) -> None:
        """It is there."""

    def evaluate(self, scenes: list[Scene]) -> list[Outcome] | BaseException:
        """Outcomes, or what the user has to mend first: ray would wrap what is raised."""
        try:
            ((_, outcomes),) = self._executor.run([(0, scenes)])
        except (VlafuzzError, KeyboardInterrupt) as error:
            return error
        return outcomes


def _unmade(error: RayActorError) -> str:
    """Why it could not even be made, as where a machine lacks a package."""
    lines = str(error).strip().splitlines()
    return f": {lines[-1]}" if "creation task" in lines[0] else ""


def _wait(workers: Sequence[Any]) -> None:
    ray.wait([worker.asked for worker in workers], timeout=LOOK)


def _connect(address: str | None, workers: int) -> bool:
    """Whether this made a connection; False where there was one."""
    if ray.is_initialized():
        return False
    # What it tells of dead actors goes to stdout, which is for data; who asks for outcomes hears of them.
    driver.listen_error_messages = lambda *_: None
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    quiet: Any = {"log_to_driver": False, "logging_level": logging.ERROR}
    try:
        if address is None:
            ray.init("local", num_cpus=workers, include_dashboard=False, object_store_memory=STORE, **quiet)
        else:
            found = services.canonicalize_bootstrap_address(address)
            host, _, port = (found or "").rpartition(":")
            socket.create_connection((host, int(port)), REPLY).close()
            ray.init(found, **quiet)
    except Exception as error:  # it raises whatever it meets on the way
        told = (str(error) or type(error).__name__).splitlines()[0].partition(". ")[0]
        if address is None:
            raise PrerequisiteError(f"ray does not start here: {told}", hint="--executor processes") from None
        raise PrerequisiteError(
            f"--address {address}: no ray cluster answers: {told}",
            hint="`ray start --head` starts one; where it has a token, set RAY_AUTH_MODE=token here",
        ) from None
    return True
