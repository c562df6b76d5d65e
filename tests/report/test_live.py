"""The page that follows a run: what it shows, and who may read it."""

import hashlib
import socket
import struct
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.cli.typed import typed
from tests.doubles import ClosedForm, failed, manifest, passed, scene
from tests.report.stores import MANIFEST, MadeUpFilms
from vlafuzz.cli import main
from vlafuzz.report import films as filming
from vlafuzz.report.films import NewestFilm
from vlafuzz.report.live import Live, PageServer, live_page
from vlafuzz.report.page import render
from vlafuzz.store.records import Trial
from vlafuzz.store.store import Store


def trial(number: int, *, fails: bool) -> Trial:
    outcome = failed() if fails else passed()
    cell = "grasp|light|x0y0" if fails else None
    return Trial(proposal=number, scene=scene(x=number / 1000), outcome=outcome, severity=0.5, cell=cell)


@contextmanager
def running(path: Path, strategy: str = "random") -> Iterator[tuple[Store, int]]:
    """A store that is written to, with a run of 50 rollouts."""
    with Store.open(path, "write") as store:
        yield store, store.begin(manifest(operators=MANIFEST.operators, strategy=strategy, budget=50))


@contextmanager
def served(path: Path) -> Iterator[str]:
    """The address of a page on a store."""
    ready: list[PageServer] = []

    def serve() -> None:
        with Store.open(path) as store:
            live = Live(store)
            with PageServer(0, lambda: live_page(live, None)) as server:
                ready.append(server)
                server.serve_forever()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    while not ready:
        time.sleep(0.01)
    yield ready[0].address
    ready[0].shutdown()
    thread.join()


def read(address: str, host: str | None = None) -> tuple[int, str]:
    request = urllib.request.Request(address, headers={"Host": host} if host else {})
    try:
        with urllib.request.urlopen(request, timeout=20) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def test_it_follows_the_last_run_of_a_model(tmp_path: Path):
    with Store.open(tmp_path / "a.db", "write") as store:
        for label in ("v1", "v2"):
            store.begin(manifest(operators=MANIFEST.operators, label=label))
        assert [Live(store, label).view().runs[0].label for label in ("v1", "v2", None)] == ["v1", "v2", "v2"]
        assert Live(store, "v3").view().headline == "The store has no run of v3 yet."


def test_the_page_follows_what_is_written(tmp_path: Path):
    with running(tmp_path / "a.db") as (store, run), served(tmp_path / "a.db") as address:
        store.add(run, trial(0, fails=False))
        assert "Running: 1 of 50 rollouts" in read(address)[1]
        store.add(run, trial(2, fails=True))
        store.add(run, trial(1, fails=True))
        page = read(address)[1]
        assert "Running: 3 of 50 rollouts" in page
        assert "2 of 3 (" in page
        assert "one of the newest failures, proposal 1" in page
        assert '<meta http-equiv="refresh" content="5">' in page
        store.finish(run, "finished", 12.0)
        page = read(address)[1]
        assert "Finished: 3 of 50 rollouts in 12 s." in page
        assert '<meta http-equiv="refresh" content="30">' in page


def test_a_guided_run_shows_no_failure_rate_that_it_does_not_know(tmp_path: Path):
    with running(tmp_path / "a.db", "causes") as (store, run), Store.open(tmp_path / "a.db") as reader:
        store.add(run, trial(0, fails=True))
        facts = dict(Live(reader).view().facts)
    assert facts["Failed scenes"] == "1 of 1, which were chosen: no failure rate"
    assert facts["Failure rate in random scenes"].startswith("known when the run ends")


def test_reading_changes_nothing_in_the_store(tmp_path: Path):
    with running(tmp_path / "a.db") as (store, run):
        store.add(run, trial(0, fails=True))
        store.finish(run, "finished", 1.0)
    before = hashlib.sha256((tmp_path / "a.db").read_bytes()).digest()
    with served(tmp_path / "a.db") as address:
        assert read(address)[0] == 200
    assert hashlib.sha256((tmp_path / "a.db").read_bytes()).digest() == before
    assert [path.name for path in tmp_path.iterdir()] == ["a.db"]


def test_pages_elsewhere_cannot_read_it(tmp_path: Path):
    with running(tmp_path / "a.db"), served(tmp_path / "a.db") as address:
        assert address.startswith("http://127.0.0.1:")
        assert read(address, "rebound.example:80")[0] == 403
        assert read(f"{address}etc/passwd")[0] == 404
        assert read(address)[0] == 200
        assert "The store has no run yet" not in read(address)[1]


def test_idle_and_aborted_connections_hold_up_nobody_and_leave_no_traceback(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    with running(tmp_path / "a.db"), served(tmp_path / "a.db") as address:
        place = urlsplit(address)
        with ExitStack() as stack:
            for sent in (b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"):
                client = stack.enter_context(socket.create_connection((place.hostname, place.port)))
                client.sendall(sent)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            client.close()  # with a reset, while the page is made
            assert read(address)[0] == 200
    assert capfd.readouterr().err == ""


def test_a_browser_names_no_port_where_it_is_80(tmp_path: Path):
    with running(tmp_path / "a.db"), served(tmp_path / "a.db") as address:
        assert read(address, "localhost")[0] == 200
        assert read(address, "127.0.0.1.example")[0] == 403


def test_the_newest_failure_is_filmed_by_its_actions(tmp_path: Path, monkeypatch):
    asked = []

    class Runner:
        def __init__(self, source, run, policy):
            asked.append(policy)

        def film(self, scene, actions):
            return MadeUpFilms()(MANIFEST, scene, actions)

        def close(self):
            asked.append("closed")

    monkeypatch.setattr(filming.scene_runner, "SimulatorSceneRunner", Runner)
    monkeypatch.setattr(filming, "no_pictures", lambda task: "")
    films, newest = NewestFilm(tmp_path), trial(0, fails=True)
    assert films.of(newest, MANIFEST) is None
    while films.of(newest, MANIFEST) is None:
        time.sleep(0.01)
    shown, film = films.of(trial(1, fails=True), MANIFEST)  # not so soon again
    assert (shown, asked) == (newest, ["expert", "closed"])
    with running(tmp_path / "a.db") as (store, run), Store.open(tmp_path / "a.db") as reader:
        store.add(run, newest)
        page = render(Live(reader).view((shown, film)))
    assert page.count("data:video/mp4") == 1


def test_causes_are_kept_while_a_run_goes_on(tmp_path: Path, monkeypatch):
    from vlafuzz.campaign import causes, launch
    from vlafuzz.campaign.config import RunConfig, plan

    monkeypatch.setattr(causes, "EVERY", 0.0)  # after each outcome: no clock decides what is kept
    monkeypatch.setattr(causes, "SHARE", float("inf"))
    monkeypatch.setattr(launch, "make_evaluator", lambda *_: ClosedForm())
    path, seen = tmp_path / "a.db", []

    def watch(tally):
        if tally.causes:
            with Store.open(path) as store:
                kept = store.causes(tally.run)
            seen.append(len(kept.causes) if kept else 0)

    planned = plan(RunConfig(policy="pinhole", strategy="causes", budget=150, seed=1, store=path, workers=1))
    launch.start(planned, watch)
    assert max(seen[:-1]) > 0


def test_a_missing_store_or_a_wrong_port_is_said(tmp_path: Path, capsys):
    assert "no such store" in typed(capsys, ["report", "--follow", str(tmp_path / "none.db")], code=2).err
    assert main(["report", "--follow", str(tmp_path), "--port", "99999"]) == 2
    assert "error: --port: expected at most 65535" in capsys.readouterr().err
