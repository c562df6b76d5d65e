"""triage: the place where a store's findings, the policy and the expert meet. It imports no simulator."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby
from multiprocessing import get_context
from typing import NamedTuple, Protocol

from vlafuzz.errors import SceneError, SimulatorError
from vlafuzz.evidence import Actions, signature
from vlafuzz.execute.processes import single_threaded
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.store.records import Finding, Run, Triaged
from vlafuzz.store.store import Store
from vlafuzz.triage.attribute import attribute
from vlafuzz.triage.confirm import MOST, Confirmation, confirm
from vlafuzz.triage.oracle import BudgetedOracle, Judged
from vlafuzz.triage.path import deviating
from vlafuzz.triage.shrink import Shrunk, shrink
from vlafuzz.triage.witness import Search, find_witness

# Of the policy, to shrink and attribute one finding; a stochastic one takes some five for each scene, at
# most twenty.
MAX_ROLLOUTS, MAX_OF_STOCHASTIC = 100, 1000


class SceneRunner(Protocol):
    """What the findings of one run are worked on with. Nothing of it raises for what a scene does."""

    @property
    def space(self) -> SearchSpace:
        """In which the scenes are; with the operators of the run."""

    @property
    def stages(self) -> tuple[str, ...]:
        """Of the task."""

    @property
    def deterministic(self) -> bool:
        """Whether the policy is."""

    def renew(self) -> None:
        """The next scene gets an environment that has seen no other."""

    def evaluate(self, scenes: Sequence[Scene], number: int) -> list[Outcome]:
        """The n-th rollout of the policy in each scene; all are the same where it is deterministic."""

    def solve(self, scene: Scene, attempt: int) -> Outcome:
        """One rollout of the expert, in its n-th attempt."""

    def play(self, scene: Scene, actions: Actions) -> Outcome:
        """What comes of it when the robot executes these actions."""

    def close(self) -> None:
        """No more scenes."""


class Progress(NamedTuple):
    """Where triage is: findings done of all, and rollouts so far."""

    done: int
    findings: int
    rollouts: int


def triage(
    store: Store,
    runner: Callable[[Run], SceneRunner],
    *,
    findings: Sequence[Finding] | None = None,
    max_rollouts: int | None = None,
    limit: int | None = None,
    workers: int = 1,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> int:
    """Work on every finding that was not triaged yet; each is stored as soon as it is done.

    With a limit, one finding of every cell comes before the second of any: more of them are other bugs.

    Args:
        desk: makes what the findings of a run are worked on with; picklable where there are several workers.
        findings: to work on; by default all of the store.
        max_rollouts: of the policy, to shrink and attribute one finding; None for 100, of a stochastic
            policy 1000.
        limit: most findings to work on.
        workers: processes that work on them; 1 for this one alone.
        watch: hears of every step.

    Returns:
        How many could not be judged, as the policy broke or the scene is no longer fair: they stay as they
        are, and are tried again the next time.

    Raises:
        SimulatorError: a worker died.
    """
    done = {(each.scene.digest, each.policy_key) for each in store.triaged()}
    ordered = _cells_first(store.findings() if findings is None else findings)
    todo = [each for each in ordered if (each.scene.digest, each.policy_key) not in done][:limit]
    todo.sort(key=lambda finding: finding.run)
    runs = {run.id: run for run in store.runs()}
    jobs = [(runs[finding.run], finding) for finding in todo]
    work = (
        partial(_alone, runner, max_rollouts)
        if workers == 1
        else partial(_crew, runner, max_rollouts, workers)
    )
    unjudged, rollouts = 0, 0
    watch(Progress(0, len(todo), 0))
    for number, triaged in enumerate(work(jobs), start=1):
        if triaged is None:
            unjudged += 1
        else:
            store.settle(triaged)
            rollouts += triaged.policy_rollouts + triaged.expert_rollouts
        watch(Progress(number, len(todo), rollouts))
    return unjudged


Jobs = Sequence[tuple[Run, Finding]]


def _alone(
    runner: Callable[[Run], SceneRunner], max_rollouts: int | None, jobs: Jobs
) -> Iterator[Triaged | None]:
    """In this process, run by run."""
    for run, findings in groupby(jobs, lambda job: job[0]):
        with closing(runner(run)) as tools:
            triager = _Triager(tools, max_rollouts)
            for _, finding in findings:
                yield triager.triage(finding)


def _crew(
    runner: Callable[[Run], SceneRunner], max_rollouts: int | None, workers: int, jobs: Jobs
) -> Iterator[Triaged | None]:
    """In several processes, in the order in which they are done."""
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
    try:
        with single_threaded():
            done = [pool.submit(_work, runner, max_rollouts, run, finding) for run, finding in jobs]
        for each in as_completed(done):
            yield each.result()
    except BrokenProcessPool:
        told = "a worker died; what is done is stored"
        raise SimulatorError(told, hint="go on with the same command, or with fewer --workers") from None
    finally:
        pool.shutdown(cancel_futures=True)


_triagers: dict[int, _Triager] = {}  # of a worker process, by run


def _work(
    runner: Callable[[Run], SceneRunner], max_rollouts: int | None, run: Run, finding: Finding
) -> Triaged | None:
    """One finding, in a worker process, with the tools of the one before where they serve."""
    if run.id not in _triagers:
        for each in _triagers.values():
            each.runner.close()
        _triagers.clear()
        _triagers[run.id] = _Triager(runner(run), max_rollouts)
    return _triagers[run.id].triage(finding)


def _cells_first(findings: Sequence[Finding]) -> list[Finding]:
    """The first finding of each cell, then the second ones, and so on."""
    seen: Counter[str] = Counter()
    ranked = []
    for each in findings:
        ranked.append((seen[each.cell], each))
        seen[each.cell] += 1
    return [each for _, each in sorted(ranked, key=lambda pair: pair[0])]


class _BrokenError(Exception):
    """Policy or simulator broke: this says nothing of the finding."""


@dataclass
class _Triager:
    runner: SceneRunner
    max_rollouts: int | None
    known: dict[Scene, Judged] = field(default_factory=dict)

    def triage(self, finding: Finding) -> Triaged | None:
        """What there is to say of a finding; None where policy or simulator kept it from being judged."""
        try:
            return self._triage(finding)
        except _BrokenError:
            return None

    def _triage(self, finding: Finding) -> Triaged:
        began = time.monotonic()
        self.runner.renew()
        confirmation, judged = repeat(self.runner, finding.scene)
        clear = confirmation.confirmed or confirmation.refuted or confirmation.repeats == MOST
        if not clear:
            raise _BrokenError
        triaged = Triaged(
            finding.scene,
            finding.policy_key,
            "flaky",
            repeats=confirmation.repeats,
            failures=confirmation.failures,
            deviating=self._deviating(finding.scene) or (),
            policy_rollouts=judged.rollouts,
            detail=f"{confirmation.failures} of {confirmation.repeats} repeats failed",
        )
        if confirmation.confirmed:
            triaged = self._prove(triaged, judged)
        return replace(triaged, seconds=time.monotonic() - began)

    def _prove(self, triaged: Triaged, judged: Judged) -> Triaged:
        """Witness, shrink and attribute a failure that is confirmed."""
        search = self._search(triaged.scene)
        triaged = replace(triaged, expert_rollouts=search.rollouts, lost_stage=judged.lost, detail="")
        if search.witness is None:
            return replace(triaged, bucket="unproven", detail="the expert fails, too")
        triaged = replace(triaged, bucket="witnessed", witness=search.witness)
        if self._deviating(triaged.scene) is None:
            told = "it has something that is not a value of any operator, and was not shrunk"
            return replace(triaged, detail=told)
        return self._shrink(triaged, judged)

    def _shrink(self, triaged: Triaged, judged: Judged) -> Triaged:
        runner = self.runner
        oracle = BudgetedOracle(
            self._judge,
            runner.stages,
            (triaged.scene, judged),
            most=self.max_rollouts or (MAX_ROLLOUTS if runner.deterministic else MAX_OF_STOCHASTIC),
            each=1 if runner.deterministic else MOST,
        )
        shrunk = shrink(triaged.scene, oracle, runner.space)
        if not shrunk.base:
            triaged = replace(triaged, causes=attribute(shrunk, oracle, runner.space))
        triaged = replace(
            triaged,
            shrunk=shrunk.scene,
            lost_stage=shrunk.lost,
            operators=shrunk.operators,
            counterparts=shrunk.counterparts,
            unresolved=tuple(shrunk.unresolved),
            signature=signature(triaged.scene.task, shrunk.lost, shrunk.operators),
            complete=shrunk.complete,
            shrink_rollouts=oracle.spent,
            policy_rollouts=triaged.policy_rollouts + oracle.spent,
        )
        if shrunk.base:
            return replace(triaged, bucket="base", detail="even the nominal scene of the same objects fails")
        if not shrunk.minimal:
            return replace(triaged, detail=_why_not(shrunk))
        return self._crown(triaged, shrunk.scene)

    def _crown(self, triaged: Triaged, scene: Scene) -> Triaged:
        """What is left is minimal when it has a witness of its own."""
        if scene == triaged.scene:
            return replace(triaged, bucket="minimal")
        search = self._search(scene)
        triaged = replace(triaged, expert_rollouts=triaged.expert_rollouts + search.rollouts)
        if search.witness is None:
            return replace(triaged, detail="the expert solves the finding, but not what is left of it")
        return replace(triaged, bucket="minimal", witness=search.witness)

    def _search(self, scene: Scene) -> Search:
        search = find_witness(scene, self.runner.solve, self.runner.play)
        if search.broken:
            raise _BrokenError
        return search

    def _judge(self, scenes: Sequence[Scene]) -> list[Judged]:
        """What comes of candidates; those that another finding had cost nothing, but for crashes."""
        fresh = [scene for scene in scenes if scene not in self.known]
        if self.runner.deterministic:
            judged = [Judged.of(outcome) for outcome in self.runner.evaluate(fresh, 0)]
        else:
            judged = [repeat(self.runner, scene)[1] for scene in fresh]
        if any(each.unanswered for each in judged):
            raise _BrokenError
        answers = dict(zip(fresh, judged, strict=True))
        found = [answers[scene] if scene in answers else self.known[scene] for scene in scenes]
        kept = {scene: each for scene, each in answers.items() if each.verdict is not Verdict.ERROR}
        self.known |= {scene: each._replace(rollouts=0) for scene, each in kept.items()}
        return found

    def _deviating(self, scene: Scene) -> tuple[str, ...] | None:
        """The operators that are not nominal; None for a scene that the space cannot put together."""
        space = self.runner.space
        try:
            return tuple(deviating(space, scene)) if space.reset(scene, []) == scene else None
        except SceneError:
            return None


def repeat(runner: SceneRunner, scene: Scene) -> tuple[Confirmation, Judged]:
    """Whether a scene fails again, and what mostly comes of it."""
    seen: list[Judged] = []

    def once(number: int) -> Verdict:
        seen.append(Judged.of(runner.evaluate([scene], number)[0]))
        return seen[-1].verdict

    found = confirm(once, deterministic=runner.deterministic)
    rollouts = sum(judged.rollouts for judged in seen)
    lost = Counter(judged.lost for judged in seen if judged.lost is not None)
    if found.confirmed:
        return found, Judged(Verdict.FAILED, lost.most_common(1)[0][0], rollouts)
    if found.refuted:
        return found, Judged(Verdict.PASSED, None, rollouts)
    verdict = Verdict.FAILED if found.failures else seen[-1].verdict  # at times
    return found, Judged(verdict, None, rollouts, seen[-1].unanswered)


def _why_not(shrunk: Shrunk) -> str:
    """Why what is left of a finding is not shown to be minimal."""
    if not shrunk.complete:
        return "the bound on rollouts cut shrinking short"
    return "; ".join(f"without {name} the scene {outcome}" for name, outcome in shrunk.unresolved.items())
