"""triage: work through the findings of a store, here or in several processes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from functools import partial
from itertools import groupby
from multiprocessing import get_context
from typing import NamedTuple

from vlafuzz.errors import SimulatorError
from vlafuzz.execute.processes import single_threaded
from vlafuzz.store.records import Finding, Run, Triaged
from vlafuzz.store.store import Store
from vlafuzz.triage.triager import SceneRunner, Triager


class Progress(NamedTuple):
    """How far triage is: findings done, findings in all, and rollouts so far."""

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
    """Triage every finding that was not triaged yet; each result is stored at once.

    Under a limit, the first finding of every cell comes before the second of any, as it is more likely to
    have another cause.

    Args:
        runner: makes a scene runner for the findings of a run; picklable where there are several workers.
        findings: to triage; by default all of the store.
        max_rollouts: of the policy, to shrink and attribute one finding; None for 100, or 1000 for a
            stochastic policy.
        limit: the most findings to triage.
        workers: number of processes; 1 for this one alone.
        watch: called with the progress after every finding.

    Returns:
        The number of findings that could not be judged, as the policy broke or the scene is no longer fair.
        They are left as they are, and tried again by the next call.

    Raises:
        SimulatorError: a worker died.
    """
    done = {triaged.key for triaged in store.triaged()}
    ordered = _cells_first(store.findings() if findings is None else findings)
    todo = [finding for finding in ordered if finding.key not in done][:limit]
    todo.sort(key=lambda finding: finding.run)
    runs = {run.id: run for run in store.runs()}
    jobs = [(runs[finding.run], finding) for finding in todo]
    work = (
        partial(_here, runner, max_rollouts)
        if workers == 1
        else partial(_in_processes, runner, max_rollouts, workers)
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


def _here(
    runner: Callable[[Run], SceneRunner], max_rollouts: int | None, jobs: Jobs
) -> Iterator[Triaged | None]:
    """Triage in this process, run by run."""
    for run, findings in groupby(jobs, lambda job: job[0]):
        with closing(runner(run)) as tools:
            triager = Triager(tools, max_rollouts)
            for _, finding in findings:
                yield triager.triage(finding)


def _in_processes(
    runner: Callable[[Run], SceneRunner], max_rollouts: int | None, workers: int, jobs: Jobs
) -> Iterator[Triaged | None]:
    """Triage in several processes; results come in the order in which they are done."""
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
    try:
        with single_threaded():
            done = [pool.submit(_work, runner, max_rollouts, run, finding) for run, finding in jobs]
        for future in as_completed(done):
            yield future.result()
    except BrokenProcessPool:
        hint = "repeat the command to continue, perhaps with fewer --workers"
        raise SimulatorError("a worker died; finished findings are stored", hint=hint) from None
    finally:
        pool.shutdown(cancel_futures=True)


_triagers: dict[int, Triager] = {}  # of a worker process, by run


def _work(
    runner: Callable[[Run], SceneRunner], max_rollouts: int | None, run: Run, finding: Finding
) -> Triaged | None:
    """Triage one finding in a worker process, which keeps the scene runner of the run before."""
    if run.id not in _triagers:
        for triager in _triagers.values():
            triager.runner.close()
        _triagers.clear()
        _triagers[run.id] = Triager(runner(run), max_rollouts)
    return _triagers[run.id].triage(finding)


def _cells_first(findings: Sequence[Finding]) -> list[Finding]:
    """Findings sorted: the first of each cell, then the second ones, and so on."""
    seen: Counter[str] = Counter()
    ranked = []
    for finding in findings:
        ranked.append((seen[finding.cell], finding))
        seen[finding.cell] += 1
    return [finding for _, finding in sorted(ranked, key=lambda pair: pair[0])]
