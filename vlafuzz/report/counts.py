"""Counts over the trials of a store, as tables, and as standings: how each policy does in each task."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import interval, percent
from vlafuzz.failures.causes import CauseList, all_causes
from vlafuzz.model.outcome import Verdict
from vlafuzz.report.sheet import Table
from vlafuzz.search.base import RANDOM
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import Manifest, Run
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
        rollouts: by run.
        last: the last verdict of every scene under every policy key; ``of``: task and model of every such key.
        begun: rollouts by task and model; ``reached``: those that reached a stage.
        guided: whether a strategy or the user chose some of the scenes.
    """

    rollouts: Counter[int] = field(default_factory=Counter)
    last: dict[tuple[str, str], Verdict] = field(default_factory=dict)
    of: dict[str, tuple[str, str]] = field(default_factory=dict)
    begun: Counter[tuple[str, str]] = field(default_factory=Counter)
    reached: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    guided: bool = False

    @property
    def verdicts(self) -> Counter[Verdict]:
        return Counter(self.last.values())

    @property
    def failed(self) -> Share:
        """Failed scenes, of those that were judged."""
        return self._failed(self.verdicts)

    def failed_in(self, task: str, model: str) -> Share:
        """The same of a policy in a task."""
        return self._failed(
            Counter(verdict for (key, _), verdict in self.last.items() if self.of[key] == (task, model))
        )

    @staticmethod
    def _failed(counted: Counter[Verdict]) -> Share:
        return Share.of_counts(counted[Verdict.FAILED], counted[Verdict.FAILED] + counted[Verdict.PASSED])


def count(store: Store) -> Counts:
    counts = Counts()
    for run in store.runs():
        manifest = run.manifest
        counts.guided = counts.guided or manifest.strategy != RANDOM
        counts.of[manifest.key()] = manifest.task, manifest.model
        for trial in store.trials(run.id):
            key = (manifest.key(), trial.scene.digest)
            if trial.outcome.verdict is not Verdict.ERROR or key not in counts.last:
                counts.last[key] = trial.outcome.verdict
            for rollout in () if trial.duplicate else trial.outcome.rollouts:
                counts.rollouts[run.id] += 1
                counts.begun[manifest.task, manifest.model] += 1
                counts.reached.update((manifest.task, manifest.model, stage) for stage in rollout.reached)
    return counts


def tables_of(counts: Counts) -> tuple[Table, ...]:
    """Distinct scenes by their verdict, and how many rollouts reached each stage, by task and policy."""
    scenes, judged, rate = counts.verdicts, counts.failed.of, not counts.guided
    chosen = " They were chosen: their share is no failure rate." if counts.guided else ""
    verdicts = [
        {"verdict": verdict.name.lower()}
        | _counted(scenes[verdict], judged if verdict >= Verdict.PASSED else scenes.total(), rate=rate)
        | {"": says}
        for verdict, says in _VERDICTS.items()
    ]
    tables = [Table("Verdicts", verdicts, f"Distinct scenes by their last verdict.{chosen}")]
    for (task, policy), begun in counts.begun.items():
        names = world_of(task).task(task).stage_names
        stages = [{"stage": name} | _counted(counts.reached[task, policy, name], begun, rate=rate) for name in names]
        which = f", {task}, {policy}" if len(counts.begun) > 1 else ""
        tables.append(Table(f"Stages reached{which}", stages, f"Of {begun} rollouts."))
    return tuple(tables)


def _counted(count: int, of: int, *, rate: bool) -> dict[str, str]:
    """Columns of a count; with a rate where the scenes were not chosen."""
    return {"scenes": f"{count} of {of}"} | ({"rate": str(Share.of_counts(count, of))} if rate else {})


