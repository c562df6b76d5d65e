"""The pages in a browser: they load, filter and play."""

import shutil
import subprocess
import tarfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import pytest

from tests.doubles import begun, ended
from tests.failures.corpus.sides import Planned
from tests.failures.triage.planted import SPACE
from tests.report.stores import MANIFEST, MadeUpFilms, store, view
from vlafuzz.failures.corpus.diff import diff, known
from vlafuzz.lab.comparison import Counted, compare_runs, view_of_comparison
from vlafuzz.report.differences import view_of_difference
from vlafuzz.report.films import beside, filmed, of_both
from vlafuzz.report.page import render
from vlafuzz.report.sources import view_of_store
from vlafuzz.store.store import Store

sync = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: it comes with .[dev]")
CHROMIUM = shutil.which("chromium")
PAGES = ["report", "diff", "compare", "live"]
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")


@pytest.fixture(scope="module")
def addresses(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The pages of ``report``, ``diff``, ``compare`` and of a run that goes on."""
    folder = tmp_path_factory.mktemp("pages")
    source, films = store(folder / "a.db", triaged=1), MadeUpFilms()
    shown, of_one = view(source), partial(beside, films)
    found, both = known(source), (Planned(lambda *_: False, name="idle"), Planned(lambda *_: True, name="other"))
    difference = diff(found, replace(found, causes={}, probes=[]), both, both)
    judged = {"rollouts": 12, "triage_rollouts": 60, "triaged": 3, "causes": 1, "failures": 4, "probability": None}
    names = {name: [card.of.signature for card in shown.causes[:most]] for most, name in enumerate(("random", "nsga2"))}
    runs = [Counted(run=1, strategy=name, seed=0, signatures=found, **judged) for name, found in names.items()]
    comparison = compare_runs(runs, list(names), MANIFEST, store="a.db", limit=200)
    with Store.open(source, "write") as opened:
        begun(opened, ended(SPACE.nominal()), about=MANIFEST)
        (folder / "live.html").write_text(render(view_of_store(opened), refresh=600), encoding="utf-8")
    views = {
        "report": (shown, of_one),
        "diff": (view_of_difference(shown, shown, difference), partial(of_both, ("idle", "other"), (films, films))),
        "compare": (view_of_comparison(comparison, shown), of_one),
    }
    for name, (one, shots_of) in views.items():
        (folder / f"{name}.html").write_text(render(filmed(one, shots_of, 50, lambda *_: None)), encoding="utf-8")
    return {name: (folder / f"{name}.html").as_uri() for name in PAGES}


@pytest.fixture(scope="module")
def browser() -> Iterator["sync.Browser"]:
    with sync.sync_playwright() as playwright:
        # no sandbox: as root there is none, and the page is ours
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The source of axe-core, which npm fetches."""
    folder = tmp_path_factory.mktemp("axe")
    if shutil.which("npm") is None or subprocess.run(["npm", "pack", "axe-core@4.10.2"], cwd=folder).returncode:
        pytest.skip("npm gets no axe-core here")
    with tarfile.open(next(folder.glob("*.tgz"))) as packed:
        return packed.extractfile("package/axe.min.js").read().decode()


@pytest.fixture
def page(browser: "sync.Browser", addresses: dict[str, str], request) -> Iterator["sync.Page"]:
    """The open page, by default a report; asserts in the end that it logged and requested nothing."""
    address = addresses[getattr(request, "param", "report")]
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
    return page.locator(".gallery .card:visible").count()


def output(page: "sync.Page") -> str:
    return page.locator(".filters output").inner_text()


def test_filters_narrow_the_gallery_live_in_the_address_and_reset(page: "sync.Page"):
    assert (shown(page), output(page)) == (5, "5 of 5 shown")
    assert page.locator(".filters select[name]").evaluate_all("(all) => all.map((one) => one.name)") == ["operator"]
    assert page.get_by_role("button", name="Reset").is_disabled()
    page.locator("select[name=operator]").select_option("wording")
    assert (shown(page), output(page)) == (4, "4 of 5 shown")
    assert page.url.endswith("#operator=wording")
    page.get_by_role("button", name="Reset").click()
    # The reset itself sets the output, a moment before the cards follow.
    eventually(page, "document.querySelectorAll('.gallery .card:not([hidden])').length === 5")
    assert "#" not in page.url


def test_an_address_brings_its_filters(page: "sync.Page"):
    page.evaluate("location.hash = 'light.intensity=0.5..1.2'")
    eventually(page, "document.querySelectorAll('.gallery .card:not([hidden])').length === 2")
    assert page.get_by_label("Highest light intensity").input_value() == "1.2"


def test_dragging_over_a_plot_lists_the_failures_there(page: "sync.Page"):
    plot = page.locator(".plot", has_text="light intensity").last.locator("svg")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    page.mouse.move(box["x"] + box["width"] * 0.43, box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.6, box["y"] + 60)
    page.mouse.up()
    eventually(page, "document.querySelectorAll('.gallery .card:not([hidden])').length === 2")
    assert "light.intensity=" in page.url


def test_films_of_a_card_play_in_step_and_pause(page: "sync.Page"):
    page.get_by_role("button", name="Play the films of").first.click()
    times = "[...document.querySelectorAll('#cause-1 video')].map((video) => video.currentTime)"
    eventually(page, f"Math.min(...{times}) > 0.2")
    page.get_by_role("button", name="Pause the films of").click()
    first, *others = page.evaluate(times)
    assert all(abs(other - first) < 0.3 for other in others)
    assert page.evaluate("[...document.querySelectorAll('video')].every((video) => video.paused)")


def test_the_keyboard_steps_through_the_films(page: "sync.Page"):
    slider = page.get_by_label("Moment in the films of").first
    assert slider.input_value() == "3"  # where the failure makes no progress any more
    slider.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert (slider.input_value(), slider.get_attribute("aria-valuetext")) == ("5", "1.0 s")
    eventually(page, "Math.abs(document.querySelector('video').currentTime - 5.5 / 15) < 0.01")


def test_everything_that_can_be_clicked_can_be_reached_by_keyboard(page: "sync.Page"):
    reached = set()
    for _ in range(150):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.outerHTML.slice(0, 60)"))
    for part in ("#method", 'class="badge', 'class="term"', 'class="play"', "<input type=", "<summary>", "<select"):
        assert any(part in one for one in reached), part


def test_the_hand_s_path_is_that_of_the_camera_that_the_film_shows_at_the_moment(page: "sync.Page"):
    slider, paths = page.get_by_label("Moment in the films of").first, page.locator(".films .paths").first.locator("g")
    for frame, visible in (("3", [True, False]), ("9", [False, True]), ("0", [True, False])):
        slider.fill(frame)
        assert [one.is_visible() for one in paths.all()] == visible


def test_dragging_along_a_row_of_lines_chooses_a_range_of_its_axis(page: "sync.Page"):
    plot = page.locator(".plot", has_text="a line each")
    plot.scroll_into_view_if_needed()
    box, name = plot.locator(".overlay").nth(1).bounding_box(), plot.locator(".name text").nth(1).text_content()
    page.mouse.move(box["x"] + box["width"] * 0.3, box["y"] + 5)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.6, box["y"] + 9)
    page.mouse.up()
    page.get_by_label(f"Highest {name}").wait_for(timeout=5000)


