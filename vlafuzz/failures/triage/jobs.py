"""Job: findings of a run that are to be triaged, here or in several processes, within an allowance."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

from vlafuzz.common.deadline import Deadline
from vlafuzz.failures.triage.known import certified
from vlafuzz.failures.triage.pool import Make, pooled_runner
from vlafuzz.failures.triage.runner import SceneRunner
from vlafuzz.failures.triage.scene_runner import SimulatorSceneRunner
from vlafuzz.failures.triage.shared_runner import SharedRunner
from vlafuzz.failures.triage.triager import Triager, Unjudged
from vlafuzz.model.scene import Scene
from vlafuzz.rollouts.calls import side_by_side
from vlafuzz.rollouts.registry import Place, pool_at
from vlafuzz.store.records import Finding, Repeats, Run, Triaged

WAVE = 4  # findings that do not know each other's causes

Work = Callable[[Callable[[Finding], Triaged | Unjudged], Sequence[Finding]], Iterable[Triaged | Unjudged]]
"""Calls a function for findings, several at a time or one by one."""


@dataclass
class Allowance:
    """What triage may take: once it is used up, no further finding is begun.

    A finding is not begun either if less time is left than those before it took on average. What the deadline
    interrupts all the same is left for the next triage.

    Attributes:
        rollouts: of the policy; None for no limit. ``spent``: by the findings that are done.
    """

    rollouts: int | None = None
    deadline: Deadline = field(default_factory=Deadline)
    spent: int = 0
    _seconds: list[float] = field(default_factory=list)

    def charge(self, triaged: Triaged) -> None:
        self.spent += triaged.policy_rollouts
        self._seconds.append(triaged.seconds)

    @property
    def used_up(self) -> bool:
        takes = sum(self._seconds) / max(len(self._seconds), 1)
        return self.spent_all or self.deadline.left <= takes

    @property
    def spent_all(self) -> bool:
        """Whether the rollouts are used up."""
        return self.rollouts is not None and self.spent >= self.rollouts


class Job(NamedTuple):
    """The findings of one run that are to be triaged; the fields after them are those of ``Triager``.

    Attributes:
        known: None where every finding is to be shrunk by a search of its own.
        repeats: rollouts of an interrupted triage, to which those of this one are added.
        lessen: see ``Triager``.
    """

    run: Run
    findings: Sequence[Finding]
    max_rollouts: int | None
    passing: Sequence[Scene]
    blamed: Mapping[Scene, Sequence[str]]
    known: Sequence[Triaged] | None
    repeats: Repeats
    lessen: bool = False

    def triager(self, runner: SceneRunner, deadline: Deadline | None = None) -> Triager:
        until = deadline or Deadline()
        about = runner, self.max_rollouts, self.passing, self.blamed
        return Triager(*about, repeats=self.repeats, lessen=self.lessen, deadline=until)


def work_here(make: Make, jobs: Sequence[Job], allowance: Allowance) -> Iterator[Triaged | Unjudged]:
    """Triage in this process, run by run; behind a server, as many findings at a time as it takes scenes."""
    for job in jobs:
        with closing(make(job.run)) as runner:
            if isinstance(runner, SimulatorSceneRunner) and runner.lanes > 1:
                shared = SharedRunner(runner)
                yield from _in_waves(shared.side_by_side, job, shared, allowance)
            else:
                yield from _in_waves(map, job, runner, allowance)


def work_in_processes(
    make: Make, jobs: Sequence[Job], place: Place, allowance: Allowance
) -> Iterator[Triaged | Unjudged]:
    """Triage as many findings at a time as there are workers, whose rollouts all workers share.

    Results come in the order in which they are done.
    """

    def work(
        function: Callable[[Finding], Triaged | Unjudged], findings: Sequence[Finding]
    ) -> Iterator[Triaged | Unjudged]:
        return (triaged for _, triaged in side_by_side(pool, place.workers, function, findings))

    with pool_at(place) as pool:
        for job in jobs:
            with pooled_runner(pool, make, job.run, place) as runner:
                yield from _in_waves(work, job, runner, allowance)


def _in_waves(work: Work, job: Job, runner: SceneRunner, allowance: Allowance) -> Iterator[Triaged | Unjudged]:
    """Triage the findings of a job in waves: each knows the causes that the waves before it have certified.

    So results do not depend on how many findings are worked on at a time.
    """
    triager, known = job.triager(runner, allowance.deadline), job.known
    left = job.findings
    while left and not allowance.used_up:
        wave, left = left[:WAVE], left[WAVE:]
        results = list[Triaged]()
        for triaged in work(partial(_allowed, replace(triager, known=known or ()), allowance), wave):
            yield triaged
            results += [triaged] if isinstance(triaged, Triaged) else []
        if known is not None:
            in_order = [finding.key for finding in wave]
            known = certified([*known, *sorted(results, key=lambda one: in_order.index(one.key))])


def _allowed(triager: Triager, allowance: Allowance, finding: Finding) -> Triaged | Unjudged:
    return Unjudged.LATE if allowance.used_up else triager.triage(finding)
