"""A page on this machine that follows a run: how far it is, how often the policy fails, and why, so far.

It reads the store and writes nothing.
"""

import shlex
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from datetime import datetime
from html import escape
from http import HTTPStatus
from queue import SimpleQueue

from vlafuzz.common.files import reason
from vlafuzz.common.text import count_of, duration, interval, percent
from vlafuzz.errors import UsageError, VlafuzzError
from vlafuzz.failures.causes import causes_of
from vlafuzz.failures.described import Spaces, described, title_of
from vlafuzz.model.outcome import Verdict
from vlafuzz.policies.serving.http import BoundedHandler, BoundedServer
from vlafuzz.report.counts import Counts, charts_of, run_row
from vlafuzz.report.films import NewestFilm
from vlafuzz.report.page import render
from vlafuzz.report.view import Card, View, cause_table
from vlafuzz.search.base import POOL, RANDOM
from vlafuzz.store.records import Finding, Run, Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds.evaluation import Film

AWAITED = 256  # proposals that may still be added before the last one: more than any batch
EVERYTHING = 1 << 62
RECENT = 20  # rollouts over which the speed is measured at least
HOST = "127.0.0.1"
REFRESH, SELDOM = 5, 30  # seconds, while the run goes on and afterwards: triage may follow
LOOK = 0.05  # seconds that a browser waits for its page to be begun, at most


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
                if trial.proposal in self._seen:
                    continue
                self._seen.add(trial.proposal)
                self._counts.add(run, trial)
                if trial.outcome.verdict is Verdict.FAILED:
                    self.newest = trial
        self._first = self._first or (time.monotonic(), self._counts.rollouts)
        return run

    def view(self, filmed: tuple[Trial, Film] | None = None) -> View:
        """The page of the run as it is now.

        Args:
            filmed: a failure with its film, which is shown instead of the newest one.
        """
        run, path = self.run(), self._store.path
        if run is None:
            of = f" of {self._label}" if self._label else ""
            return View(title=title_of([]), source=str(path), headline=f"The store has no run{of} yet.")
        running, causes = run.status == "running", causes_of(self._store, run, self._spaces)
        report = shlex.join(["vlafuzz", "report", str(path), "--out", "report.html"])
        tables = [cause_table(causes)] if causes else []
        if running:
            tables = [replace(table, title="Causes so far") for table in tables]
        return View(
            title=title_of([run.manifest]),
            source=str(path),
            headline=self._headline(run),
            facts=self._facts(run),
            todo=() if running else (("The whole page:", report),),
            runs=(run.manifest,),
            run_rows=tuple(run_row(self._store, other) for other in self._store.runs()),
            charts=charts_of(self._counts),
            tables=tuple(tables),
            cards=self._cards(run, filmed),
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
        facts = [("Strategy", manifest.strategy), ("Seed", str(manifest.seed)), ("Started", run.started)]
        if manifest.strategy == RANDOM:
            counted = count_of(failed.count, failed.of, failed.low, failed.high)
            return (("Failure rate in random scenes", counted), *facts)
        guided = ("Failed scenes", f"{failed.count} of {failed.of}, which were chosen: no failure rate")
        if manifest.strategy == POOL:
            return (guided, *facts)
        rate, kept = "known when the run ends, or after some more rollouts", self._store.causes(run.id)
        if kept and (estimate := kept.probability):
            rate = f"{percent(estimate.value)} ({interval(estimate.low, estimate.high)})"
        return (("Failure rate in random scenes", rate), guided, *facts)

    def _cards(self, run: Run, filmed: tuple[Trial, Film] | None) -> tuple[Card, ...]:
        trial, film = filmed or (self.newest, None)
        if trial is None:
            return ()
        manifest = run.manifest
        finding = Finding(trial.scene, manifest.key(), run.id, trial.proposal, trial.cell or "")
        failure = described(self._store.path, finding, manifest, self._spaces.of(manifest), None)
        return (Card(replace(failure, detail=f"one of the newest failures, proposal {trial.proposal}"), film),)


def live_page(live: Live, films: NewestFilm | None) -> str:
    """The page as it is now."""
    run = live.run()
    filmed = films.of(live.newest, run.manifest) if films and run else None
    over = run is not None and run.status != "running"
    return render(live.view(filmed), refresh=SELDOM if over else REFRESH)


class _Handler(BoundedHandler):
    server: "PageServer"

    def do_GET(self) -> None:  # noqa: N802 - http.server's name
        # Other names are those of pages elsewhere that resolve to this machine; browsers leave out port 80.
        if self.headers.get("Host", "").partition(":")[0] not in (HOST, "localhost"):
            self._say(HTTPStatus.FORBIDDEN, "this page is for this machine only")
        elif self.path.partition("?")[0] != "/":
            self._say(HTTPStatus.NOT_FOUND, "there is one page: /")
        else:
            try:
                self._say(HTTPStatus.OK, self.server.ask())
            except VlafuzzError as error:
                self._say(HTTPStatus.SERVICE_UNAVAILABLE, f"<p>{escape(error.message)}</p>")

    def _say(self, status: HTTPStatus, page: str) -> None:
        self.answer(status, "text/html; charset=utf-8", page.encode())


class PageServer(BoundedServer):
    """Makes the page in the thread that serves, as it opened the store; other threads talk to browsers."""

    def __init__(self, port: int, page: Callable[[], str]) -> None:
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            message = f"--port {port}: cannot listen there: {reason(error)}"
            raise UsageError(message, hint="--port 0 takes one that is free") from None
        self._page, self._asked = page, SimpleQueue[Future[str]]()

    def ask(self) -> str:
        """The page, for a thread that talks to a browser."""
        asked = Future[str]()
        self._asked.put(asked)
        return asked.result()

    def serve_forever(self, poll_interval: float = LOOK) -> None:
        super().serve_forever(poll_interval)

    def service_actions(self) -> None:
        """Called by ``serve_forever`` in every round."""
        while not self._asked.empty():
            asked = self._asked.get()
            try:
                asked.set_result(self._page())
            except Exception as error:
                asked.set_exception(error)

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self.server_port}/"
