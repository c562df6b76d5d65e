"""Demonstrations: the expert's solutions, kept in the store, and shown as a policy would see them."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.exports.expert_runner import UNFAIR, ExpertRunner
from vlafuzz.exports.packed import Packed, packed
from vlafuzz.exports.selection import Wanted
from vlafuzz.model.conditions import Role
from vlafuzz.policies.clients.interface import interface_of
from vlafuzz.rollouts.calls import process_pool
from vlafuzz.store.records import Manifest, Solution
from vlafuzz.store.store import Store
from vlafuzz.worlds import place, provenance, world_of

UNSOLVED = "the expert does not solve it"
UNPLAYED = "a replay of the expert's actions does not solve it"
IN_FLIGHT = 4  # scenes for each worker, so that what is recorded does not pile up
Answer = Solution | str  # or why there is none
Each = Callable[[Callable[[Any], Any], Sequence[Any]], Iterator[tuple[int, Any]]]


@dataclass(frozen=True, eq=False)
class Solved:
    """A scene, and the actions that solve it as the policy of its run would write them."""

    wanted: Wanted
    solution: Solution


@dataclass
class Demonstrations:
    """Solves scenes and shows the solutions, in several processes.

    Args:
        store: open to write, where solutions are kept; None to keep none.

    Attributes:
        left_out: number of scenes that were tried in vain, by reason.
        known: solutions that the store had already.
    """

    store: Store | None = None
    workers: int = 1
    watch: Watch = SILENT
    left_out: Counter[str] = field(default_factory=Counter)
    known: int = 0

    def solved(self, wanted: Iterator[Wanted], number: int, most: int) -> list[Solved]:
        """The first ``number`` scenes that the expert solves, of ``most`` that it tries, in order."""
        tried, solved = islice(wanted, most), list[Solved]()
        with _crew(self.workers) as each:
            while missing := list(islice(tried, number - len(solved))):
                answers = self._answers(missing, each)
                solved += filter(None, map(self._judged, missing, answers))
        return solved

    def shown(self, solved: Sequence[Solved]) -> Iterator[Packed]:
        """What the policies would see and do, in order.

        Raises:
            PrerequisiteError: rendering does not work here.
        """
        early: dict[int, Packed | None] = {}
        following = 0
        with _crew(self.workers) as each:
            for done, (index, shown) in enumerate(each(_show, solved), start=1):
                self.watch.progress("demonstrations recorded", done, len(solved))
                early[index] = shown
                while following in early:
                    shown = early.pop(following)
                    following += 1
                    if shown is None:
                        self.left_out[UNPLAYED] += 1
                    else:
                        yield shown

    def _answers(self, wanted: Sequence[Wanted], each: Each) -> list[Answer]:
        """The expert's answer to every scene; what the store does not know is kept there."""
        keys = [_key(one.run) for one in wanted]
        known = {key: self.store.solutions(key) if self.store else {} for key in set(keys)}
        answers: list[Answer | None] = [
            _fitting(known[key].get(one.scene.digest), one.run) for key, one in zip(keys, wanted, strict=True)
        ]
        open_ = [index for index, answer in enumerate(answers) if answer is None]
        self.known += len(answers) - len(open_)
        for done, (number, answer) in enumerate(each(_solve, [wanted[index] for index in open_]), start=1):
            index = open_[number]
            answers[index] = answer
            if self.store and isinstance(answer, Solution):
                self.store.keep_solution(keys[index], wanted[index].scene, answer)
            self.watch.progress("scenes tried by the expert", done, len(open_))
        return [answer for answer in answers if answer is not None]

    def _judged(self, wanted: Wanted, answer: Answer) -> Solved | None:
        if isinstance(answer, Solution) and answer.attempt is not None:
            return Solved(wanted, answer)
        reason = answer if isinstance(answer, str) else UNSOLVED
        if reason != UNFAIR or wanted.finding:  # random scenes are drawn until they are fair
            self.left_out[reason] += 1
        return None


def _fitting(solution: Solution | None, run: Manifest) -> Solution | None:
    """A stored solution, unless its actions have another number of values than those of the run's policy."""
    if solution is None or solution.actions.shape[1] != len(interface_of(run.policy, run.spec).action_names):
        return None
    return solution


def _key(run: Manifest) -> str:
    """Identifies all that decides the expert's actions in a scene, beside the scene."""
    world = world_of(run.task)
    here = {
        "versions": provenance.versions(),
        "place": place.here("expert", world.solvers()["expert"].spec, world.renderer),
    }
    text = json.dumps([run.task, run.values(Role.SIMULATION), interface_of(run.policy, run.spec).key, here])
    return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()


@contextmanager
def _crew(workers: int) -> Iterator[Each]:
    """What calls a function for several items, and numbers the results as they are done."""
    if workers > 1:
        with process_pool(workers) as pool:
            yield lambda function, items: _spread(pool, workers, function, items)
        return
    try:
        yield lambda function, items: enumerate(map(function, items))
    finally:
        for runner in _runners.values():
            runner.close()
        _runners.clear()


def _spread(
    pool: Executor, workers: int, function: Callable[[Any], Any], items: Sequence[Any]
) -> Iterator[tuple[int, Any]]:
    running: dict[Future[Any], int] = {}
    todo = iter(enumerate(items))
    while True:
        for index, item in islice(todo, IN_FLIGHT * workers - len(running)):
            running[pool.submit(function, item)] = index
        if not running:
            return
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            yield running.pop(future), future.result()


_runners: dict[str, ExpertRunner] = {}  # of this process, by the task and conditions of their runs


def _runner(run: Manifest) -> ExpertRunner:
    key = f"{run.task}:{run.key(seeded=False)}"
    if key not in _runners:
        _runners[key] = ExpertRunner(run)
    return _runners[key]


def _solve(wanted: Wanted) -> Answer:
    return _runner(wanted.run).solve(wanted.scene, wanted.attempt)


def _show(solved: Solved) -> Packed | None:
    wanted = solved.wanted
    shown = _runner(wanted.run).record(wanted.scene, solved.solution.actions, wanted.finding)
    return packed(shown) if shown is not None else None
