"""A page on this machine that follows a run. It reads the store and writes nothing."""

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import closing
from html import escape
from http import HTTPStatus
from pathlib import Path
from queue import SimpleQueue

from vlafuzz.common.files import reason
from vlafuzz.errors import UsageError, VlafuzzError
from vlafuzz.failures.triage import scene_runner
from vlafuzz.policies.serving.http import BoundedHandler, BoundedServer
from vlafuzz.report.live import Live
from vlafuzz.report.page import render
from vlafuzz.store.records import Manifest, Trial
from vlafuzz.worlds import no_pictures
from vlafuzz.worlds.evaluation import Film

HOST = "127.0.0.1"
_NAMES = (HOST, "localhost")  # other names are those of pages elsewhere that resolve to this machine
REFRESH, SELDOM = 5, 30  # seconds, while the run goes on and afterwards: triage may follow
LOOK = 0.05  # seconds that a browser waits for its page to be begun, at most
PAUSE = 20.0  # seconds between films, which take time from the run


class Films:
    """Films of failures by their stored actions, made in a thread: the policy is not asked."""

    def __init__(self, store: Path) -> None:
        self._store = store
        self._made: tuple[Trial, Film] | None = None
        self._thread: threading.Thread | None = None
        self._next = 0.0

    def of(self, newest: Trial | None, run: Manifest) -> tuple[Trial, Film] | None:
        """The last failure that was filmed, if any; the newest one is begun to be filmed."""
        busy = self._thread is not None and self._thread.is_alive()
        known = self._made is not None and self._made[0] is newest
        if newest is not None and not busy and not known and time.monotonic() >= self._next:
            self._thread = threading.Thread(target=self._make, args=(newest, run), daemon=True)
            self._thread.start()
        return self._made

    def _make(self, trial: Trial, run: Manifest) -> None:
        actions = trial.outcome.rollouts[-1].actions if trial.outcome.rollouts else None
        try:
            if actions is not None and not no_pictures(run.task):
                runner = scene_runner.SimulatorSceneRunner(self._store, run, "expert")
                with closing(runner):
                    film = runner.film(trial.scene, actions)
                self._made = (trial, film) if film else self._made
        finally:
            self._next = time.monotonic() + PAUSE


class _Handler(BoundedHandler):
    server: "PageServer"

    def do_GET(self) -> None:  # noqa: N802 - http.server's name
        if self.headers.get("Host", "").partition(":")[0] not in _NAMES:  # browsers leave out port 80
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


def live_page(live: Live, films: Films | None) -> str:
    """The page as it is now."""
    run = live.run()
    filmed = films.of(live.newest, run.manifest) if films and run else None
    over = run is not None and run.status != "running"
    return render(live.view(filmed), refresh=SELDOM if over else REFRESH)
