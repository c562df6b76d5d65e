"""triage, certify_causes: which findings of a store are triaged, where, in which order and at what cost."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, count, groupby, islice
from pathlib import Path
from typing import NamedTuple, get_args

from vlafuzz.common.deadline import Deadline
from vlafuzz.common.text import duration
from vlafuzz.common.watch import Watch
from vlafuzz.failures.triage.certify import certified
from vlafuzz.failures.triage.triager import Triager, Unjudged
from vlafuzz.model import Scene
from vlafuzz.policies.base import Policy
from vlafuzz.rollouts import scene_runner
from vlafuzz.rollouts.crew import Crew, Make, crew_at
from vlafuzz.rollouts.registry import Place, default_workers
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Bucket, Finding, FoundCause, Run, Triaged
from vlafuzz.store.store import Store

PER_CAUSE = 50  # rollouts of the policy to certify a cause, about: its scene is nearly minimal already
PER_FINDING = 70  # rollouts to triage a finding, about: mostly 40 to 160
HERE = Place()
SAMPLE = 200  # rollouts that tell how long one takes


class Progress(NamedTuple):
    """How far triage is: findings done, findings in all, and rollouts so far."""

    done: int
    findings: int
    rollouts: int


@dataclass
class Allowance:
    """Limits what triage takes: once it is used up, no further finding is begun.

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
        spent_all = self.rollouts is not None and self.spent >= self.rollouts
        return spent_all or self.deadline.left <= takes


class Job(NamedTuple):
    """The findings of one run that are to be triaged; the fields after them are those of ``Triager``.

    Attributes:
        known: None where every finding is to be shrunk by a search of its own.
    """

    run: Run
    findings: Sequence[Finding]
    trials: Sequence[tuple[Scene, bool]]
    blamed: Mapping[Scene, FoundCause]
    known: Sequence[Triaged] | None


def expected(store: Store, findings: int) -> int:
    """Rollouts that triage of so many more findings takes; those that show causes come first, and take fewer."""
    done = {triaged.key for triaged in store.triaged()}
    causes = {finding.key for run in store.runs() for finding in cause_findings(store, run.id)} - done
    first = min(len(causes), findings)
    return PER_CAUSE * first + PER_FINDING * (findings - first)


def hours(store: Store, findings: int) -> str:
    """How long triage of so many findings takes here, to follow a command."""
    seconds = expected(store, findings) * pace(store, usual_workers(store))
    return f" (about {duration(max(seconds, 1.0))}; --time bounds it)"


def usual_workers(store: Store) -> int:
    """The number of processes for triage where nobody names one."""
    return min((default_workers(run.manifest.policy) for run in store.runs()), default=1)


def pace(store: Store, workers: int) -> float:
    """Seconds per rollout in the newest runs; of a policy behind a server as many at a time as there."""
    runs = store.runs()
    newest_first = chain.from_iterable(_seconds(store, run) for run in reversed(runs))
    seconds, at_once = list(islice(newest_first, SAMPLE)) or [0.0], float(workers)
    if runs and "://" in runs[-1].manifest.policy and runs[-1].seconds:
        at_once = max(at_once, sum(_seconds(store, runs[-1])) / runs[-1].seconds)
    return sum(seconds) / len(seconds) / at_once


def _seconds(store: Store, run: Run) -> Iterator[float]:
    return (rollout.seconds for trial in store.trials(run.id) for rollout in trial.outcome.rollouts)