def cause_table(found: CauseList) -> Table:
    """The causes of a run; the share is left out where none is known."""
    rows = [cause.row() for cause in found.causes]
    if not any(cause.share for cause in found.causes):
        rows = [{head: value for head, value in row.items() if head != "share"} for row in rows]
    says = "; ".join(found.sentences)
    return Table(found.title, rows, f"{says[0].upper()}{says[1:]}.")


def run_table(store: Store) -> Table | None:
    """The runs with their failure rates; None before there is one.

    The scenes of a strategy that chooses them have no failure rate.
    """
    rows = []
    for run in store.runs():
        manifest, failed = run.manifest, Share.of_counts(*store.judged([run.id]))
        rate = f", {failed}" if manifest.strategy == RANDOM else ""
        rows.append(
            row_of_run(run.id, manifest)
            | {"status": run.status, "scenes that failed": f"{failed.count} of {failed.of}{rate}" if failed.of else "–"}
        )
    return Table("Runs", rows) if rows else None


def row_of_run(number: int, run: Manifest) -> dict[str, object]:
    """What a run was asked to do, as columns of a table."""
    columns: dict[str, object] = {"run": number, "task": run.task, "policy": run.model, "strategy": run.strategy}
    return columns | {"seed": run.seed, "budget": run.budget}


@dataclass(frozen=True, kw_only=True)
class Standing:
    """How a policy does in a task.

    Attributes:
        rate: how often it fails in random scenes, by the newest run that tells; None if none does.
        causes: that the newest run found whose strategy looks for causes, of which ``certified`` are certified; None
            without such a run.
        rollouts: of all runs, without those of triage.
    """

    policy: str
    task: str
    rate: Probability | None
    causes: int | None
    certified: int | None
    rollouts: int

    def row(self) -> dict[str, object]:
        """The columns of a table for people."""
        rate = self.rate
        return {
            "policy": self.policy,
            "task": self.task,
            "fails in random scenes": f"{percent(rate.value)} ({interval(rate.low, rate.high)})" if rate else "–",
            "causes": "–" if self.causes is None else self.causes,
            "certified": "–" if self.certified is None else self.certified,
            "rollouts": self.rollouts,
        }

    def document(self) -> dict[str, object]:
        """The columns for programs: the rate with its 95 % interval, as ``rate``, ``low`` and ``high``."""
        rate = self.rate._asdict() if self.rate else dict.fromkeys(Probability._fields)
        rates = {"rate": rate.pop("value"), **rate}
        known = {"causes": self.causes, "certified": self.certified, "rollouts": self.rollouts}
        return {"policy": self.policy, "task": self.task, **rates, **known}


def standings_of(
    store: Store, counts: Counts | None = None, lists: Sequence[CauseList] | None = None
) -> tuple[Standing, ...]:
    """One for each policy and task of a store, in the order in which they were first tried.

    Args:
        counts, lists: of the same store, if they are there already.
    """
    counts = counts or count(store)
    by_run = {one.run: one for one in (all_causes(store) if lists is None else lists)}
    groups = defaultdict[tuple[str, str], list[Run]](list)
    for run in store.runs():
        groups[run.manifest.model, run.manifest.task].append(run)
    standings = []
    for (policy, task), several in groups.items():
        newest = several[::-1]
        found = next((by_run[run.id] for run in newest if run.id in by_run), None)
        rates = (_rate(store, run, by_run.get(run.id)) for run in newest)
        standings.append(
            Standing(
                policy=policy,
                task=task,
                rate=next(filter(None, rates), None),
                causes=found.found if found else None,
                certified=found.certified if found else None,
                rollouts=counts.begun[task, policy],
            )
        )
    return tuple(standings)


def _rate(store: Store, run: Run, found: CauseList | None) -> Probability | None:
    """How often random scenes fail: the share of a random run, or what a strategy estimates."""
    if run.manifest.strategy != RANDOM:
        return found.probability if found else None
    failed = Share.of_counts(*store.judged([run.id]))
    return Probability(failed.share, failed.low, failed.high) if failed.of else None
