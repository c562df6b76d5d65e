import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.doubles import scene
from tests.failures.corpus.corpora import make_corpus
from tests.report.stores import MANIFEST, MadeUpFilms, store, view
from vlafuzz.errors import SceneError, StoreError
from vlafuzz.model.scene import Scene
from vlafuzz.report.films import filmed
from vlafuzz.report.page import check_place, render, write_page
from vlafuzz.report.sources import view_of_corpus
from vlafuzz.store.store import Store

HOSTILE = "</script><script>alert('x')</script><b title=\"&amp;\">"


class Page(HTMLParser):
    """The tags of a page with their attributes, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def page_of(path: Path, films: bool = False) -> Page:
    shown = view(path)
    return Page(render(filmed(shown, MadeUpFilms(), 50, lambda *_: None) if films else shown))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Page:
    return page_of(store(tmp_path_factory.mktemp("store") / "a.db"), films=True)


def test_the_page_refers_to_nothing_outside(page: Page):
    for name in ("src", "href", "poster"):
        values = [attributes[name] for _, attributes in page.tags if name in attributes]
        assert all(value.startswith("data:") for value in values)
    assert not re.search(r"url\(|@import|https?://", page.text)
    assert {"default-src 'none'" in (meta.get("content") or "") for meta in page.all("meta")} == {True, False}


def test_each_failure_has_a_card_with_two_films_that_say_what_they_are(page: Page):
    assert len(page.all("article")) == 6
    assert len(page.all("video")) == 12
    assert all(video.keys() >= {"muted", "loop", "playsinline", "poster"} for video in page.all("video"))
    films = [button for button in page.all("button") if button.get("class") == "film"]
    assert sum("idle fails" in (button["aria-label"] or "") for button in films) == 6
    assert "the witness solves it" in page.text
    assert "fails from yaw 2." in page.text
    assert "solved by the seeing expert, by what the camera shows" in page.text


def test_filters_offer_what_the_cards_have(page: Page):
    assert [select["name"] for select in page.all("select")] == ["task", "stage", "operator", "evidence"]
    offered = {option["value"] for option in page.all("option")}
    assert offered == {"", "pick-up", "grasp", "camera-orientation", "light", "minimal"}


def test_foreign_text_stays_text(tmp_path: Path):
    page = page_of(store(tmp_path / "a.db", policy=HOSTILE), films=True)
    assert len(page.all("script")) == 1
    assert HOSTILE in page.text
    assert "b" not in {name for name, attributes in page.tags if "title" in attributes}


def test_every_picture_has_a_description():
    corpus = make_corpus()
    corpus.runs[0] = MANIFEST
    (picture,) = Page(render(view_of_corpus(Path("dark"), corpus))).all("img")
    assert picture["alt"] == "The scene before anything moves: pick up green cube"


def test_an_empty_store_gives_a_page_that_says_so(tmp_path: Path):
    Store.open(tmp_path / "a.db", "write").close()
    page = page_of(tmp_path / "a.db")
    assert "there are no failures to show" in page.text
    assert page.all("select") == []


def test_the_same_store_gives_the_same_page(tmp_path: Path):
    path = store(tmp_path / "a.db", findings=1)
    assert render(view(path)) == render(view(path))


def test_a_page_replaces_the_one_before_and_leaves_nothing_beside_it(tmp_path: Path):
    out = tmp_path / "new" / "page.html"
    for text in ("one", "two"):
        check_place(out)
        write_page(out, text)
    assert [path.name for path in out.parent.iterdir()] == ["page.html"]
    assert out.read_text() == "two"


def test_a_witness_is_explained_only_where_one_is_filmed(tmp_path: Path):
    for triaged, expected in ((0, False), (3, True)):
        shown = view(store(tmp_path / f"{triaged}.db", triaged=triaged))
        page = render(filmed(shown, MadeUpFilms(), 50, lambda *_: None))
        assert ("Right, where there is one: the witness" in page) is expected


UNSEEN = "mini\x1b[31m\u202e\x00 --policy x\r\u2066"


def test_nothing_unseen_reaches_a_page_nor_its_copy_button(tmp_path: Path):
    shown = view(store(tmp_path / "a.db", findings=1))
    hostile = replace(
        shown, title=UNSEEN, cards=[replace(card, of=replace(card.of, replay=UNSEEN)) for card in shown.cards]
    )
    page = render(hostile)
    assert r"mini\x1b[31m\u202e\x00 --policy x\r\u2066" in page
    assert not [sign for sign in page if not sign.isprintable() and sign not in "\n\t\u2009\u202f\u00a0"]


@pytest.mark.parametrize("sign", ["\x1b", "\u202e", "\u2066", "\x00", "\x7f"])
def test_unseen_signs_in_scenes_and_runs_are_refused(sign: str, tmp_path: Path):
    with pytest.raises(SceneError, match="signs that cannot be seen"):
        Scene.from_json(json.dumps(json.loads(scene().to_json()) | {"instruction": f"a{sign}b"}))
    with Store.open(tmp_path / "a.db", "write") as opened:
        opened.begin(replace(MANIFEST, policy=f"a{sign}b"))
    with Store.open(tmp_path / "a.db") as opened, pytest.raises(StoreError, match="signs that cannot be seen"):
        opened.runs()