def triage(
    store: Store,
    runner: Make,
    *,
    findings: Sequence[Finding] | None = None,
    limit: int | None = None,
    allowance: Allowance | None = None,
    place: Place = HERE,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> Counter[Unjudged]:
    """Triage every finding that was not triaged yet; each result is stored at once.

    Under a limit, findings that show causes come first, and the first finding of every other cell before the second of
    any, as it is more likely to have another cause.

    Args:
        runner: makes a scene runner for the findings of a run; picklable where there are several workers. findings: by
        default all of the store.
        limit: the most findings to triage.
        allowance: the rollouts and the time that it may take; by default there is no limit.
        place: where it rolls out: here, in processes or on ray. Results do not depend on it.
        watch: called after every finding.

    Returns:
        The number of findings that could not be judged, by the reason, but for those that the allowance left. They are
        left as they are, and tried again by the next call.

    Raises:
        SimulatorError: no worker stays alive.
    """
    before = store.triaged()
    done = {triaged.key for triaged in before}
    runs = {run.id: run for run in store.runs()}
    keys = {number: run.manifest.key() for number, run in runs.items()}
    causes = [finding.key for run in runs for finding in cause_findings(store, run)]
    ordered = _causes_first(store.findings() if findings is None else findings, causes)
    todo = [finding for finding in ordered if finding.key not in done][:limit]
    todo.sort(key=lambda finding: finding.run)
    jobs = [
        Job(
            runs[number],
            of_run,
            store.outcomes_by_scene(number),
            _blamed(store, [run for run in runs if keys[run] == keys[number]]),
            certified(row for row in before if (row.policy_key, row.scene.task) == like),
        )
        for number, some in groupby(todo, lambda finding: finding.run)
        if (of_run := list(some)) and (like := (of_run[0].policy_key, of_run[0].scene.task))
    ]
    allowance = allowance or Allowance()
    done_now, rollouts, unjudged = 0, 0, Counter[Unjudged]()
    watch(Progress(0, len(todo), 0))
    for triaged in work(runner, jobs, place, allowance):
        if isinstance(triaged, Triaged):
            allowance.charge(triaged)
            store.settle(triaged)
            rollouts += triaged.policy_rollouts + triaged.expert_rollouts
        elif triaged is Unjudged.LATE:
            continue
        else:
            unjudged[triaged] += 1
        done_now += 1
        watch(Progress(done_now, len(todo), rollouts))
    return unjudged


def job_of(store: Store, run: Run, findings: Sequence[Finding]) -> Job:
    """The job of some findings of a run, with what that run knows; they know nothing of each other."""
    return Job(run, findings, store.outcomes_by_scene(run.id), _blamed(store, [run.id]), None)


def certify_causes(
    store: Store,
    runner: Make,
    run: int,
    *,
    allowance: Allowance | None = None,
    place: Place = HERE,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> Counter[Unjudged]:
    """Triage the findings that show the commonest causes of a run, which takes about as long as the run.

    The next commonest cause takes the place of one that cannot be certified, or that is the same as another, as long as
    the rollouts are no more than those of the run.

    Args:
        runner, allowance, place, watch: see ``triage``.

    Returns:
        The number of findings that could not be judged, see ``triage``.
    """
    tried, unjudged, allowance = set[tuple[str, str]](), Counter[Unjudged](), allowance or Allowance()
    while not allowance.used_up:
        done = tried | {row.key for row in store.triaged()}
        waiting = [finding for finding in cause_findings(store, run) if finding.key not in done]
        some = waiting[: round(left_for_causes(store, run) / PER_CAUSE)]
        if not some:
            break
        unjudged += triage(store, runner, findings=some, allowance=allowance, place=place, watch=watch)
        tried |= {finding.key for finding in some}
    return unjudged


def left_for_causes(store: Store, run: int) -> int:
    """Rollouts that the causes of a run may still take: as many as its budget, with those of the run beyond it."""
    budget = next(each.manifest.budget for each in store.runs() if each.id == run)
    keys = {finding.key for finding in store.findings(run)}
    certifying = sum(row.policy_rollouts for row in store.triaged() if row.key in keys)
    return max(budget, PER_CAUSE) - certifying - max(store.rollouts(run) - budget, 0)


def cause_findings(store: Store, run: int) -> list[Finding]:
    """The findings that show the causes of a run, in order of rank."""
    attribution = store.causes(run)
    if attribution is None:
        return []
    findings = {finding.scene: finding for finding in store.findings(run)}
    scenes = dict.fromkeys(cause.scene for cause in attribution.causes)
    return [findings[scene] for scene in scenes if scene in findings]


def findings_in_order(store: Store, run: int) -> list[Finding]:
    """The findings of a run in the order of ``triage`` under a limit."""
    return _causes_first(store.findings(run), [finding.key for finding in cause_findings(store, run)])


def _blamed(store: Store, runs: Iterable[int]) -> dict[Scene, FoundCause]:
    """Each cause by the scene that shows it."""
    attributions = filter(None, map(store.causes, runs))
    return {cause.scene: cause for attribution in attributions for cause in attribution.causes if cause.scene}


def affordable(budget: int) -> int:
    """The number of causes that a run with this budget certifies."""
    return max(1, budget // PER_CAUSE)


def _causes_first(findings: Sequence[Finding], causes: Sequence[tuple[str, str]]) -> list[Finding]:
    """Findings sorted: those of causes, by their keys, then the first of each cell, the second, and so on.

    Every task has cells of its own.
    """
    number: defaultdict[tuple[str, str], Iterator[int]] = defaultdict(count)
    ranks = {key: rank - len(causes) for rank, key in enumerate(causes)}
    return sorted(findings, key=lambda finding: ranks.get(finding.key, next(number[finding.scene.task, finding.cell])))


def work(make: Make, jobs: Sequence[Job], place: Place, allowance: Allowance) -> Iterator[Triaged | Unjudged]:
    """Triage run by run, as many findings at a time as the place has room for; results as they are done."""
    for job in jobs:
        if allowance.used_up:
            return
        with crew_at(place, partial(make, job.run), job.run.manifest.policy) as crew:
            yield from _in_order(job, crew, allowance)


def _in_order(job: Job, crew: Crew, allowance: Allowance) -> Iterator[Triaged | Unjudged]:
    """Triage the findings of a job, each with the causes that those before it have certified: see ``known_to``."""
    triager = Triager(crew.runner, job.trials, job.blamed, deadline=allowance.deadline)
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


@dataclass(frozen=True, kw_only=True)
class TriageSummary:
    """All findings of a store that were triaged, in numbers.

    Attributes:
        findings: of the store, of which ``triaged`` were triaged.
        confirmed: findings that fail again in their neighbourhood: all that are not flaky. witnessed: confirmed ones
        that the expert solved; ``by_sight``: those that the seeing expert did.
        signatures: minimal failures by signature.
        policy_rollouts: all rollouts to confirm, shrink and attribute. expert_rollouts: replays included.
    """

    store: str
    findings: int
    triaged: int
    buckets: dict[str, int]
    confirmed: int
    witnessed: int
    by_sight: int
    distinct_signatures: int
    signatures: dict[str, int]
    policy_rollouts: int
    expert_rollouts: int
    seconds: float


def summarise(store: Store, task: str | None = None) -> TriageSummary:
    """Count what triage of a store, or of one task in it, has come to so far."""
    findings = [one for one in store.findings() if task in (None, one.scene.task)]
    triaged = [one for one in store.triaged() if task in (None, one.scene.task)]
    witnesses = [finding.witness for finding in triaged if finding.witness]
    buckets = Counter(finding.bucket for finding in triaged)
    signatures = Counter(finding.signature for finding in triaged if finding.bucket == "minimal" and finding.signature)
    return TriageSummary(
        store=str(store.path),
        findings=len(findings),
        triaged=len(triaged),
        buckets={name: buckets[name] for name in get_args(Bucket)},
        confirmed=len(triaged) - buckets["flaky"],
        witnessed=len(witnesses),
        by_sight=sum(witness.solver == "seeing" for witness in witnesses),
        distinct_signatures=len(signatures),
        signatures=dict(signatures.most_common()),
        policy_rollouts=sum(finding.policy_rollouts for finding in triaged),
        expert_rollouts=sum(finding.expert_rollouts for finding in triaged),
        seconds=sum(finding.seconds for finding in triaged),
    )
