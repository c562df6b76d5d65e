"""The view of a run that goes on: how far it is, how often the policy fails, and why, so far."""

import shlex
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime

from vlafuzz.common.text import count_of, duration, interval, percent
from vlafuzz.model.outcome import Verdict
from vlafuzz.report.cards import Spaces, card_of_finding
from vlafuzz.report.causes import causes_of
from vlafuzz.report.counts import Counts, funnels, run_row, verdict_chart
from vlafuzz.report.view import Card, Table, View, title_of
from vlafuzz.search.base import POOL, RANDOM
from vlafuzz.store.records import Finding, Run, Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds.evaluation import Film

AWAITED = 256  # proposals that may still be added before the last one: more than any batch
EVERYTHING = 1 << 62
RECENT = 20  # rollouts over which the speed is measured at least


class Live:
    """Follows the last run of a store, or of a model in it, and reads only the trials that are new.

    Attributes:
        newest: the last trial of the run in which the policy failed.
    """

    def __init__(self, store: Store, label: str | None = None) -> None:
        self._store, self._spaces, self._label = store, Spaces(store.path), label
        self._begin(None)

    def _begin(self, run: int | None) -> None:
        self._run, self._counts, self._seen = run, Counts(), set[int]()
        self._first: tuple[float, int] | None = None  # time and rollouts when they were first counted
        self.newest: Trial | None = None

    def run(self) -> Run | None:
        """The last run, once its new trials are counted; None before there is one."""
        runs = [run for run in self._store.runs() if self._label in (None, run.manifest.named)]
        if not runs:
            return None
        run = runs[-1]
        if run.id != self._run:
            self._begin(run.id)
        if self._store.count(run.id) > len(self._seen):
            first = max(max(self._seen, default=0) - AWAITED, 0)
            for trial in self._store.stored(run.id, first, EVERYTHING):
                self._count(run, trial)
        self._first = self._first or (time.monotonic(), self._counts.rollouts)
        return run

    def _count(self, run: Run, trial: Trial) -> None:
        if trial.proposal in self._seen:
            return
        self._seen.add(trial.proposal)
        self._counts.add(run, trial)
        if trial.outcome.verdict is Verdict.FAILED:
            self.newest = trial

    def view(self, filmed: tuple[Trial, Film] | None = None) -> View:
        """The page of the run as it is now.

        Args:
            filmed: a failure with its film, which is shown instead of the newest one.
        """
        run = self.run()
        if run is None:
            return _empty(str(self._store.path), self._label)
        causes = causes_of(self._store, run, self._spaces)
        return View(
            title=title_of([run.manifest]),
            source=str(self._store.path),
            headline=self._headline(run),
            facts=self._facts(run),
            todo=() if run.status == "running" else (("The whole page:", _report(self._store)),),
            runs=(run.manifest,),
            run_rows=tuple(run_row(self._store, other) for other in self._store.runs()),
            charts=(verdict_chart(self._counts), *funnels(self._counts)),
            operators=(),
            causes=(_so_far(causes.table, run),) if causes else (),
            cards=tuple(self._cards(run, filmed)),
        )

    def _headline(self, run: Run) -> str:
        rollouts, budget = self._counts.rollouts, run.manifest.budget
        done = f"{rollouts} of {budget} rollouts"
        if run.status != "running":
            return f"{run.status.capitalize()}: {done} in {duration(run.seconds or 0.0)}."
        each = self._seconds_each(run)
        left = f"; about {duration((budget - rollouts) * each)} left" if each else ""
        return f"Running: {done}{f', {60 / each:.3g} a minute' if each else ''}{left}."

    def _seconds_each(self, run: Run) -> float | None:
        """Wall time of a rollout: since the page was opened, or where that is too short since the start."""
        assert self._first is not None
        opened, before = self._first
        rollouts = self._counts.rollouts
        if rollouts - before >= RECENT:
            return (time.monotonic() - opened) / (rollouts - before)
        started = datetime.fromisoformat(run.started)
        return (datetime.now(started.tzinfo) - started).total_seconds() / rollouts if rollouts else None

    def _facts(self, run: Run) -> tuple[tuple[str, str], ...]:
        manifest, failed = run.manifest, self._counts.failed
        counted = count_of(failed.count, failed.of, failed.low, failed.high)
        facts = [("Strategy", manifest.strategy), ("Seed", str(manifest.seed)), ("Started", run.started)]
        if manifest.strategy == RANDOM:
            return (("Failure rate in random scenes", counted), *facts)
        guided = f"{failed.count} of {failed.of}, which were chosen: no failure rate"
        if manifest.strategy == POOL:
            return (("Failed scenes", guided), *facts)
        rate = "known when the run ends, or after some more rollouts"
        kept = self._store.causes(run.id)
        if kept and (estimate := kept.probability):
            rate = f"{percent(estimate.value)} ({interval(estimate.low, estimate.high)})"
        return (("Failure rate in random scenes", rate), ("Failed scenes", guided), *facts)

    def _cards(self, run: Run, filmed: tuple[Trial, Film] | None) -> Iterator[Card]:
        trial, film = filmed or (self.newest, None)
        if trial is not None:
            manifest = run.manifest
            finding = Finding(trial.scene, manifest.key(), run.id, trial.proposal, trial.cell or "")
            card = card_of_finding(self._store.path, finding, manifest, self._spaces.of(manifest))
            yield replace(card, failure=film, detail=f"one of the newest failures, proposal {trial.proposal}")


def _so_far(table: Table, run: Run) -> Table:
    return replace(table, title="Causes so far") if run.status == "running" else table


def _report(store: Store) -> str:
    return shlex.join(["vlafuzz", "report", str(store.path), "--out", "report.html"])


def _empty(source: str, label: str | None) -> View:
    return View(
        title=title_of([]),
        source=source,
        headline=f"The store has no run{f' of {label}' if label else ''} yet.",
        facts=(),
        todo=(),
        runs=(),
        run_rows=(),
        charts=(),
        operators=(),
        cards=(),
    )
