"""Demonstrations: the expert's solutions, shown as a policy would see them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, NamedTuple

from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import UsageError
from vlafuzz.exports.expert_runner import BROKEN, UNFAIR, ExpertRunner, Solution
from vlafuzz.exports.packed import Packed
from vlafuzz.exports.selection import WantedScene
from vlafuzz.model.outcome import Outcome
from vlafuzz.rollouts.executor import Executor
from vlafuzz.rollouts.registry import Place, workers_at
from vlafuzz.store.records import Manifest

UNPLAYED = "a replay of the expert's actions does not solve it"


class Solved(NamedTuple):
    """A scene, and the actions that solve it as the policy of its run would write them."""

    wanted: WantedScene
    solution: Solution


@dataclass
class Demonstrations:
    """Solves scenes and shows the solutions, in several processes.

    Attributes:
        left_out: number of scenes that were tried in vain, by reason.
    """

    workers: int = 1
    watch: Watch = SILENT
    left_out: Counter[str] = field(default_factory=Counter)

    def solved(self, wanted: Iterator[WantedScene], number: int, most: int) -> list[Solved]:
        """The first ``number`` scenes that the expert solves, of ``most`` that it tries, in order."""
        tried, solved = islice(wanted, most), list[Solved]()
        with closing(self._executor()) as executor:
            while missing := list(islice(tried, number - len(solved))):
                answers = dict(self._results(executor, missing, "scenes tried by the expert"))
                for index, one in enumerate(missing):
                    answer = BROKEN if isinstance(answers[index], Outcome) else answers[index]
                    if isinstance(answer, Solution):
                        solved.append(Solved(one, answer))
                    elif answer != UNFAIR or one.finding:  # random scenes are drawn until they are fair
                        self.left_out[answer] += 1
        return solved

    def shown(self, solved: Sequence[Solved]) -> Iterator[Packed]:
        """Replay the solutions; yields what the policies would see and do, in order.

        Raises:
            PrerequisiteError: rendering does not work here.
        """
        early: dict[int, Any] = {}
        following = 0
        with closing(self._executor()) as executor:
            for index, result in self._results(executor, solved, "demonstrations recorded"):
                early[index] = result
                while following in early:
                    shown = early.pop(following)
                    following += 1
                    if isinstance(shown, Packed):
                        yield shown
                    else:
                        self.left_out[UNPLAYED] += 1

    def _executor(self) -> Executor:
        return workers_at(Place(self.workers), _Teacher)

    def _results(
        self, executor: Executor, items: Sequence[WantedScene | Solved], doing: str
    ) -> Iterator[tuple[int, Any]]:
        """Yield each item's number and what ``_Teacher`` returns; an ERROR if a worker was lost twice."""
        rolled = executor.run((number, [item]) for number, item in enumerate(items))
        for done, (number, (result,)) in enumerate(rolled, start=1):
            if isinstance(result, UsageError):
                raise result
            self.watch.progress(doing, done, len(items))
            yield number, result


class _Teacher:
    """The evaluator of what is wanted, or of what is solved and to be shown, for runs of any conditions."""

    def __init__(self) -> None:
        self._runners: dict[str, ExpertRunner] = {}  # by the task and conditions of their runs

    def evaluate(self, items: Sequence[WantedScene | Solved]) -> list[Any]:
        """The solution of what is wanted, or why there is none; what is solved as a policy would see it, if it is."""
        try:
            return list(map(self._answer, items))
        except UsageError as error:
            return [error] * len(items)

    def close(self) -> None:
        for runner in self._runners.values():
            runner.close()

    def _answer(self, item: WantedScene | Solved) -> Solution | str | Packed | None:
        if isinstance(item, Solved):
            wanted = item.wanted
            return self._runner(wanted.run).record(wanted.scene, item.solution.actions, wanted.finding)
        return self._runner(item.run).solve(item.scene, item.attempt)

    def _runner(self, run: Manifest) -> ExpertRunner:
        key = f"{run.task}:{run.key(seeded=False)}"
        if key not in self._runners:
            self._runners[key] = ExpertRunner(run)
        return self._runners[key]
