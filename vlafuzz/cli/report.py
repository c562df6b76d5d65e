"""``vlafuzz report``: in the terminal, as a page, or as a page that follows a run."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import JsonFlag, TrustFlag, VideosFlag, option, refuse
from vlafuzz.cli.output import Bar, interruptible, print_json, print_lines, print_list
from vlafuzz.common.plugins import command as command_line
from vlafuzz.common.text import plural, size
from vlafuzz.errors import UsageError, VlafuzzError, check_number

if TYPE_CHECKING:
    from vlafuzz.failures.described import DescribedFailure
    from vlafuzz.report.films import RunFilms, ShotsOf
    from vlafuzz.report.view import View

FEW, FILMED = 20, 50  # failures that are listed, and that get videos, by default
REFRESH, TIMES = 10, 9  # seconds between two pages that follow a run; at least so many times what one computes
VALUES = 3  # operators of an untriaged failure that are shown with their values


def command(
    source: Annotated[
        Path, typer.Argument(help="A store that `vlafuzz run` wrote, or an exported corpus.", metavar="STORE|DIR")
    ],
    out: Annotated[Path | None, option("Write one HTML page.", "the terminal")] = None,
    follow: Annotated[
        bool, option("Write the page again while a run goes on; a browser reloads it.", flag="--follow")
    ] = False,
    limit: Annotated[
        int | None, option("Most that are listed, 0 for all; on a page, filmed.", f"{FEW}; {FILMED} on a page")
    ] = None,
    videos: VideosFlag = True,
    trust: TrustFlag = False,
    json: JsonFlag = False,
) -> None:
    """Say what was found: in the terminal, or with --out as one HTML page that needs no other file.

    Causes come first, the strongest first: those for which most random scenes fail. Failures with one minimal scene are
    listed as one.

    With --follow the page, by default STORE.html, has no videos. The store is read, never written.
    """
    from vlafuzz.failures.corpus.folder import locate

    if follow:
        refuse({"--limit": limit}, "has no effect with --follow")
    if follow or out:
        refuse({"--json": json or None}, "has an effect in the terminal only")
    check_number("--limit", limit, 1 if out else 0)
    if not locate(source).exists():
        raise UsageError(f"{source}: no such store or corpus", hint="`vlafuzz run` says where its store is")
    if follow:
        _follow(source, out or source.with_suffix(".html"))
    elif out:
        _write(source, out, limit, videos=videos)
    else:
        _list(source, FEW if limit is None else limit, json=json)


def _list(source: Path, limit: int, *, json: bool) -> None:
    """Print the failures: those of causes first, then others by evidence.

    A cause is the stronger the more random scenes fail for it; those that are not confirmed come last.
    """
    from vlafuzz.failures.described import BUCKETS
    from vlafuzz.failures.events import told
    from vlafuzz.failures.listed import listing_of

    found = listing_of(source)
    if json:
        from vlafuzz.stored import StoredResults, finding_of

        rows = StoredResults(source).findings() if source.is_file() else map(finding_of, found.failures)
        print_json([asdict(row) for row in sorted(rows, key=lambda row: BUCKETS.index(row.evidence))])
        return
    listed = found.failures
    shown = listed[: limit or None]
    failures = sum(len(one.found) for one in listed)
    apart = f", {failures - len(listed)} of them with the minimal scene of another" if len(listed) < failures else ""
    mixed = len({(run.model, run.task) for run in found.runs}) > 1
    title = f"{plural(failures, 'failure')}{apart}, the strongest causes first: {found.title}"
    print_list([_lines(one, mixed=mixed) for one in shown], title=title)
    if not shown:
        print_lines("no failures")
    print_lines(told(sum(one.before_event for one in listed)))
    print_lines(*(f"run {one.run}: {one.probability} of random scenes fail" for one in found.causes if one.probability))
    if len(shown) < len(listed):
        print_lines(f"{len(listed) - len(shown)} more: --limit 0 shows all of them")
    if shown:
        print_lines(f"see number 1: {shown[0].replay}")
    print_lines(*(f"{text} {line}" for text, line in found.todo))
    if any(one.bucket == "minimal" for one in listed) and not found.todo and source.is_file():
        names = [name for run in found.runs for name in (run.policy, run.task)]
        keep = command_line("export", source, "--minimal", "--out", "corpus", names=names)
        print_lines(f"keep the minimal ones as a corpus, for vlafuzz regress: {keep}")


def _lines(one: DescribedFailure, *, mixed: bool) -> list[str]:
    """Each value that is not nominal, and the evidence; in a store of several policies or tasks also whose it is."""
    from vlafuzz.failures.causes import EVIDENCE

    values = [f"{part.operator}: {part.range}" for part in one.deviations]
    if one.bucket == "observed" and len(values) > VALUES:
        values = [one.title]
    parts = (
        f"{one.run.short} on {one.scene.task}" if mixed else "",
        f"fails at: {one.stage}" if one.stage else "",
        f"{EVIDENCE[one.bucket]}: {one.detail}",
        f"{len(one.found)} failures" if len(one.found) > 1 else "",
        one.scene.digest[:12],
    )
    return [*(values or [one.title]), " · ".join(filter(None, parts))]


def _write(source: Path, out: Path, limit: int | None, *, videos: bool) -> None:
    if limit is not None and not videos:
        raise UsageError(f"--limit {limit}: with --no-videos there are none", hint="leave one of the two out")
    from vlafuzz.report.page import check_place
    from vlafuzz.report.sources import view_of

    view = view_of(source)
    check_place(out)  # before minutes go by
    write(out, with_own_films(view, source, limit or FILMED) if videos else view)


def write(out: Path, view: View) -> None:
    """Write a page, and say so."""
    from vlafuzz.report.page import render, write_page

    page = render(view)
    write_page(out, page)
    Bar.note(f"written: {out} ({size(len(page.encode()))})")


def with_own_films(view: View, source: Path, limit: int = FILMED) -> View:
    """The view of a store or corpus with films of its cards, beside what passes and what solves them."""
    from vlafuzz.report.films import RunFilms, beside

    films = RunFilms(source)
    return with_films(view, [films], partial(beside, films), limit)


def with_films(view: View, films: Sequence[RunFilms], shots_of: ShotsOf, limit: int) -> View:
    """The view with shots of these films, or with a note why there are none."""
    from vlafuzz.report.films import filmed
    from vlafuzz.worlds import no_pictures

    if not view.cards:
        return view
    problems = [no_pictures(task) for task in dict.fromkeys(run.task for run in view.runs)]
    if problems and all(problems):
        reason = problems[0]
    else:
        with interruptible("interrupted: nothing is written\nhint: --no-videos takes no time") as bar:
            try:
                with ExitStack() as stack:
                    for one in films:
                        stack.enter_context(closing(one))
                    return filmed(view, shots_of, limit, partial(bar.progress, "films"))
            except VlafuzzError as error:
                reason = error.message
    Bar.note(f"note: no videos: {reason}.")
    return replace(view, notes=(*view.notes, f"No videos: {reason}."))


def _follow(source: Path, out: Path) -> None:
    from vlafuzz.report.page import check_place, render, write_page
    from vlafuzz.report.sources import view_of

    check_place(out)
    sys.stderr.write(f"following {source}: open {out} in a browser; Ctrl-C ends it\n")
    try:
        write_page(out, render(view_of(source), refresh=REFRESH))  # takes long: it loads what the others need
        while True:
            began = time.process_time()
            write_page(out, render(view_of(source), refresh=REFRESH))
            time.sleep(max(REFRESH, TIMES * (time.process_time() - began)))
    except KeyboardInterrupt:
        write_page(out, render(view_of(source)))  # as it is to stay
