"""Views and sheets as self-contained HTML pages."""

from base64 import b64encode
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from vlafuzz import __version__
from vlafuzz.common.files import is_stream, write_whole, writing
from vlafuzz.common.text import interval, percent
from vlafuzz.errors import UsageError, printable
from vlafuzz.failures.described import BUCKETS
from vlafuzz.report.view import SOLVERS, View
from vlafuzz.worlds.evaluator import FILM_SPEED


def render(view: View, *, refresh: int | None = None) -> str:
    """A view as one HTML page without external resources.

    Args:
        refresh: seconds after which the browser loads it again.
    """
    page = _environment().get_template("page.html.j2")
    return page.render(
        view=view, buckets=BUCKETS, solvers=SOLVERS, speed=FILM_SPEED, version=__version__, refresh=refresh
    )


def render_sheet(sheet: View) -> str:
    """A sheet as one HTML page without external resources."""
    return _environment().get_template("sheet.html.j2").render(sheet=sheet, version=__version__)


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
        "data": lambda content, kind: f"data:{kind};base64,{b64encode(content).decode('ascii')}",
    }
    environment.globals["interval"] = interval
    return environment


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
