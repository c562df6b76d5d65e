"""The causes of a run: its findings are triaged within a limit of rollouts, and what is certified counts."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

from vlafuzz.failures.triage.jobs import Job
from vlafuzz.failures.triage.pipeline import HERE, findings_in_order, job_of
from vlafuzz.rollouts.crew import Make, crew_at
from vlafuzz.rollouts.registry import Place
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Finding, Run, Triaged
from vlafuzz.store.store import Store

Known = dict[tuple[str, str], Triaged | None]
"""Results of triage by the finding's key; None where a finding could not be judged."""


@dataclass(frozen=True)
class Certified:
    """What triage of a run's findings has come to.

    Attributes:
        causes: distinct signatures of certified findings.
        triaged: findings within the limit.
        rollouts: of the policy; all of the limit where it did not suffice for the next finding.
    """

    causes: tuple[str, ...]
    triaged: int
    rollouts: int


def known_results(store: Store) -> Known:
    return {triaged.key: triaged for triaged in store.triaged()}


def certified(findings: Sequence[Finding], known: Known, limit: int) -> Certified:
    """Count the findings whose triage, one after the other, took no more rollouts than the limit."""
    causes: dict[str, None] = {}
    triaged, spent = 0, 0
    for result in filter(None, (known.get(finding.key) for finding in findings)):
        spent += result.policy_rollouts
        if spent > limit:
            break
        triaged += 1
        if result.bucket == "minimal" and result.signature:
            causes[result.signature] = None
    return Certified(tuple(causes), triaged, min(spent, limit))


def certify(
    store: Store,
    make: Make,
    runs: Sequence[Run],
    limit: int,
    place: Place = HERE,
    watch: Callable[[int, int], None] = lambda number, spent: None,
) -> int:
    """Triage the findings of every run, in order, until they have taken ``limit`` rollouts of the policy.

    Every result is stored at once; a finding of several runs is triaged once. Findings share no verdicts, so that
    results depend neither on the number of workers nor on interruptions.

    Args:
        watch: is told the index of a run, and the rollouts that its findings have taken so far.

    Returns:
        The number of findings that could not be judged: see ``pipeline.triage``.
    """
    results = known_results(store)
    for index, run in enumerate(runs):
        findings = findings_in_order(store, run.id)
        job = job_of(store, run, findings)
        watch(index, 0)
        with crew_at(place, partial(make, run), run.manifest.policy) as crew:
            triage = partial(_triaged, job, crew.runner)
            while batch := _missing(findings, results, limit)[: place.workers]:
                for number, triaged in crew.each(triage, batch):
                    results[batch[number].key] = triaged
                    if triaged:
                        store.settle(triaged)
                watch(index, certified(findings, results, limit).rollouts)
    return sum(result is None for result in results.values())


def _triaged(job: Job, runner: SceneRunner, finding: Finding) -> Triaged | None:
    triaged = job.triager(runner).triage(finding)
    return triaged if isinstance(triaged, Triaged) else None


def uncertified(store: Store, runs: Iterable[Run], limit: int) -> list[Run]:
    """The runs with findings that ``certify`` would triage."""
    results = known_results(store)
    return [run for run in runs if _missing(findings_in_order(store, run.id), results, limit)]


def _missing(findings: Sequence[Finding], results: Known, limit: int) -> list[Finding]:
    """The findings that were not triaged yet and for which the others have left rollouts."""
    spent, missing = 0, []
    for finding in findings:
        if spent >= limit:
            break
        if finding.key not in results:
            missing.append(finding)
        elif result := results[finding.key]:
            spent += result.policy_rollouts
    return missing
