"""Counts: what came of a store's rollouts, in one pass over its trials."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from vlafuzz.corpus.bundle import Share
from vlafuzz.corpus.records import Run, Trial
from vlafuzz.corpus.store import Corpus
from vlafuzz.outcome import Verdict
from vlafuzz.report.view import Chart, Measure, RunRow
from vlafuzz.tasks.tabletop import task

_VERDICTS = {
    Verdict.FAILED: "of the scenes that were judged",
    Verdict.PASSED: "of the scenes that were judged",
    Verdict.INVALID: "not a fair scene; of all that were proposed",
    Verdict.ERROR: "subject or simulator broke; of all that were proposed",
}


@dataclass
class Counts:
    """Of a store.

    Attributes:
        rollouts: of subjects, in runs.
        last: each scene's verdict under each subject key, the last one.
        begun: rollouts by task and subject; ``reached`` those that reached a stage.
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
        key = (manifest.subject_key, trial.scene.digest)
        if outcome.verdict is not Verdict.ERROR or key not in self.last:
            self.last[key] = outcome.verdict
        if trial.duplicate:
            return
        self.rollouts += len(outcome.rollouts)
        for rollout in outcome.rollouts:
            self.begun[manifest.task, manifest.subject] += 1
            self.reached.update((manifest.task, manifest.subject, stage) for stage in rollout.reached)


def count(corpus: Corpus) -> Counts:
    """All trials of a store."""
    counts = Counts()
    for run in corpus.runs():
        for trial in corpus.trials(run.id):
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
    """How many rollouts reached each stage: one a task and subject."""
    charts = []
    for (name, subject), begun in counts.begun.items():
        stages = task(name).stage_names
        measures = [
            Measure(stage, Share.of_counts(counts.reached[name, subject, stage], begun)) for stage in stages
        ]
        several = f", {name}, {subject}" if len(counts.begun) > 1 else ""
        charts.append(Chart(f"Stages reached{several}", f"Of {begun} rollouts.", tuple(measures)))
    return tuple(charts)


def run_row(corpus: Corpus, run: Run) -> RunRow:
    """A run, with its share of failures."""
    manifest, (failed, judged) = run.manifest, corpus.judged([run.id])
    return RunRow(
        run.id,
        manifest.task,
        manifest.subject,
        manifest.strategy,
        manifest.seed,
        manifest.budget,
        run.status,
        Share.of_counts(failed, judged) if judged else None,
    )
