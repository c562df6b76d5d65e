"""``vlafuzz report``."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import TrustFlag
from vlafuzz.cli.output import Bar, interruptible
from vlafuzz.common.text import size
from vlafuzz.errors import UsageError, VlafuzzError

if TYPE_CHECKING:
    from vlafuzz.report.view import View


def command(
    source: Annotated[
        Path,
        typer.Argument(help="A store that `vlafuzz run` wrote, or an exported corpus.", metavar="STORE|DIR"),
    ],
    out: Annotated[Path, typer.Option(help="The page to write.")],
    videos: Annotated[
        bool, typer.Option("--videos/--no-videos", help="Film the failures and their witnesses.")
    ] = True,
    trust: TrustFlag = False,
    limit: Annotated[
        int | None, typer.Option(help="Most findings that get videos.", show_default="50")
    ] = None,
) -> None:
    """Write one HTML page that shows what was found. It needs no network and no other file."""
    if limit is not None and not videos:
        raise UsageError(f"--limit {limit}: with --no-videos there are none", hint="leave one of the two out")
    if limit is not None and limit < 1:
        raise UsageError(
            f"--limit: expected at least 1, got {limit}", hint="leave videos out with --no-videos"
        )
    from vlafuzz.report.page import check_place, render, write_page

    view = view_of(source)
    check_place(out)  # before minutes go by
    if videos and view.cards:
        view = _with_films(source, view, 50 if limit is None else limit)
    page = render(view)
    write_page(out, page)
    Bar.note(f"written: {out} ({size(len(page.encode()))})")


def view_of(source: Path) -> View:
    """The view of a store or corpus; UsageError if there is none."""
    from vlafuzz.failures.corpus.folder import locate, read_corpus
    from vlafuzz.report.sources import view_of_corpus, view_of_store
    from vlafuzz.store.store import Store

    source = locate(source)
    if source.is_dir():
        return view_of_corpus(source, read_corpus(source))
    if not source.is_file():
        raise UsageError(f"{source}: no such store or corpus", hint="`vlafuzz run` says where its store is")
    with Store.open(source) as store:
        return view_of_store(store)


def _with_films(source: Path, view: View, limit: int) -> View:
    """The view with films, or with a note why there are none."""
    from vlafuzz.report.films import RunFilms, filmed
    from vlafuzz.worlds import no_pictures

    problems = [no_pictures(task) for task in dict.fromkeys(run.task for run in view.runs)]
    if problems and all(problems):
        return _without_films(view, problems[0])
    with interruptible("interrupted: nothing is written\nhint: --no-videos takes no time") as bar:
        try:
            with closing(RunFilms(source)) as films:
                return filmed(view, films, limit, partial(bar.progress, "films"))
        except VlafuzzError as error:
            return _without_films(view, error.message)


def _without_films(view: View, reason: str) -> View:
    Bar.note(f"note: no videos: {reason}.")
    return replace(view, notes=(*view.notes, f"No videos: {reason}."))
