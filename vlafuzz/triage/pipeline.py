"""triage: work through the findings of a store, here or in several processes."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from functools import partial
from itertools import count, groupby
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
        findings: by default all of the store.
        max_rollouts: of the policy, to shrink and attribute one finding; None for 100, or 1000 for a
            stochastic policy.
        limit: the most findings to triage.
        watch: called after every finding.

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
    make = partial(_triager, runner, max_rollouts)
    unjudged, rollouts = 0, 0
    watch(Progress(0, len(todo), 0))
    results = _here(make, jobs) if workers == 1 else _in_processes(make, jobs, workers)
    for number, triaged in enumerate(results, start=1):
        if triaged is None:
            unjudged += 1
        else:
            store.settle(triaged)
            rollouts += triaged.policy_rollouts + triaged.expert_rollouts
        watch(Progress(number, len(todo), rollouts))
    return unjudged


Jobs = Sequence[tuple[Run, Finding]]
Make = Callable[[Run], Triager]


def _triager(runner: Callable[[Run], SceneRunner], max_rollouts: int | None, run: Run) -> Triager:
    return Triager(runner(run), max_rollouts)


def _here(make: Make, jobs: Jobs) -> Iterator[Triaged | None]:
    """Triage in this process, run by run."""
    for run, findings in groupby(jobs, lambda job: job[0]):
        triager = make(run)
        with closing(triager.runner):
            for _, finding in findings:
                yield triager.triage(finding)


def _in_processes(make: Make, jobs: Jobs, workers: int) -> Iterator[Triaged | None]:
    """Triage in several processes; results come in the order in which they are done."""
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
    try:
        with single_threaded():
            done = [pool.submit(_work, make, run, finding) for run, finding in jobs]
        for future in as_completed(done):
            yield future.result()
    except BrokenProcessPool:
        hint = "repeat the command to continue, perhaps with fewer --workers"
        raise SimulatorError("a worker died; finished findings are stored", hint=hint) from None
    finally:
        pool.shutdown(cancel_futures=True)


_triagers: dict[int, Triager] = {}  # of a worker process, by run


def _work(make: Make, run: Run, finding: Finding) -> Triaged | None:
    """Triage one finding in a worker process, which keeps the scene runner of the run before."""
    if run.id not in _triagers:
        for triager in _triagers.values():
            triager.runner.close()
        _triagers.clear()
        _triagers[run.id] = make(run)
    return _triagers[run.id].triage(finding)


def _cells_first(findings: Sequence[Finding]) -> list[Finding]:
    """Findings sorted: the first of each cell, then the second ones, and so on."""
    number: defaultdict[str, Iterator[int]] = defaultdict(count)
    return sorted(findings, key=lambda finding: next(number[finding.cell]))
