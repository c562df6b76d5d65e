"""``vlafuzz report``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import JsonFlag, TrustFlag, label_option, option
from vlafuzz.cli.output import Bar, data, interruptible
from vlafuzz.common.files import write_whole
from vlafuzz.common.text import size
from vlafuzz.errors import UsageError, VlafuzzError, check_number

if TYPE_CHECKING:
    from vlafuzz.report.view import View


TABLES = (".csv", ".md")  # endings of files
FEW, FILMED = 20, 50  # failures that are listed, and that get videos, by default


def command(
    source: Annotated[
        Path, typer.Argument(help="A store that `vlafuzz run` wrote, or an exported corpus.", metavar="STORE|DIR")
    ],
    out: Annotated[
        Path | None,
        option("Write one HTML page; or as .csv or .md how often each policy fails in each task.", "the terminal"),
    ] = None,
    follow: Annotated[
        bool, option("Follow a run on a page in the browser, until interrupted.", flag="--follow")
    ] = False,
    evidence: Annotated[str | None, option("List only those with this evidence, such as minimal.")] = None,
    limit: Annotated[
        int | None,
        option(
            "Most causes and failures that are listed, 0 for all; or on a page get videos.",
            f"{FEW}; {FILMED} on a page",
        ),
    ] = None,
    videos: Annotated[
        bool, option("Film the failures on a page, and their witnesses.", flag="--videos/--no-videos")
    ] = True,
    label: Annotated[str | None, label_option("--label", "Follow the last run of this model.", "the last run")] = None,
    port: Annotated[int | None, option("Where --follow listens on this machine.", "any port that is free")] = None,
    trust: TrustFlag = False,
    json: JsonFlag = False,
) -> None:
    """Say what was found: in the terminal, or with --out as one HTML page that needs no other file.

    Causes come first, the strongest first: those for which most random scenes fail. What hardly differs from a failure
    that is listed, or only adds operators to it, is counted with it.

    With --follow the page shows how far a run is, how often the policy fails, the causes so far, and the newest
    failure. Only this machine can open it; its address is printed. The store is read, never written.
    """
    table = out.suffix if out and out.suffix in TABLES else ""
    listing: dict[str, object] = {"--evidence": evidence, "--json": json or None}
    _refuse(follow, {"--out": out, "--limit": limit} | listing, "--follow")
    _refuse(bool(out), listing, "--out")
    _refuse(bool(table), {"--limit": limit, "--no-videos": None if videos else True}, f"a {table} file")
    _refuse(not follow, {"--label": label, "--port": port}, "the terminal and --out")
    if follow:
        _follow(source, label, port or 0, films=videos)
    elif out is None:
        _list(source, evidence, limit, json=json)
    elif table:
        _write_table(source, out)
    else:
        _write(source, out, limit, videos=videos)


def _refuse(applies: bool, flags: Mapping[str, object], to: str) -> None:
    """Refuse flags that say nothing to this form of a report."""
    for flag, value in flags.items():
        if applies and value is not None:
            raise UsageError(f"{flag} says nothing to {to}", hint="leave one of the two out")


def _list(source: Path, evidence: str | None, limit: int | None, *, json: bool) -> None:
    from vlafuzz.cli.findings import print_findings
    from vlafuzz.report.view import BUCKETS

    if evidence is not None and evidence not in BUCKETS:
        raise UsageError(f"--evidence: {evidence!r} is none", hint=f"one of {', '.join(BUCKETS)}")
    check_number("--limit", limit, 0)
    print_findings(source, view_of(source), evidence, FEW if limit is None else limit, json=json)


def _write_table(source: Path, out: Path) -> None:
    from vlafuzz.common.text import csv_table, markdown_table
    from vlafuzz.report.standings import standings_of
    from vlafuzz.store.store import Store

    with Store.open(source) as store:
        rows = standings_of(store)
    if out.suffix == ".csv":
        write_whole(out, csv_table([row.document() for row in rows]))
    else:
        write_whole(out, markdown_table([row.row() for row in rows]) + "\n")
    Bar.note(f"written: {out}")


def _write(source: Path, out: Path, limit: int | None, *, videos: bool) -> None:
    if limit is not None and not videos:
        raise UsageError(f"--limit {limit}: with --no-videos there are none", hint="leave one of the two out")
    check_number("--limit", limit, 1)
    from vlafuzz.report.page import check_place, render, write_page

    view = view_of(source)
    check_place(out)  # before minutes go by
    if videos and view.cards:
        view = _with_films(source, view, limit or FILMED)
    page = render(view)
    write_page(out, page)
    Bar.note(f"written: {out} ({size(len(page.encode()))})")


def _follow(source: Path, label: str | None, port: int, *, films: bool) -> None:
    check_number("--port", port, 0, 65535)
    from vlafuzz.report.follow import Films, PageServer, live_page
    from vlafuzz.report.live import Live
    from vlafuzz.store.store import Store

    with Store.open(source) as store:
        live, made = Live(store, label), Films(source) if films else None
        with PageServer(port, lambda: live_page(live, made)) as server, suppress(KeyboardInterrupt):
            data().write(f"{server.address}\n")
            data().flush()
            sys.stderr.write(f"following {source}; Ctrl-C ends it\n")
            server.serve_forever()


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
        reason = problems[0]
    else:
        with interruptible("interrupted: nothing is written\nhint: --no-videos takes no time") as bar:
            try:
                with closing(RunFilms(source)) as films:
                    return filmed(view, films, limit, partial(bar.progress, "films"))
            except VlafuzzError as error:
                reason = error.message
    Bar.note(f"note: no videos: {reason}.")
    return replace(view, notes=(*view.notes, f"No videos: {reason}."))