def test_a_map_is_red_where_random_scenes_fail_blue_where_they_pass_and_bare_elsewhere(page: "sync.Page"):
    scenes = [{"random": 1, "failed": x > 4, "x": x, "y": y} for x in range(11) for y in range(6)]
    cells = page.evaluate("(all) => ground(all, {low: 0, high: 10}, {low: 0, high: 20}, 24)", scenes)
    share = {cell["x1"] < 5: cell["fill"].split("%")[0].split()[-1] for cell in cells if not 1 < cell["x1"] < 9}
    assert (share, max(cell["y2"] for cell in cells) < 15) == ({True: "0", False: "100"}, True)


def test_a_dot_opens_its_card(page: "sync.Page"):
    dot = page.locator(".plot a").first
    card = dot.evaluate("(link) => link.href.baseVal")
    dot.focus()
    page.keyboard.press("Enter")
    eventually(page, f"location.hash === '{card}'")


def test_a_dot_shows_the_picture_of_its_card_while_it_is_pointed_at(page: "sync.Page"):
    dot = page.locator(".plot").first.locator("a").last  # no other one lies on it
    dot.hover(force=True)
    card = dot.evaluate("(link) => link.href.baseVal")
    poster = page.locator(f"{card} .fails video").get_attribute("poster")
    assert page.locator("img.preview").get_attribute("src") == poster
    page.mouse.move(0, 0)
    assert page.locator("img.preview").count() == 0


def test_method_is_folded_up_until_it_is_asked_for(page: "sync.Page"):
    assert not page.get_by_text("stages reached").is_visible()
    page.get_by_role("link", name="Method").click()
    page.get_by_text("stages reached").wait_for(state="visible")


@pytest.mark.parametrize("page", PAGES, indirect=True)
@pytest.mark.parametrize("width", [420, 1400])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_the_window(page: "sync.Page", width: int, scheme):
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": width, "height": 900})
    page.evaluate("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    assert page.evaluate("document.documentElement.scrollWidth") == width
    left = "(one) => one.getBoundingClientRect().left"
    reach = f"all('.plot').flatMap((plot) => all('text', plot).map((text) => ({left})(text) - ({left})(plot)))"
    assert min(page.evaluate(reach)) >= 0  # no label lies on the plot beside it


@pytest.mark.parametrize(("width", "last"), [(1400, "solves"), (420, "fails")])
def test_the_sentence_and_the_first_films_are_on_the_first_screen(page: "sync.Page", width: int, last: str):
    page.set_viewport_size({"width": width, "height": 900})
    for part in (".sentence", f".card figure.{last} video"):
        box = page.locator(part).first.bounding_box()
        assert box["y"] + box["height"] < 900


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, indirect=True)
@pytest.mark.parametrize("width", [420, 1400])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_violation_with_everything_unfolded(page: "sync.Page", axe: str, width: int, scheme):
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": width, "height": 900})
    page.evaluate("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    page.evaluate(axe)
    found = page.evaluate("axe.run(document, {resultTypes: ['violations']})")
    assert [(one["id"], one["nodes"][0]["html"]) for one in found["violations"]] == []


@pytest.mark.parametrize("page", PAGES, indirect=True)
def test_in_print_there_are_two_pages_without_controls(page: "sync.Page"):
    page.emulate_media(media="print")
    assert not page.locator(".filters").is_visible()
    assert not any(one.is_visible() for one in page.locator(".play").all())
    assert page.pdf(format="A4").count(b"/Type /Page\n") <= 2
