"""Job: findings of a run that are to be triaged, wherever that is, within an allowance."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from vlafuzz.common.deadline import Deadline
from vlafuzz.common.watch import Watch
from vlafuzz.failures.triage.known import certified
from vlafuzz.failures.triage.triager import Triager, Unjudged
from vlafuzz.model.scene import Scene
from vlafuzz.policies.base import Policy
from vlafuzz.rollouts import scene_runner
from vlafuzz.rollouts.crew import Crew, Make, crew_at
from vlafuzz.rollouts.registry import Place
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Finding, Repeats, Run, Triaged

WAVE = 4  # findings that do not know each other's causes


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
            yield from _in_waves(job, crew, allowance)


def _in_waves(job: Job, crew: Crew, allowance: Allowance) -> Iterator[Triaged | Unjudged]:
    """Triage the findings of a job in waves: each knows the causes that the waves before it have certified.

    So results do not depend on how many findings are worked on at a time.
    """
    triager, known = job.triager(crew.runner, allowance.deadline), job.known
    left = job.findings
    while left and not allowance.used_up:
        wave, left = left[:WAVE], left[WAVE:]
        results = list[Triaged]()
        for _, triaged in crew.each(partial(_allowed, replace(triager, known=known or ()), allowance), wave):
            yield triaged
            results += [triaged] if isinstance(triaged, Triaged) else []
        if known is not None:
            in_order = [finding.key for finding in wave]
            known = certified([*known, *sorted(results, key=lambda one: in_order.index(one.key))])


def _allowed(triager: Triager, allowance: Allowance, finding: Finding) -> Triaged | Unjudged:
    return Unjudged.LATE if allowance.used_up else triager.triage(finding)


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
