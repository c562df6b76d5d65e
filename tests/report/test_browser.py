"""The page in a browser: it loads, filters and plays."""

import io
import shutil
from collections.abc import Iterator
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from tests.report.stores import MadeUpFilms, store, view
from vlafuzz.report.films import filmed
from vlafuzz.report.page import render, render_sheet
from vlafuzz.report.view import Picture, Table, View

sync = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: it comes with .[dev]")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("page")
    shown = filmed(view(store(folder / "a.db", triaged=3)), MadeUpFilms(), 50, lambda *_: None)
    (folder / "page.html").write_text(render(shown), encoding="utf-8")
    return (folder / "page.html").as_uri()


@pytest.fixture(scope="module")
def browser() -> Iterator["sync.Browser"]:
    with sync.sync_playwright() as playwright:
        # no sandbox: as root there is none, and the page is ours
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def page(browser: "sync.Browser", address: str) -> Iterator["sync.Page"]:
    """The open page; asserts in the end that it logged and requested nothing."""
    page = browser.new_page(viewport={"width": 1400, "height": 1000})
    events: list[str] = []
    page.on("console", lambda message: events.append(message.text))
    page.on("pageerror", lambda error: events.append(str(error)))
    page.on("request", lambda request: events.append(request.url))
    page.goto(address)
    yield page
    page.close()
    assert [event for event in events if event != address and not event.startswith("data:")] == []


def eventually(page: "sync.Page", expression: str) -> None:
    """Playwright waits by eval, which the page forbids."""
    for _ in range(100):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(50)
    raise AssertionError(expression)


def shown(page: "sync.Page") -> int:
    return page.locator(".card:visible").count()


def test_filters_narrow_the_gallery_together_and_reset(page: "sync.Page"):
    assert (shown(page), page.locator("output").inner_text()) == (6, "6 of 6 shown")
    assert page.get_by_role("button", name="Reset").is_disabled()
    page.locator("select[name=evidence]").select_option("minimal")
    assert (shown(page), page.locator("output").inner_text()) == (3, "3 of 6 shown")
    assert page.locator("select[name=operator] option[value=light]").inner_text() == "light (0)"
    page.locator("select[name=operator]").select_option("light")
    assert shown(page) == 0
    assert page.get_by_text("No finding matches").is_visible()
    page.get_by_role("button", name="Reset").click()
    # The reset itself sets the output, a moment before the cards follow.
    eventually(page, "document.querySelectorAll('.card:not([hidden])').length === 6")
    assert (shown(page), page.locator("output").inner_text()) == (6, "6 of 6 shown")


def test_a_video_in_sight_plays_and_pauses(page: "sync.Page"):
    video = "document.querySelector('video')"
    page.locator("video").first.scroll_into_view_if_needed()
    eventually(page, f"{video}.currentTime > 0.2 && !{video}.paused")
    page.locator("button.film").first.focus()
    page.keyboard.press("Enter")
    eventually(page, f"{video}.paused")
    page.get_by_role("button", name="Pause videos").click()
    eventually(page, "[...document.querySelectorAll('video')].every((video) => video.paused)")
    page.get_by_role("button", name="Play videos").click()
    eventually(page, f"!{video}.paused")


@pytest.mark.parametrize("width", [390, 1400])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_the_window(page: "sync.Page", width: int, scheme):
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": width, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") == width


@pytest.mark.parametrize("width", [390, 1400])
def test_a_sheet_scrolls_its_tables_and_pictures_not_the_window(browser: "sync.Browser", tmp_path: Path, width: int):
    picture = io.BytesIO()
    imageio.imwrite(picture, np.zeros((40, 1200, 3), np.uint8), extension=".png")
    rows = [{f"column {number}": "1.23 (1.11–1.35)" for number in range(20)}]
    sheet = View(
        title="a",
        source="a.db",
        headline="b",
        pictures=(Picture("c", picture.getvalue(), "d"),),
        tables=(Table("e", rows),),
    )
    (tmp_path / "sheet.html").write_text(render_sheet(sheet), encoding="utf-8")
    page = browser.new_page(viewport={"width": width, "height": 800})
    page.goto((tmp_path / "sheet.html").as_uri())
    assert page.evaluate("document.querySelector('img').naturalWidth") == 1200
    assert page.evaluate("document.querySelector('table').scrollWidth") > width
    assert page.evaluate("document.documentElement.scrollWidth") == width
    page.close()


def test_in_print_there_are_cards_and_no_controls(page: "sync.Page"):
    page.emulate_media(media="print")
    assert shown(page) == 6
    assert not page.locator(".filters").is_visible()
