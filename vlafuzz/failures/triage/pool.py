"""PooledRunner: a scene runner whose rollouts are spread over processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

from vlafuzz.common.plugins import check_trusted, trust
from vlafuzz.errors import SimulatorError, UsageError
from vlafuzz.failures.triage.runner import SceneRunner
from vlafuzz.model.evidence import Actions, Solver
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene
from vlafuzz.rollouts.policies import is_shared
from vlafuzz.rollouts.registry import Place
from vlafuzz.rollouts.shared import share
from vlafuzz.rollouts.worker_pool import TRIES, Lost
from vlafuzz.store.records import Run

Make = Callable[..., SceneRunner]
"""Makes the scene runner of a run, with the argument ``policy`` where workers share its policy."""


@contextmanager
def pooled_runner(pool: Executor, make: Make, run: Run, place: Place) -> Iterator[PooledRunner]:
    """The runner of a run whose rollouts a pool at that place shares, and one policy where it says so."""
    name = run.manifest.policy
    check_trusted(name)  # before its code is loaded; workers elsewhere do not know what the user trusts
    shared = False
    with suppress(UsageError):  # for a name that is none, which ``make`` says in its own sentence
        shared = is_shared(name)
    if not shared:
        yield PooledRunner(pool, make, run)
        return
    policy = share(name, everywhere=place.kind == "ray")
    try:
        yield PooledRunner(pool, partial(make, policy=policy), run)
    finally:
        policy.close()


class PooledRunner:
    """A ``SceneRunner`` for the findings of a run. Threads may share it: batches of several findings mix.

    Args:
        make: makes the scene runner of a run, once in every process; picklable.

    Attributes:
        renderer: as that of the processes' runners; None where they have none.
    """

    def __init__(self, pool: Executor, make: Make, run: Run) -> None:
        self._pool, self._make, self._run = pool, make, run
        about = pool.submit(_about, make, run).result()
        self.space, self.stages, self.deterministic, self.renderer = about

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        rolled = [self._submit("evaluate", [scene], [number]) for scene, number in zip(scenes, numbers, strict=True)]
        return [outcome for future in rolled for outcome in future.result()]

    def renew(self) -> None:
        """Nothing: several findings share the environments, which keep nothing of earlier scenes."""

    def solve(self, scene: Scene, attempt: int, solver: Solver = "expert") -> Outcome:
        outcome: Outcome = self._submit("solve", scene, attempt, solver).result()
        return outcome

    def play(self, scene: Scene, actions: Actions) -> Outcome:
        outcome: Outcome = self._submit("play", scene, actions).result()
        return outcome

    def picture(self, scene: Scene) -> bytes | None:
        picture: bytes | None = self._submit("picture", scene).result()
        return picture

    def close(self) -> None:
        """Nothing: the pool's owner closes it."""

    def _submit(self, method: str, *arguments: Any) -> Future[Any]:
        return self._pool.submit(_call, self._make, self._run, method, arguments)


_runners: dict[int, SceneRunner] = {}  # of a worker process, by run


def _runner(make: Make, run: Run) -> SceneRunner:
    """The scene runner of a worker process, which keeps that of the last run only."""
    if run.id not in _runners:
        for runner in _runners.values():
            runner.close()
        _runners.clear()
        trust(run.manifest.policy)
        _runners[run.id] = make(run)
    return _runners[run.id]


def _about(make: Make, run: Run) -> tuple[Any, ...]:
    runner = _runner(make, run)
    return runner.space, runner.stages, runner.deterministic, getattr(runner, "renderer", None)


def _call(make: Make, run: Run, method: str, arguments: tuple[Any, ...]) -> Any:
    """Call a method of the worker's runner, once more with a new one where the shared policy died."""
    for _ in range(TRIES):
        try:
            return getattr(_runner(make, run), method)(*arguments)
        except Lost as cause:
            problem = f"{cause}, {TRIES} times; finished findings are stored"
            _runners.clear()
    raise SimulatorError(problem, hint="repeat the command to continue")
