import json
import re
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from tests.doubles import scene, stored
from tests.report.stores import MANIFEST, MadeUpFilms, store, view
from vlafuzz.errors import SceneError, StoreError
from vlafuzz.model import Scene
from vlafuzz.report.films import beside, filmed
from vlafuzz.report.page import check_place, render, write_page
from vlafuzz.store.store import Store

HOSTILE = "</script><script>alert('x')</script><b title=\"&amp;\">"


class Page(HTMLParser):
    """The tags of a page with their attributes, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text, self.source = "", page
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data

    def data(self, name: str) -> Any:
        """The JSON of a script."""
        return json.loads(re.search(rf'id="{name}">(.*?)</script>', self.source)[1])

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def page_of(path: Path, films: bool = False) -> Page:
    shown = view(path)
    return Page(render(filmed(shown, partial(beside, MadeUpFilms()), 50, lambda *_: None) if films else shown))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Page:
    return page_of(store(tmp_path_factory.mktemp("folder-of-store") / "a.db", triaged=4), films=True)


def test_the_page_refers_to_nothing_outside(page: Page):
    for name in ("src", "href", "poster"):
        values = [attributes[name] for _, attributes in page.tags if name in attributes]
        assert all(value.startswith(("data:", "#")) for value in values)
    assert not re.search(r"url\((?!#)|@import|https?://(?!www.w3.org/)", page.text)
    assert "folder-of-store" not in page.source  # where the store is
    assert {"default-src 'none'" in (meta.get("content") or "") for meta in page.all("meta")} == {True, False}


def test_each_card_has_films_in_step_three_where_a_solution_is_known(page: Page):
    assert len(page.all("article")) == 4
    assert len(page.all("video")) == 2 * 3 + 2 * 2
    assert all(video.keys() >= {"muted", "playsinline", "poster", "data-film"} for video in page.all("video"))
    for said in ("nominal: passes", "this scene: fails at grasp", "reference: solves it (camera-only expert)"):
        assert page.text.count(f"{said}\n") >= 2
    assert len([slider for slider in page.all("input") if slider["type"] == "range"]) == 4
    assert len(page.data("films")) == 1  # however many cards show it


def test_the_hand_s_paths_of_policy_and_reference_lie_over_the_failure_where_a_solution_is_known(page: Page):
    drawn = [(one["class"], one["points"].split()) for one in page.all("polyline")]
    over = [one for one in drawn if one[1][0] == "9,9"]
    assert over == [("fails", ["9,9", "39,40"]), ("solves", ["9,9", "30,40"])] * 2
    assert page.text.count("path of the hand:") == 2


def test_every_card_has_a_title_that_says_the_cause_and_an_anchor_that_links_point_to(page: Page):
    ids = [card["id"] for card in page.all("article")]
    assert ids == ["cause-1", "cause-2", "failure-1", "failure-2"]
    assert {f"#{one}" for one in ids} <= {link["href"] for link in page.all("a")}
    assert "The camera turns left by at least 2" in page.text
    assert "The light is at most 0." in page.text
    assert "not nominal" not in page.text


def test_foreign_text_stays_text(tmp_path: Path):
    page = page_of(store(tmp_path / "a.db", policy=HOSTILE), films=True)
    assert len(page.all("script")) == 5
    assert HOSTILE in page.text
    assert "b" not in {name for name, attributes in page.tags if "title" in attributes}


def test_an_empty_store_gives_a_page_that_says_so(tmp_path: Path):
    Store.open(tmp_path / "a.db", "write").close()
    page = page_of(tmp_path / "a.db")
    assert "There are no failures to show" in page.text
    assert page.all("select") == []


def test_fifty_causes_with_films_make_a_page_below_five_megabytes(tmp_path: Path):
    """A failure of 16 seconds takes about 27 kB, a solution 15 kB, a picture 5 kB; the nominal film is one for all."""
    made = MadeUpFilms()

    def films(run, scene, actions):
        film = made(run, scene, actions)
        number = len(made.requests) * (film.failed or actions is not None)
        return replace(film, video=number.to_bytes(2) * (13_500 if film.failed else 7_500), still=b"a" * 5_000)

    shown = view(store(tmp_path / "a.db", triaged=1))
    causes = tuple(replace(shown.causes[0], id=f"cause-{number}") for number in range(50))
    page = render(filmed(replace(shown, causes=causes), partial(beside, films), 50, lambda *_: None))
    assert page.count("<video") == 150
    assert len(page.encode()) < 5e6


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


UNSEEN = "mini\x1b[31m\u202e\x00 --policy x\r\u2066"


def test_nothing_unseen_reaches_a_page_nor_its_copy_button(tmp_path: Path):
    shown = view(store(tmp_path / "a.db", findings=1))
    cards = tuple(replace(card, of=replace(card.of, replay=UNSEEN)) for card in shown.causes)
    hostile = replace(shown, title=UNSEEN, causes=cards)
    page = render(hostile)
    assert r"mini\x1b[31m\u202e\x00 --policy x\r\u2066" in page
    assert not [sign for sign in page if not sign.isprintable() and sign not in "\n\t\u2009\u202f\u00a0"]


@pytest.mark.parametrize("sign", ["\x1b", "\u202e", "\u2066", "\x00", "\x7f"])
def test_unseen_signs_in_scenes_and_runs_are_refused(sign: str, tmp_path: Path):
    with pytest.raises(SceneError, match="signs that cannot be seen"):
        Scene.from_json(json.dumps(json.loads(scene().to_json()) | {"instruction": f"a{sign}b"}))
    path = stored(tmp_path / "a.db", about=replace(MANIFEST, policy=f"a{sign}b"))
    with Store.open(path) as opened, pytest.raises(StoreError, match="signs that cannot be seen"):
        opened.runs()
