"""Views as self-contained HTML pages."""

import json
from base64 import b64encode
from dataclasses import asdict
from functools import cache
from hashlib import blake2b
from pathlib import Path
from tempfile import TemporaryFile
from time import strftime
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from vlafuzz import __version__
from vlafuzz.common.files import is_stream, write_whole, writing
from vlafuzz.common.text import interval, percent
from vlafuzz.errors import UsageError, printable
from vlafuzz.report.plots import ENOUGH, Plot
from vlafuzz.report.view import View
from vlafuzz.worlds.evaluator import FILM_SPEED, Film

MOST = 1500  # scenes that are drawn; of more an even selection


def render(view: View, *, refresh: int | None = None) -> str:
    """A view as one HTML page without external resources.

    Args:
        refresh: seconds after which the browser loads it again.
    """
    shown = [shot.film for card in view.cards for shot in card.shots if shot.film]
    films = {film_id(film): _encoded(film.video) for film in shown}
    page = environment().get_template("page.html.j2")
    plots = [_plot_data(plot, view) for plot in view.plots]
    made = page.render(
        view=view, plots=_script(plots), films=_script(films), speed=FILM_SPEED, version=__version__, refresh=refresh
    )
    for source in map(Path, view.source.split(", ")):
        if source.is_absolute() and source.parent.name:
            made = made.replace(f"{source.parent}/", "")  # a page is sent around
    return made


def film_id(film: Film) -> str:
    """The name of a film in a page, where equal ones are one."""
    return blake2b(film.video, digest_size=6).hexdigest()


def _plot_data(plot: Plot, view: View) -> dict[str, Any]:
    """What ``page.js`` draws: axes with their curves, scenes, and the cards among them."""
    shown = [(card, card.of) for card in view.cards if card.plot is plot and card.of]
    cards = {digest: card.id for card, of in shown for digest in (of.scene.digest, *of.found, *card.more)}
    bands = [(band, card.title) for card, _ in shown for band in card.bands]
    axes = []
    for axis in plot.axes:
        on = [(one, title) for one, title in bands if (one.operator, one.quantity) == (axis.operator, axis.quantity)]
        ranges = [[max(band.low, axis.low), min(band.high, axis.high), title] for band, title in on]
        axes.append(asdict(axis) | {"id": axis.id, "bands": ranges})
    return {
        "title": plot.title,
        "random": plot.random,
        "enough": ENOUGH,
        "axes": axes,
        "severity": asdict(plot.severity) | {"bands": []} if plot.severity else None,
        "points": [
            [int(failed), int(drawn), cards.get(scene.digest), *plot.values(scene)]
            for scene, failed, drawn in plot.scenes[:: -(-len(plot.scenes) // MOST)]
        ],
        "cards": {card.id: plot.values(of.scene) for card, of in shown},
        "maps": [asdict(one) for one in plot.maps],
    }


def _script(data: object) -> Markup:
    """JSON in ASCII that cannot end the element it is in; numbers have four digits, as much as one sees."""
    short = json.loads(json.dumps(data), parse_float=lambda text: float(f"{float(text):.4g}"))
    return Markup(json.dumps(short, separators=(",", ":")).replace("<", r"\u003c"))


@cache
def environment() -> Environment:
    """The templates of pages."""
    folder = Path(__file__).parent
    made = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,  # names and instructions are untrusted text, in which signs may hide something
        finalize=lambda shown: printable(shown) if isinstance(shown, str) and not isinstance(shown, Markup) else shown,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {
        "percent": percent,
        "film_id": film_id,
        "data": lambda content, kind: f"data:{kind};base64,{_encoded(content)}",
    }
    made.globals |= {"interval": interval, "now": strftime, "library": (folder / "plot.min.js").read_text}
    return made


def _encoded(content: bytes) -> str:
    return b64encode(content).decode("ascii")


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
