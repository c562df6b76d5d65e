"""Triage after a search in a world with planted faults, with its rollouts counted."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

from strategies.courses import Course, Verdict, judge, touched
from strategies.faults import World, space_of
from strategies.search import Tried
from vlafuzz.failures.triage.oracle import CERTIFYING
from vlafuzz.failures.triage.triager import Triager
from vlafuzz.model import Outcome, Scene
from vlafuzz.store.records import Finding, Triaged
from vlafuzz.worlds.tabletop.space import SearchSpace
from vlafuzz.worlds.tabletop.tasks import TASKS

NEVER_RESET = frozenset({"target-type"})  # by triage, which therefore does not name it


class Runner:
    """A scene runner in a world, where the expert solves everything; notes the rollouts."""

    def __init__(self, world: World) -> None:
        self.space: SearchSpace = space_of(world.task)
        self.renderer: str | None = None
        self.stages, self.deterministic = TASKS[world.task].stage_names, world.rate == 1.0
        self.tries: list[tuple[str, int]] = []
        self._world = world
        self._passed = replace(world, faults=(), background=0.0).evaluate(self.space.nominal())

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        outcomes = list(map(self._world.evaluate, scenes, numbers))
        self.tries += [
            (scene.digest, number)
            for scene, number, outcome in zip(scenes, numbers, outcomes, strict=True)
            if outcome.rollouts
        ]
        return outcomes

    def solve(self, scene: Scene, attempt: int, solver: str = "expert") -> Outcome:
        return self._passed

    def play(self, scene: Scene, actions: object) -> Outcome:
        return self._passed

    def close(self) -> None: ...


@dataclass(frozen=True)
class Done:
    """What triage made of a finding.

    Attributes:
        verdict: on what is left of it after shrinking, if it came so far.
        certified: triage reports it.
        tries: its rollouts, by scene and number; ``shrinking``: those before any that certifies.
    """

    verdict: Verdict | None
    certified: bool
    tries: frozenset[tuple[str, int]]
    shrinking: frozenset[tuple[str, int]]


class Triages:
    """Triage of the failures of one search, each done once whatever the budget."""

    def __init__(self, world: World, tried: Sequence[Tried]) -> None:
        self._world, self._tried = world, tried
        self._trials = [(scene, judged.failed) for scene, judged in self._tried]
        self._done: dict[str, Done] = {}

    def course(self, split: float, budget: int, *, certified: bool) -> Course:
        """Search with a share of the budget, then triage finding by finding, as far as the rest goes."""
        spent = round(split * budget)
        tried = self._tried[:spent]
        course, verdicts, known = Course(), list[Verdict](), set[tuple[str, int]]()
        course.touched.append((spent, touched(self._world, tried)))
        for scene in cells_first([pair for pair in tried if pair[1].failed]):
            if spent >= budget:
                break
            done = self._triage(scene)
            new = (done.tries if certified else done.shrinking) - known  # findings share the nominal scene's
            spent, known = spent + len(new), known | new
            if done.verdict and (done.certified or not certified):
                verdicts.append(done.verdict)
                course.report(spent, verdicts)
        return course

    def _triage(self, scene: Scene) -> Done:
        if scene.digest not in self._done:
            runner = Runner(self._world)
            triaged = Triager(runner, trials=self._trials).triage(Finding(scene, "", 0, ""))
            verdict = None
            if isinstance(triaged, Triaged) and triaged.shrunk:
                verdict = judge(self._world, triaged.shrunk, triaged.operators, NEVER_RESET)
            certified = isinstance(triaged, Triaged) and triaged.bucket == "minimal"
            tries = runner.tries
            self._done[scene.digest] = Done(verdict, certified, frozenset(tries), frozenset(_shrinking(tries)))
        return self._done[scene.digest]


def _shrinking(tries: Sequence[tuple[str, int]]) -> Sequence[tuple[str, int]]:
    """Those that certify nothing and do not come after all that do: shrinking ends with certificates."""
    last = max((index for index, (_, number) in enumerate(tries) if number >= CERTIFYING), default=len(tries))
    return [(digest, number) for digest, number in tries[:last] if number < CERTIFYING]


def cells_first(failures: Sequence[Tried]) -> list[Scene]:
    """As triage orders findings: the first of every cell before the second of any."""
    cells = defaultdict(list)
    for scene, judged in failures:
        cells[judged.cell].append(scene)
    return [scene for row in zip_longest(*cells.values()) for scene in row if scene is not None]
