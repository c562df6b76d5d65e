"""Counts of a store, how each policy does in each task, and tables of causes and runs, under "Method"."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import duration
from vlafuzz.failures.causes import CauseList, all_causes
from vlafuzz.model import Verdict
from vlafuzz.search.base import RANDOM
from vlafuzz.search.probability import Probability
from vlafuzz.search.severity import NAME as SEVERITY, Half, half_of, severity_of
from vlafuzz.store.records import Attribution, Manifest, Run, Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds.provenance import in_words


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
        return {
            "policy": self.policy,
            "task": self.task,
            "fails in random scenes": str(self.rate or "–"),
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


def draws(store: Store, run: Run) -> Callable[[Trial], bool]:
    """Tells whether a trial of a run is a random draw, whose choice depended on no outcome."""
    if run.manifest.strategy == RANDOM:
        return lambda trial: True
    attribution = store.causes(run.id)
    drawn = set(attribution.at_random) if attribution else set[int]()
    return lambda trial: trial.proposal in drawn


def standings_of(store: Store, lists: Sequence[CauseList] | None = None) -> tuple[Standing, ...]:
    """One for each policy and task of a store, in the order in which they were first tried.

    Args:
        lists: of the same store, if they are there already.
    """
    by_run = {one.run: one for one in (all_causes(store) if lists is None else lists)}
    groups = defaultdict[tuple[str, str], list[Run]](list)
    for run in store.runs():
        groups[run.manifest.model, run.manifest.task].append(run)
    standings = []
    for (policy, task), several in groups.items():
        newest = several[::-1]
        found = next((by_run[run.id] for run in newest if run.id in by_run), None)
        rates = (rate_of(store, run, by_run.get(run.id)) for run in newest)
        standings.append(
            Standing(
                policy=policy,
                task=task,
                rate=next(filter(None, rates), None),
                causes=found.found if found else None,
                certified=found.certified if found else None,
                rollouts=sum(store.rollouts(run.id) for run in several),
            )
        )
    return tuple(standings)


def rate_of(store: Store, run: Run, found: CauseList | Attribution | None) -> Probability | None:
    """How often random scenes fail: the share of a random run, or what a strategy estimates."""
    if run.manifest.strategy != RANDOM:
        return found.probability if found else None
    failed = Share.of_counts(*store.judged([run.id]))
    return Probability(failed.share, failed.low, failed.high) if failed.of else None


def half_of_run(store: Store, run: int) -> Half:
    """The severity at which one half fails, by a run of the strategy ``severity``."""
    judged = (trial for trial in store.trials(run) if trial.outcome.judged)
    return half_of([(severity_of(trial.proposal), not trial.outcome.passed) for trial in judged])


@dataclass(frozen=True)
class Table:
    """Rows with the same keys, which are the column heads; the first column names the row."""

    title: str
    rows: Sequence[Mapping[str, object]]
    says: str = ""

    @property
    def columns(self) -> Mapping[str, bool]:
        """Column heads, and whether the column holds numbers."""
        numbers = tuple("–0123456789")
        return {head: all(str(row[head]).startswith(numbers) for row in self.rows) for head in self.rows[0]}


def cause_table(found: CauseList) -> Table:
    """The causes of a run; the share is left out where none is known."""
    rows = [cause.row() for cause in found.causes]
    if not any(cause.share for cause in found.causes):
        rows = [{head: value for head, value in row.items() if head != "share"} for row in rows]
    says = "; ".join(found.sentences)
    return Table(found.title, rows, f"{says[0].upper()}{says[1:]}.")


def run_table(store: Store, runs: Sequence[Run]) -> Table:
    """The runs with their verdicts and the stages that rollouts reached.

    Scenes that a strategy chose have no failure rate.
    """
    return Table("Runs", [row_of_run(run.id, run.manifest) | _counted(store, run) for run in runs])


def row_of_run(number: int, run: Manifest) -> dict[str, object]:
    """What a run was asked to do, as columns of a table."""
    return {
        "run": number,
        "task": run.task,
        "policy": run.model,
        "strategy": run.strategy,
        "seed": run.seed,
        "budget": run.budget,
        "checkup": run.checkup or "–",
        "made with": run.simulator.replace("/", ", ") or "–",
        "made at": in_words(run.place) or "–",
    }


def _counted(store: Store, run: Run) -> dict[str, object]:
    failed = Share.of_counts(*store.judged([run.id]))
    trials = [trial for trial in store.trials(run.id) if not trial.duplicate]
    verdicts = Counter(trial.outcome.verdict for trial in trials)
    rollouts = [rollout for trial in trials for rollout in trial.outcome.rollouts]
    reached = Counter(stage for rollout in rollouts for stage in rollout.reached)
    rate = f", {failed}" if run.manifest.strategy == RANDOM and failed.of else ""
    if run.manifest.strategy == SEVERITY:
        rate = f"; one half fails at severity {half_of_run(store, run.id)}"
    return {
        "status": run.status,
        "scenes that failed": f"{failed.count} of {failed.of}{rate}",
        "not fair": verdicts[Verdict.INVALID],
        "errors": verdicts[Verdict.ERROR],
        "stages reached": ", ".join(f"{stage} {count}" for stage, count in reached.items()) or "–",
        "rollouts": len(rollouts),
        "time": duration(run.seconds) if run.seconds else "–",
    }
