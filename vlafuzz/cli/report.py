"""``vlafuzz report``."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.output import progress, stderr
from vlafuzz.errors import UsageError, VlafuzzError

if TYPE_CHECKING:
    from vlafuzz.evidence import Actions
    from vlafuzz.report.view import View
    from vlafuzz.scene import Scene
    from vlafuzz.sim.base import Film
    from vlafuzz.store.records import Manifest
    from vlafuzz.triage.scene_runner import SimulatorSceneRunner


def command(
    source: Annotated[
        Path,
        typer.Argument(help="A store that `vlafuzz run` wrote, or an exported corpus.", metavar="STORE|DIR"),
    ],
    out: Annotated[Path, typer.Option(help="The page to write.")],
    videos: Annotated[
        bool, typer.Option("--videos/--no-videos", help="Film the failures and their witnesses.")
    ] = True,
    limit: Annotated[int, typer.Option(help="Most findings that get videos.")] = 50,
) -> None:
    """Write one HTML page that shows what was found. It needs no network and no other file."""
    if limit < 1:
        raise UsageError(
            f"--limit: expected at least 1, got {limit}", hint="leave videos out with --no-videos"
        )
    from vlafuzz.report.page import check_place, render, write_page

    view = _view(source)
    check_place(out)  # before minutes go by
    if videos and view.cards:
        view = _with_films(source, view, limit)
    write_page(out, render(view))
    stderr().print(f"written: {out} ({out.stat().st_size / 1e6:.1f} MB)", soft_wrap=True)


def _view(source: Path) -> View:
    from vlafuzz.regression.folder import locate, read_corpus
    from vlafuzz.report.exported import view_of_corpus
    from vlafuzz.report.store import view_of_store
    from vlafuzz.store.store import Store

    source = locate(source)
    if source.is_dir():
        return view_of_corpus(source, read_corpus(source))
    if not source.is_file():
        raise UsageError(f"{source}: no such store or corpus", hint="`vlafuzz run` says where its store is")
    with Store.open(source) as store:
        return view_of_store(store)


def _with_films(source: Path, view: View, limit: int) -> View:
    """The view with films, or with a note that says why there are none."""
    from vlafuzz.renderer import probe
    from vlafuzz.report.films import filmed

    renderer = probe()
    if not renderer.works:
        return _without_films(view, f"{renderer}; `vlafuzz doctor` says what to install")
    films = _Films(source)
    try:
        with closing(films), progress() as bar:
            task = bar.add_task("films", total=None)
            return filmed(view, films, limit, lambda done, of: bar.update(task, completed=done, total=of))
    except KeyboardInterrupt:
        stderr().print("interrupted: nothing is written\nhint: --no-videos takes no time")
        raise typer.Exit(130) from None
    except VlafuzzError as error:
        return _without_films(view, error.message)


def _without_films(view: View, reason: str) -> View:
    told = f"No videos: {reason}."
    stderr().print(f"note: {told[0].lower()}{told[1:]}", soft_wrap=True)
    return replace(view, notes=(*view.notes, told))


class _Films:
    """Films by the desk of the run at hand: starting a simulator takes seconds."""

    def __init__(self, source: Path) -> None:
        self._source = source
        self._run: Manifest | None = None
        self._desk: SimulatorSceneRunner | None = None

    def __call__(self, run: Manifest, scene: Scene, actions: Actions | None) -> Film | None:
        from vlafuzz.triage import scene_runner as runner

        if self._desk is None or run != self._run:
            self.close()
            self._run, self._desk = run, runner.SimulatorSceneRunner(self._source, run)
        return self._desk.film(scene, actions)

    def close(self) -> None:
        if self._desk is not None:
            self._desk.close()
            self._desk = None
