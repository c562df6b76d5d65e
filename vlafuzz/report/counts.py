"""Counts over the trials of a store, in one pass."""

from collections import Counter
from dataclasses import dataclass, field

from vlafuzz.common.statistics import Share
from vlafuzz.model.outcome import Verdict
from vlafuzz.report.view import Chart, Measure, RunRow
from vlafuzz.search.base import RANDOM
from vlafuzz.store.records import Run, Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of

_VERDICTS = {
    Verdict.FAILED: "of the judged scenes",
    Verdict.PASSED: "of the judged scenes",
    Verdict.INVALID: "not fair; of all proposed scenes",
    Verdict.ERROR: "policy or simulator broke; of all proposed scenes",
}


@dataclass
class Counts:
    """Rollouts and verdicts of a store.

    Attributes:
        last: the last verdict of every scene under every policy key.
        begun: rollouts by task and model; ``reached``: those that reached a stage.
        guided: whether a strategy or the user chose some of the scenes.
    """

    rollouts: int = 0
    last: dict[tuple[str, str], Verdict] = field(default_factory=dict)
    begun: Counter[tuple[str, str]] = field(default_factory=Counter)
    reached: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    guided: bool = False

    @property
    def verdicts(self) -> Counter[Verdict]:
        return Counter(self.last.values())

    @property
    def failed(self) -> Share:
        """Failed scenes, of those that were judged."""
        counted = self.verdicts
        return Share.of_counts(counted[Verdict.FAILED], counted[Verdict.FAILED] + counted[Verdict.PASSED])

    def add(self, run: Run, trial: Trial) -> None:
        manifest, outcome = run.manifest, trial.outcome
        self.guided = self.guided or manifest.strategy != RANDOM
        key = (manifest.key(), trial.scene.digest)
        if outcome.verdict is not Verdict.ERROR or key not in self.last:
            self.last[key] = outcome.verdict
        if trial.duplicate:
            return
        self.rollouts += len(outcome.rollouts)
        for rollout in outcome.rollouts:
            self.begun[manifest.task, manifest.model] += 1
            self.reached.update((manifest.task, manifest.model, stage) for stage in rollout.reached)


def count(store: Store) -> Counts:
    counts = Counts()
    for run in store.runs():
        for trial in store.trials(run.id):
            counts.add(run, trial)
    return counts


def verdict_chart(counts: Counts) -> Chart:
    """Distinct scenes by their verdict."""
    scenes, judged = counts.verdicts, counts.failed.of
    measures = []
    for verdict, says in _VERDICTS.items():
        of = judged if verdict >= Verdict.PASSED else scenes.total()
        share = Share.of_counts(scenes[verdict], of)
        measures.append(Measure(verdict.name.lower(), share, says, rate=not counts.guided))
    chosen = " They were chosen: their share is no failure rate." if counts.guided else ""
    return Chart("Verdicts", f"Distinct scenes by their last verdict.{chosen}", tuple(measures))


def funnels(counts: Counts) -> tuple[Chart, ...]:
    """How many rollouts reached each stage: one chart per task and policy."""
    charts = []
    for (name, policy), begun in counts.begun.items():
        stages = world_of(name).task(name).stage_names
        reached = {stage: counts.reached[name, policy, stage] for stage in stages}
        measures = [
            Measure(stage, Share.of_counts(number, begun), rate=not counts.guided) for stage, number in reached.items()
        ]
        which = f", {name}, {policy}" if len(counts.begun) > 1 else ""
        charts.append(Chart(f"Stages reached{which}", f"Of {begun} rollouts.", tuple(measures)))
    return tuple(charts)


def run_row(store: Store, run: Run) -> RunRow:
    """A run, with its failure rate."""
    manifest, (failed, judged) = run.manifest, store.judged([run.id])
    share = Share.of_counts(failed, judged) if judged else None
    return RunRow(id=run.id, manifest=manifest, status=run.status, failed=share)
