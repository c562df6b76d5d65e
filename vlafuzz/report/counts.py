"""Counts: what came of a store's rollouts, in one pass over its trials."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from vlafuzz.outcome import Verdict
from vlafuzz.regression.corpus import Share
from vlafuzz.report.view import Chart, Measure, RunRow
from vlafuzz.store.records import Run, Trial
from vlafuzz.store.store import Store
from vlafuzz.tasks.tabletop import task

_VERDICTS = {
    Verdict.FAILED: "of the scenes that were judged",
    Verdict.PASSED: "of the scenes that were judged",
    Verdict.INVALID: "not a fair scene; of all that were proposed",
    Verdict.ERROR: "policy or simulator broke; of all that were proposed",
}


@dataclass
class Counts:
    """Of a store.

    Attributes:
        rollouts: of policies, in runs.
        last: each scene's verdict under each policy key, the last one.
        begun: rollouts by task and policy; ``reached`` those that reached a stage.
    """

    rollouts: int = 0
    last: dict[tuple[str, str], Verdict] = field(default_factory=dict)
    begun: Counter[tuple[str, str]] = field(default_factory=Counter)
    reached: Counter[tuple[str, str, str]] = field(default_factory=Counter)

    @property
    def verdicts(self) -> Counter[Verdict]:
        """Distinct scenes by verdict."""
        return Counter(self.last.values())

    @property
    def failed(self) -> Share:
        """Of the scenes that were judged."""
        counted = self.verdicts
        return Share.of_counts(counted[Verdict.FAILED], counted[Verdict.FAILED] + counted[Verdict.PASSED])

    def add(self, run: Run, trial: Trial) -> None:
        """One more trial."""
        manifest, outcome = run.manifest, trial.outcome
        key = (manifest.key(), trial.scene.digest)
        if outcome.verdict is not Verdict.ERROR or key not in self.last:
            self.last[key] = outcome.verdict
        if trial.duplicate:
            return
        self.rollouts += len(outcome.rollouts)
        for rollout in outcome.rollouts:
            self.begun[manifest.task, manifest.policy] += 1
            self.reached.update((manifest.task, manifest.policy, stage) for stage in rollout.reached)


def count(store: Store) -> Counts:
    """All trials of a store."""
    counts = Counts()
    for run in store.runs():
        for trial in store.trials(run.id):
            counts.add(run, trial)
    return counts


def verdict_chart(counts: Counts) -> Chart:
    """Distinct scenes by their verdict."""
    scenes, judged = counts.verdicts, counts.failed.of
    measures = (
        Measure(
            verdict.name.lower(),
            Share.of_counts(scenes[verdict], judged if verdict >= Verdict.PASSED else scenes.total()),
            says,
        )
        for verdict, says in _VERDICTS.items()
    )
    return Chart("Verdicts", "Distinct scenes, each by its last verdict.", tuple(measures))


def funnels(counts: Counts) -> tuple[Chart, ...]:
    """How many rollouts reached each stage: one a task and policy."""
    charts = []
    for (name, policy), begun in counts.begun.items():
        stages = task(name).stage_names
        measures = [
            Measure(stage, Share.of_counts(counts.reached[name, policy, stage], begun)) for stage in stages
        ]
        several = f", {name}, {policy}" if len(counts.begun) > 1 else ""
        charts.append(Chart(f"Stages reached{several}", f"Of {begun} rollouts.", tuple(measures)))
    return tuple(charts)


def run_row(store: Store, run: Run) -> RunRow:
    """A run, with its share of failures."""
    manifest, (failed, judged) = run.manifest, store.judged([run.id])
    return RunRow(
        run.id,
        manifest.task,
        manifest.policy,
        manifest.strategy,
        manifest.seed,
        manifest.budget,
        run.status,
        Share.of_counts(failed, judged) if judged else None,
    )
