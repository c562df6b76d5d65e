"""Job: findings of a run that are to be triaged, wherever that is, within an allowance."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from vlafuzz.common.deadline import Deadline
from vlafuzz.common.watch import Watch
from vlafuzz.failures.triage.known import certified
from vlafuzz.failures.triage.triager import Triager, Unjudged
from vlafuzz.model import Scene
from vlafuzz.policies.base import Policy
from vlafuzz.rollouts import scene_runner
from vlafuzz.rollouts.crew import Crew, Make, crew_at
from vlafuzz.rollouts.registry import Place
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Finding, Repeats, Run, Triaged


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
    """

    run: Run
    findings: Sequence[Finding]
    trials: Sequence[tuple[Scene, bool]]
    blamed: Mapping[Scene, Sequence[str]]
    known: Sequence[Triaged] | None
    repeats: Repeats

    def triager(self, runner: SceneRunner, deadline: Deadline | None = None) -> Triager:
        return Triager(runner, self.trials, self.blamed, repeats=self.repeats, deadline=deadline or Deadline())


def work(make: Make, jobs: Sequence[Job], place: Place, allowance: Allowance) -> Iterator[Triaged | Unjudged]:
    """Triage run by run, as many findings at a time as the place has room for; results as they are done."""
    for job in jobs:
        if allowance.used_up:
            return
        with crew_at(place, partial(make, job.run), job.run.manifest.policy) as crew:
            yield from _in_order(job, crew, allowance)


def _in_order(job: Job, crew: Crew, allowance: Allowance) -> Iterator[Triaged | Unjudged]:
    """Triage the findings of a job, each with the causes that those before it have certified: see ``known_to``."""
    triager = job.triager(crew.runner, allowance.deadline)
    ends = [Future[Triaged | Unjudged]() for _ in job.findings]

    def triaged(number: int) -> Triaged | Unjudged:
        end: Triaged | Unjudged = Unjudged.LATE
        try:
            earlier = (each.result() for each in ends[: known_to(number)])  # waits for them
            before = [found for found in earlier if isinstance(found, Triaged)]
            if not allowance.used_up:
                known = () if job.known is None else certified([*job.known, *before])
                end = replace(triager, known=known).triage(job.findings[number])
        finally:
            ends[number].set_result(end)
        return end

    for _, end in crew.each(triaged, range(len(job.findings))):
        yield end


def known_to(number: int) -> int:
    """How many of the first findings the one with this number, from 0, knows the causes of.

    It depends on nothing else, so results do not depend on how many findings are worked on at a time. At most four are
    at first, as a known cause saves most rollouts of a finding, and half of those begun so far later on.
    """
    return max(0, min(number - 3, (number + 1) // 2))


def runner_of_run(
    store: Path, run: Run, policy: Policy | None = None, *, note: Callable[[str], None] = Watch.note
) -> SceneRunner:
    """A scene runner for the findings of a run; notes when it differs from what found them.

    Args:
        policy: one that workers share; by default one of its own is made.
    """
    shared = () if policy is None else (policy,)
    runner = scene_runner.SimulatorSceneRunner(store, run.manifest, *shared)
    verb = "differs" if len(runner.changed) == 1 else "differ"
    version = f"by another version: its {', '.join(runner.changed)} {verb}" if runner.changed else ""
    if how := " and ".join(filter(None, (version, runner.elsewhere))):
        note(f"note: run {run.id} was made {how}; what no longer fails will count as flaky")
    return runner
