"""At which severity a policy fails in one half of the scenes, by a run of the strategy ``severity``."""

from __future__ import annotations

from collections.abc import Sequence

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import interval, percent
from vlafuzz.report.tables import Table
from vlafuzz.search.severity import NAME, Half, half_of, severity_of
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store

PARTS = 5  # of the table: with 60 scenes a dozen each


def half_of_run(store: Store, run: int) -> Half:
    """The severity at which one half fails."""
    return half_of(_outcomes(store, run))


def in_words(half: Half) -> str:
    """The severity at which one half fails, as a phrase."""
    if half.low >= 1:
        return "above 1: fewer than one half fail in the whole ranges"
    if half.high <= 0:
        return "0: nominal scenes fail as often"
    return f"{half.value:.2f} of the ranges, 95% interval {half.low:.2f}–{half.high:.2f}{'+' * (half.high >= 1)}"


def severity_tables(store: Store, runs: Sequence[Run]) -> list[Table]:
    """How often the policy fails by severity, for each run of that strategy that has outcomes."""
    tables = []
    for run in runs:
        outcomes = _outcomes(store, run.id) if run.manifest.strategy == NAME else []
        if outcomes:
            parts = [[failed for at, failed in outcomes if int(at * PARTS) == part] for part in range(PARTS)]
            title = f"Run {run.id}: one half fails at severity {in_words(half_of(outcomes))}"
            tables.append(Table(title, [_row(part, failed) for part, failed in enumerate(parts)]))
    return tables


def _row(part: int, failed: Sequence[bool]) -> dict[str, object]:
    share = Share.of_counts(sum(failed), len(failed))
    rate = f"{percent(share.share)} ({interval(share.low, share.high)})" if failed else "–"
    return {"severity": f"{part / PARTS:g} to {(part + 1) / PARTS:g}", "scenes": len(failed), "fail": rate}


def _outcomes(store: Store, run: int) -> list[tuple[float, bool]]:
    judged = (trial for trial in store.trials(run) if trial.outcome.judged)
    return [(severity_of(trial.proposal), not trial.outcome.passed) for trial in judged]
