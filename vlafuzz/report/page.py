"""Views and sheets as self-contained HTML pages."""

import json
import math
from base64 import b64encode
from functools import cache
from hashlib import blake2b
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from vlafuzz import __version__
from vlafuzz.common.files import is_stream, write_whole, writing
from vlafuzz.common.text import interval, percent
from vlafuzz.errors import UsageError, printable
from vlafuzz.report.effects import ENOUGH
from vlafuzz.report.plots import Plot
from vlafuzz.report.sheet import Sheet
from vlafuzz.report.view import View
from vlafuzz.worlds.evaluator import FILM_SPEED, Film


def render(view: View, *, refresh: int | None = None) -> str:
    """A view as one HTML page without external resources.

    Args:
        refresh: seconds after which the browser loads it again.
    """
    films = {film_id(shot.film): _encoded(shot.film.video) for card in view.cards for shot in card.shots}
    page = _environment().get_template("page.html.j2")
    plots = [_plot_data(plot, view) for plot in view.plots]
    return page.render(
        view=view, plots=_script(plots), films=_script(films), speed=FILM_SPEED, version=__version__, refresh=refresh
    )


def render_sheet(sheet: Sheet) -> str:
    """A sheet as one HTML page without external resources."""
    return _environment().get_template("sheet.html.j2").render(sheet=sheet, version=__version__, refresh=None)


def film_id(film: Film) -> str:
    """The name of a film in a page, where equal ones are one."""
    return blake2b(film.video, digest_size=6).hexdigest()


def _plot_data(plot: Plot, view: View) -> dict[str, Any]:
    """What ``page.js`` draws: axes with their curves, scenes, and the cards among them."""
    shown = [(card, card.of) for card in view.cards if card.plot is plot and card.of]
    cards = {digest: card.id for card, of in shown for digest in (of.scene.digest, *of.found, *of.alike)}
    bands = [(card.title, band) for card, _ in shown for band in card.bands]
    return {
        "title": plot.title,
        "random": len(plot.drawn),
        "enough": ENOUGH,
        "axes": [
            {
                **{name: getattr(axis, name) for name in ("id", "operator", "name", "unit", "log", "options")},
                "low": axis.low, "high": axis.high, "nominal": axis.nominal,
                "curve": [[_short(place), *map(_short, rate)] for place, rate in axis.curve],
                "bars": [[one.count, one.of, _short(one.low), _short(one.high)] for one in axis.bars],
                "bands": [[_short(one.low), _short(one.high), title] for title, one in bands if one.axis == axis.id],
            }
            for axis in plot.axes
        ],
        "points": [
            [int(one.failed), int(one.drawn), cards.get(one.digest), *map(_short, one.values)] for one in plot.shown
        ],
        "cards": {card.id: list(map(_short, plot.values(of.scene))) for card, of in shown},
        "maps": [vars(one) for one in plot.maps],
    }  # fmt: skip


def _short(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(f"{value:.4g}")


def _script(data: object) -> Markup:
    """JSON in ASCII that cannot end the element it is in."""
    return Markup(json.dumps(data, separators=(",", ":")).replace("<", r"\u003c"))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,  # names and instructions are untrusted text
        finalize=_shown,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "percent": percent,
        "film_id": film_id,
        "data": lambda content, kind: f"data:{kind};base64,{_encoded(content)}",
    }
    environment.globals["interval"] = interval
    return environment


def _encoded(content: bytes) -> str:
    return b64encode(content).decode("ascii")


def _shown(value: object) -> object:
    """What a page shows of a value: text without signs that hide something from whoever copies it."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def check_place(out: Path) -> None:
    """Raise a UsageError if no page can be written there."""
    if out.is_dir():
        raise UsageError(f"{out}: is a folder", hint="give --out a file, such as page.html")
    with writing(out):
        if not is_stream(out):
            TemporaryFile(dir=out.parent).close()


def write_page(out: Path, page: str) -> None:
    """Write atomically; a UsageError if the page cannot be written there."""
    with writing(out):
        write_whole(out, page)
