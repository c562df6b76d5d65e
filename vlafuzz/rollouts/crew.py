"""Crews: scene runners for work on several things at a time, in this process, in others, or on ray."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from functools import partial
from itertools import count
from operator import methodcaller
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple, cast

from vlafuzz.common.plugins import check_trusted, trust
from vlafuzz.errors import SimulatorError, UsageError
from vlafuzz.model import Actions, Outcome, Scene, Solver, Space
from vlafuzz.policies.base import Policy
from vlafuzz.rollouts.executor import Tagged
from vlafuzz.rollouts.policies import is_shared
from vlafuzz.rollouts.registry import Place, workers_at
from vlafuzz.rollouts.scene_runner import SceneRunner, SimulatorSceneRunner
from vlafuzz.rollouts.shared import share

Make = Callable[..., SceneRunner]
"""Makes a scene runner, with the argument ``policy`` where workers share one; picklable where there are workers."""
Each = Callable[[Callable[[Any], Any], Sequence[Any]], Iterator[tuple[int, Any]]]
"""Calls a function, which uses the crew's runner, for several items: numbered results in the order of completion."""
Item = tuple[Scene, int] | Callable[[SceneRunner], Any]
"""A scene with the number of its rollout, or another call of a runner."""


class Crew(NamedTuple):
    """A scene runner, and what makes use of it for as many items at a time as the place has room for."""

    runner: SceneRunner
    each: Each


@contextmanager
def crew_at(place: Place, make: Make, policy: str) -> Iterator[Crew]:
    """The crew of a place, for runs of a policy of that name; a SimulatorError where no worker stays alive."""
    if place.kind == "local":
        with closing(make()) as runner:
            if isinstance(runner, SimulatorSceneRunner) and runner.lanes > 1:
                shared = SharedRunner(runner.run, _about(runner), runner.lanes, here=runner)
                yield Crew(shared, shared.each)
            else:
                yield Crew(runner, lambda function, items: enumerate(map(function, items)))
        return
    check_trusted(policy)  # before its code is loaded; workers elsewhere do not know what the user trusts
    several = False
    with suppress(UsageError):  # for a name that is none, which ``make`` says in its own sentence
        several = is_shared(policy)
    together = share(policy, everywhere=place.kind == "ray") if several else None
    with closing(workers_at(place, partial(_Desk, make, policy), together)) as executor:
        about: Any = dict(executor.run([(0, _about)]))[0]
        if isinstance(about, Outcome):
            problem = f"{about.detail.removeprefix('worker: ')}: finished findings are stored"
            raise SimulatorError(f"a worker {problem}", hint="repeat the command to continue")
        shared = SharedRunner(executor.run, about, place.workers)
        yield Crew(shared, shared.each)


def _about(runner: SceneRunner) -> tuple[Space, tuple[str, ...], bool, str | None]:
    """What is known of a runner without a rollout."""
    return runner.space, runner.stages, runner.deterministic, getattr(runner, "renderer", None)


class _Desk:
    """In a worker: the evaluator of ``Item``s."""

    def __init__(self, make: Make, name: str, policy: Policy | None = None) -> None:
        trust(name)
        self._runner = make() if policy is None else make(policy=policy)

    def evaluate(self, items: Sequence[Item]) -> list[Any]:
        (item,) = items
        return self._runner.evaluate([item[0]], [item[1]]) if isinstance(item, tuple) else [item(self._runner)]

    def close(self) -> None:
        self._runner.close()


class SharedRunner:
    """A ``SceneRunner`` for threads, which leave all work with simulators to the thread that has the executor.

    Args:
        run: see ``Executor``; of tagged ``Item``s.
        at_once: threads.
        here: a runner of this process for what is no rollout of the policy; None where the executor takes that, too.
    """

    def __init__(
        self,
        run: Callable[[Tagged], Any],
        about: tuple[Space, tuple[str, ...], bool, str | None],
        at_once: int,
        *,
        here: SceneRunner | None = None,
    ) -> None:
        self.space, self.stages, self.deterministic, self.renderer = about
        self._run, self._at_once, self._here = run, at_once, here
        self._inbox: SimpleQueue[tuple[Item, Future[Any]] | None] = SimpleQueue()  # None: a thread is done
        self._open: dict[int, Future[Any]] = {}

    def each(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """See ``Each``. Where the caller stops, the executor does, too."""
        pool = ThreadPoolExecutor(self._at_once)
        numbers = {pool.submit(function, item): number for number, item in enumerate(items)}
        futures = list(numbers)
        for future in futures:
            future.add_done_callback(lambda _: self._inbox.put(None))
        try:
            with closing(self._run(self._items(futures))) as rolled:
                for tag, result in rolled:
                    self._open.pop(tag).set_result(result)
                    yield from _done(numbers)
            yield from _done(numbers)
        finally:
            self._give_up(futures)
            pool.shutdown()

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        asked = [self._ask(item) for item in zip(scenes, numbers, strict=True)]
        return [future.result() for future in asked]

    def solve(self, scene: Scene, attempt: int, solver: Solver = "expert") -> Outcome:
        return cast(Outcome, self._ask(methodcaller("solve", scene, attempt, solver)).result())

    def play(self, scene: Scene, actions: Actions) -> Outcome:
        return cast(Outcome, self._ask(methodcaller("play", scene, actions)).result())

    def close(self) -> None:
        """Nothing: the owner of the executor closes it."""

    def _ask(self, item: Item) -> Future[Any]:
        future = Future[Any]()
        self._inbox.put((item, future))
        return future

    def _items(self, futures: Sequence[Future[Any]]) -> Iterator[tuple[int, Item] | None]:
        """What the threads ask for, until all of them are done."""
        tags = count()
        while not all(future.done() for future in futures):
            try:
                request = self._inbox.get(block=not self._open)
            except Empty:
                yield None
                continue
            if request is None:
                continue
            item, future = request
            if self._here is None or isinstance(item, tuple):
                tag = next(tags)
                self._open[tag] = future
                yield tag, item
                continue
            try:
                future.set_result(item(self._here))
            except BaseException as error:
                future.set_exception(error)
                if not isinstance(error, Exception):  # an interruption ends all
                    raise

    def _give_up(self, futures: Sequence[Future[Any]]) -> None:
        error = SimulatorError("the work was interrupted", hint="repeat the command to continue")
        for future in futures:
            future.cancel()
        for asked in self._open.values():
            asked.set_exception(error)
        self._open.clear()
        while not all(future.done() for future in futures):
            if (request := self._inbox.get()) is not None:
                request[1].set_exception(error)


def _done(numbers: dict[Future[Any], int]) -> Iterator[tuple[int, Any]]:
    """Number and result of what is done, which is taken out."""
    for future in [future for future in numbers if future.done()]:
        yield numbers.pop(future), future.result()
