"""``vlafuzz report``: the page that it writes, and the failures that it lists in the terminal."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from shutil import copy
from unittest.mock import Mock

import pytest

from tests.cli.typed import complaint, told, typed
from tests.doubles import ended, failed, scene
from tests.failures.corpus.corpora import make_corpus
from tests.report.stores import MANIFEST, MadeUpFilms, store
from vlafuzz.api import open_store
from vlafuzz.cli import main
from vlafuzz.errors import PrerequisiteError
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.rollouts import scene_runner as runner
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop import renderer
from vlafuzz.worlds.tabletop.renderer import Renderer


class FilmDesk:
    """A desk that films without a simulator; ``made`` are all of them."""

    made: list["FilmDesk"] = []  # noqa: RUF012

    def __init__(self, source: Path, run, policy=None) -> None:
        self.run, self.closed, self._films = run, False, MadeUpFilms()
        self.made.append(self)

    def film(self, scene, actions=None):
        assert not self.closed
        return self._films(self.run, scene, actions)

    def close(self) -> None:
        self.closed = True


@pytest.fixture(scope="module")
def triaged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with two triaged failures, which takes a while to make."""
    return store(tmp_path_factory.mktemp("triaged") / "a.db", triaged=2)


@pytest.fixture(autouse=True)
def place(triaged: Path, tmp_path: Path, monkeypatch) -> Path:
    """A folder with a triaged store, on a machine that renders."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(FilmDesk, "made", [])
    monkeypatch.setattr(runner, "SimulatorSceneRunner", FilmDesk)
    monkeypatch.setattr(renderer, "probe_once", lambda: Renderer("made up", None, None))
    copy(triaged, tmp_path / "a.db")
    return tmp_path


def videos(page: Path) -> int:
    return page.read_text(encoding="utf-8").count("<video")


def test_a_page_is_written_with_films_of_all_findings(capsys):
    printed = typed(capsys, ["report", "a.db", "--out", "page.html"])
    assert printed.out == ""
    assert printed.err.startswith("written: page.html (")
    assert videos(Path("page.html")) == 5 * 2 + 1
    assert [row.closed for row in FilmDesk.made] == [True, True]


@pytest.mark.parametrize(("options", "films"), [(["--no-videos"], 0), (["--limit", "1"], 3)])
def test_films_can_be_fewer(options, films):
    assert main(["report", "a.db", "--out", "page.html", *options]) == 0
    assert videos(Path("page.html")) == films


def test_without_a_renderer_the_page_says_why_there_are_no_videos(monkeypatch, capsys):
    monkeypatch.setattr(renderer, "probe_once", lambda: Renderer(None, None, "no Vulkan device"))
    assert "note: no videos: " in typed(capsys, ["report", "a.db", "--out", "page.html"]).err
    assert "No videos: " in Path("page.html").read_text()
    assert videos(Path("page.html")) == 0


def test_a_policy_that_cannot_be_had_costs_the_videos_only(monkeypatch, capsys):
    unreachable = PrerequisiteError("ws://here: nothing answers")
    monkeypatch.setattr(runner, "SimulatorSceneRunner", Mock(side_effect=unreachable))
    assert main(["report", "a.db", "--out", "page.html"]) == 0
    assert "No videos: ws://here: nothing answers." in Path("page.html").read_text()


def test_an_exported_corpus_has_a_page_too(place: Path):
    made = make_corpus()
    made.runs[0] = MANIFEST
    write_corpus(made, place / "dark")
    assert main(["report", "dark", "--out", "page.html"]) == 0
    assert videos(Path("page.html")) == 3


def test_a_page_follows_what_is_written_and_ends_as_it_is_to_stay(monkeypatch, capsys):
    pages: list[str] = []
    with Store.open(Path("a.db"), "write") as written:
        run = written.begin(replace(MANIFEST, budget=50))

        def wait(_: float) -> None:
            pages.append(Path("a.html").read_text())
            if len(pages) == 2:
                raise KeyboardInterrupt
            written.add(run, ended(scene(), failed()))

        monkeypatch.setattr("time.sleep", wait)
        assert "open a.html" in typed(capsys, ["report", "a.db", "--follow"]).err
    told = [f"searching: {done} of 50 rollouts done</b> at " in page for done, page in enumerate(pages)]
    assert told == [True, True]
    refreshed = ['id="follow" value="10"' in page for page in (*pages, Path("a.html").read_text())]
    assert refreshed == [True, True, False]


def test_interrupted_it_leaves_nothing(monkeypatch, place: Path):
    monkeypatch.setattr(FilmDesk, "film", Mock(side_effect=KeyboardInterrupt))
    assert main(["report", "a.db", "--out", "page.html"]) == 130
    assert not [path for path in place.iterdir() if "page" in path.name]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.db", "--out", "page.html"], "error: none.db: no such store or corpus"),
        (["empty", "--out", "page.html"], "error: empty/manifest.json: cannot be read"),
        (["a.db", "--out", "empty"], "error: empty: is a folder"),
        (["a.db", "--out", "a.db/page.html"], "error: a.db/page.html: cannot be written"),
        (["a.db", "--out", "page.html", "--limit", "0"], "error: --limit: expected at least 1, got 0"),
        (["none.db", "--follow"], "error: none.db: no such store or corpus"),
        (["a.db", "--follow", "--limit", "3"], "error: --limit 3: has no effect with --follow"),
        (["a.db", "--limit", "-1"], "error: --limit: expected at least 0"),
        (["a.db", "--out", "a.html", "--limit", "3", "--no-videos"], "error: --limit 3: with --no-videos there are"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(arguments, said, capsys, place: Path):
    (place / "empty").mkdir()
    assert complaint(capsys, ["report", *arguments]).startswith(said)


def test_each_finding_has_its_cause_evidence_and_id(capsys):
    found = told(capsys, "report a.db --json")
    minimal = [one for one in found if one["evidence"] == "minimal"]
    assert minimal
    assert found[: len(minimal)] == minimal  # the most evidence first
    assert all(one["operators"] and one["signature"] and "rollouts" in one["detail"] for one in minimal)
    shown = typed(capsys, "report a.db").out
    assert f"see number 1: vlafuzz replay a.db {minimal[0]['scene'][:12]}" in shown


def test_json_is_the_rows_of_python(capsys):
    printed = {row["found"]: row for row in told(capsys, "report a.db --json")}
    rows = open_store("a.db").findings()
    assert printed == {row.found: json.loads(json.dumps(asdict(row))) for row in rows}
    assert any(row["necessary"] and row["rate"] for row in printed.values())


def test_a_limit_says_how_many_are_left_out_and_what_to_do_next(capsys):
    shown = typed(capsys, "report a.db --limit 1").out
    assert f"{len(told(capsys, 'report a.db --json')) - 1} more: --limit 0 shows all of them" in shown
    assert "vlafuzz triage a.db" in shown


def test_a_corpus_has_findings_too(capsys):
    found = told(capsys, "report mini-pick-up --json")
    assert len(found) >= 20
    assert {one["witness"] for one in found} <= {"expert", "seeing"}
    assert {one["run"] for one in found} == {None}
