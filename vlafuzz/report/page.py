"""Views and sheets as self-contained HTML pages."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from vlafuzz import __version__
from vlafuzz.errors import UsageError
from vlafuzz.report.sheet import Sheet
from vlafuzz.report.view import BUCKETS, View
from vlafuzz.sim.base import FILM_SPEED
from vlafuzz.text import interval, percent


def render(view: View) -> str:
    """A view as one HTML page without external resources."""
    return _template("page.html.j2").render(view=view, buckets=BUCKETS, speed=FILM_SPEED, version=__version__)


def render_sheet(sheet: Sheet) -> str:
    """A sheet as one HTML page without external resources."""
    return _template("sheet.html.j2").render(sheet=sheet, version=__version__)


def _template(name: str) -> Template:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,  # names and instructions are untrusted text
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"percent": percent, "data": _data}
    environment.globals["interval"] = interval
    return environment.get_template(name)


def _data(content: bytes, kind: str) -> str:
    return f"data:{kind};base64,{b64encode(content).decode('ascii')}"


def check_place(out: Path) -> None:
    """Whether a page can be written there.

    Raises:
        UsageError: it cannot.
    """
    if out.is_dir():
        raise UsageError(f"{out}: is a folder", hint="give --out a file, such as page.html")
    _write(out, "").unlink()


def write_page(out: Path, page: str) -> None:
    """Write it whole or not at all.

    Raises:
        UsageError: it cannot be written there.
    """
    beside = _write(out, page)
    try:
        beside.replace(out)
    except OSError as error:
        raise _complaint(out, error) from None
    finally:
        beside.unlink(missing_ok=True)


def _write(out: Path, page: str) -> Path:
    """Beside its place: where that is."""
    beside = out.with_name(f".{out.name}.part")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        beside.write_text(page, encoding="utf-8")
    except OSError as error:
        raise _complaint(out, error) from None
    return beside


def _complaint(out: Path, error: OSError) -> UsageError:
    reason = (error.strerror or "unknown reason").lower()
    return UsageError(f"{out}: cannot be written: {reason}", hint="name a file in a folder of yours")
