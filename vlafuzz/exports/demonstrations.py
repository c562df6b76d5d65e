"""Demonstrations: the expert's solutions, kept in the store, and shown as a policy would see them."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import UsageError
from vlafuzz.exports.expert_runner import BROKEN, UNFAIR, ExpertRunner
from vlafuzz.exports.packed import Packed, packed
from vlafuzz.exports.selection import Wanted
from vlafuzz.model.conditions import Role
from vlafuzz.model.outcome import Outcome
from vlafuzz.policies.clients.model import interface_of
from vlafuzz.rollouts.executor import Executor
from vlafuzz.rollouts.registry import Place, workers_at
from vlafuzz.store.records import Manifest, Solution
from vlafuzz.store.store import Store
from vlafuzz.worlds import provenance, world_of

UNSOLVED = "the expert does not solve it"
UNPLAYED = "a replay of the expert's actions does not solve it"
Answer = Solution | str  # or why there is none


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
        with closing(self._executor()) as executor:
            while missing := list(islice(tried, number - len(solved))):
                answers = self._answers(missing, executor)
                solved += filter(None, map(self._judged, missing, answers))
        return solved

    def shown(self, solved: Sequence[Solved]) -> Iterator[Packed]:
        """What the policies would see and do, in order.

        Raises:
            PrerequisiteError: rendering does not work here.
        """
        early: dict[int, Packed | None] = {}
        following = 0
        with closing(self._executor()) as executor:
            for done, (index, shown) in enumerate(_results(executor, solved), start=1):
                self.watch.progress("demonstrations recorded", done, len(solved))
                early[index] = shown if isinstance(shown, Packed) else None
                while following in early:
                    shown = early.pop(following)
                    following += 1
                    if shown is None:
                        self.left_out[UNPLAYED] += 1
                    else:
                        yield shown

    def _executor(self) -> Executor:
        return workers_at(Place(self.workers), _Teacher)

    def _answers(self, wanted: Sequence[Wanted], executor: Executor) -> list[Answer]:
        """The expert's answer to every scene; what the store does not know is kept there."""
        keys = [_key(one.run) for one in wanted]
        known = {key: self.store.solutions(key) if self.store else {} for key in set(keys)}
        answers: list[Answer | None] = [
            _fitting(known[key].get(one.scene.digest), one.run) for key, one in zip(keys, wanted, strict=True)
        ]
        open_ = [index for index, answer in enumerate(answers) if answer is None]
        self.known += len(answers) - len(open_)
        for done, (number, result) in enumerate(_results(executor, [wanted[index] for index in open_]), start=1):
            index, answer = open_[number], BROKEN if isinstance(result, Outcome) else result
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
        "place": provenance.here("expert", world.solvers()["expert"].spec, world.renderer),
    }
    text = json.dumps([run.task, run.values(Role.SIMULATION), interface_of(run.policy, run.spec).key, here])
    return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()


def _results(executor: Executor, items: Sequence[Wanted | Solved]) -> Iterator[tuple[int, Any]]:
    """Yield each scene's number and what ``_Teacher`` returns; an ERROR if a worker was lost twice."""
    for number, (result,) in executor.run((number, [item]) for number, item in enumerate(items)):
        if isinstance(result, UsageError):
            raise result
        yield number, result


class _Teacher:
    """The evaluator of what is wanted, or of what is solved and to be shown, for runs of any conditions."""

    def __init__(self) -> None:
        self._runners: dict[str, ExpertRunner] = {}  # by the task and conditions of their runs

    def evaluate(self, items: Sequence[Wanted | Solved]) -> list[Any]:
        """The answer to what is wanted; what is solved as a policy would see it, None if it is not."""
        try:
            return [self._show(item) if isinstance(item, Solved) else self._solve(item) for item in items]
        except UsageError as error:
            return [error] * len(items)

    def close(self) -> None:
        for runner in self._runners.values():
            runner.close()

    def _solve(self, wanted: Wanted) -> Answer:
        return self._runner(wanted.run).solve(wanted.scene, wanted.attempt)

    def _show(self, solved: Solved) -> Packed | None:
        wanted = solved.wanted
        shown = self._runner(wanted.run).record(wanted.scene, solved.solution.actions, wanted.finding)
        return packed(shown) if shown is not None else None

    def _runner(self, run: Manifest) -> ExpertRunner:
        key = f"{run.task}:{run.key(seeded=False)}"
        if key not in self._runners:
            self._runners[key] = ExpertRunner(run)
        return self._runners[key]
