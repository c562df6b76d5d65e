"""SharedRunner: a scene runner for several findings at a time, whose rollouts share calls of the policy."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from vlafuzz.errors import SimulatorError
from vlafuzz.failures.triage.scene_runner import SimulatorSceneRunner
from vlafuzz.model.evidence import Actions, Solver
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene
from vlafuzz.rollouts.lockstep import Seeded

T = TypeVar("T")
R = TypeVar("R")


@dataclass(eq=False)
class _Request:
    """What a thread asks for: rollouts in scenes, or else a call of the runner."""

    scenes: Sequence[Scene] = ()
    numbers: Sequence[int] = ()
    call: Callable[[], Any] | None = None
    future: Future[Any] = field(default_factory=Future)


class SharedRunner:
    """A ``SceneRunner`` for threads, which leave all work with the simulator to the thread that has it."""

    def __init__(self, runner: SimulatorSceneRunner) -> None:
        self.space, self.stages, self.deterministic = runner.space, runner.stages, runner.deterministic
        self.renderer, self._runner = runner.renderer, runner
        self._inbox: SimpleQueue[_Request | None] = SimpleQueue()  # None: a thread is done
        self._rolling: dict[int, _Request] = {}

    def side_by_side(self, function: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
        """Call a function, which uses this runner, for several items at a time; results as they are done."""
        pool = ThreadPoolExecutor(self._runner.lanes)
        futures = [pool.submit(function, item) for item in items]
        for future in futures:
            future.add_done_callback(lambda _: self._inbox.put(None))
        left = list(futures)
        try:
            with closing(self._runner.rollouts(self._batches(futures))) as rolled:
                for tag, outcomes in rolled:
                    self._rolling.pop(tag).future.set_result(outcomes)
                    done = [future for future in left if future.done()]
                    left = [future for future in left if future not in done]
                    yield from (future.result() for future in done)
            yield from (future.result() for future in left)
        finally:
            self._give_up(futures)
            pool.shutdown()

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        outcomes: list[Outcome] = self._ask(_Request(scenes, numbers))
        return outcomes

    def renew(self) -> None:
        """Nothing: several findings share the environments, which keep nothing of earlier scenes."""

    def solve(self, scene: Scene, attempt: int, solver: Solver = "expert") -> Outcome:
        outcome: Outcome = self._call(self._runner.solve, scene, attempt, solver)
        return outcome

    def play(self, scene: Scene, actions: Actions) -> Outcome:
        outcome: Outcome = self._call(self._runner.play, scene, actions)
        return outcome

    def picture(self, scene: Scene) -> bytes | None:
        picture: bytes | None = self._call(self._runner.picture, scene)
        return picture

    def close(self) -> None:
        """Nothing: the owner of the runner closes it."""

    def _call(self, method: Callable[..., Any], *arguments: Any) -> Any:
        return self._ask(_Request(call=partial(method, *arguments)))

    def _ask(self, request: _Request) -> Any:
        self._inbox.put(request)
        return request.future.result()

    def _batches(self, futures: Sequence[Future[Any]]) -> Iterator[Seeded | None]:
        """The rollouts that the threads ask for, until all of them are done; calls are answered at once."""
        tags = count()
        while not all(future.done() for future in futures):
            try:
                request = self._inbox.get(block=not self._rolling)
            except Empty:
                yield None
                continue
            if request is None:
                continue
            if request.call is None:
                tag = next(tags)
                self._rolling[tag] = request
                yield tag, request.scenes, request.numbers
                continue
            try:
                request.future.set_result(request.call())
            except BaseException as error:
                request.future.set_exception(error)
                if not isinstance(error, Exception):  # an interruption ends all
                    raise

    def _give_up(self, futures: Sequence[Future[Any]]) -> None:
        """End the threads that are not done."""
        error = SimulatorError("triage was interrupted", hint="repeat the command to continue")
        for future in futures:
            future.cancel()
        for request in self._rolling.values():
            request.future.set_exception(error)
        self._rolling.clear()
        while not all(future.done() for future in futures):
            if (asked := self._inbox.get()) is not None:
                asked.future.set_exception(error)
