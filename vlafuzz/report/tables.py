"""Tables of causes and runs, under "Method"."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import duration
from vlafuzz.failures.causes import CauseList
from vlafuzz.model.outcome import Verdict
from vlafuzz.report.counts import half_in_words, half_of_run
from vlafuzz.search.base import RANDOM
from vlafuzz.search.severity import NAME as SEVERITY
from vlafuzz.store.records import Manifest, Run
from vlafuzz.store.store import Store
from vlafuzz.worlds.provenance import in_words


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
        rate = f"; one half fails at severity {half_in_words(half_of_run(store, run.id))}"
    return {
        "status": run.status,
        "scenes that failed": f"{failed.count} of {failed.of}{rate}",
        "not fair": verdicts[Verdict.INVALID],
        "errors": verdicts[Verdict.ERROR],
        "stages reached": ", ".join(f"{stage} {count}" for stage, count in reached.items()) or "–",
        "rollouts": len(rollouts),
        "time": duration(run.seconds) if run.seconds else "–",
    }
