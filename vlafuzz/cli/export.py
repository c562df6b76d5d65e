"""``vlafuzz export``."""

from __future__ import annotations

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.output import Bar, progress, stderr
from vlafuzz.errors import CorpusError, PrerequisiteError, UsageError

if TYPE_CHECKING:
    from vlafuzz.regression.corpus import Corpus
    from vlafuzz.scene import Scene
    from vlafuzz.store.store import Store


FILES = (".jsonl", ".json")  # of scenes: there is no run and no verdict in them


class Wanted(StrEnum):
    """Which scenes."""

    failed = "failed"
    passed = "passed"
    all = "all"


class Format(StrEnum):
    """How scenes are written."""

    vlafuzz = "vlafuzz"
    vlatest = "vlatest"
    lerobot = "lerobot"


def command(
    store: Annotated[
        Path,
        typer.Argument(
            help="A store that `vlafuzz run` wrote; a file of scenes, .jsonl or VLATest's; for lerobot "
            "also a corpus."
        ),
    ],
    out: Annotated[Path, typer.Option(help="File to write; with --minimal or lerobot a new folder.")],
    run: Annotated[int | None, typer.Option(help="Only this run.", show_default="all runs")] = None,
    verdict: Annotated[Wanted, typer.Option(help="Which scenes.")] = Wanted.failed,
    minimal: Annotated[
        bool, typer.Option("--minimal", help="A corpus: what is left of triaged findings, with proofs.")
    ] = False,
    format_: Annotated[
        Format,
        typer.Option(
            "--format", help="One JSON scene a line, a scene file of VLATest, or a data set of LeRobot."
        ),
    ] = Format.vlafuzz,
) -> None:
    """Write scenes of a store to a file, or its minimal failures to a folder.

    With --minimal every failure is run once more with its witness and its passing counterparts, and only what
    holds is written. `vlafuzz regress` and `vlafuzz report` read the folder.

    With --format lerobot the expert's solutions of failed scenes are played once more and written as
    episodes, with the pictures that the policy sees: demonstrations to train it with.
    """
    if minimal and (verdict is not Wanted.failed or format_ is not Format.vlafuzz):
        raise UsageError(
            "--minimal goes with neither --verdict nor --format",
            hint="its folder has scenes.jsonl, which `vlafuzz run --scenes` reads",
        )
    if minimal:
        _export(store, out, run)
        return
    if format_ is Format.lerobot:
        if verdict is not Wanted.failed:
            raise UsageError(f"--verdict {verdict}: only failures have witnesses", hint="leave it out")
        _demonstrate(store, out, run)
        return
    if store.suffix in FILES:
        written = _write(out, _of_file(store, run), format_)
        stderr().print(f"{written} scenes written to {out}")
        return
    from vlafuzz.store.store import Store

    with Store.open(store) as opened:
        scenes = _scenes(opened, run, verdict)
    written = _write(out, scenes, format_)
    stderr().print(f"{written} {'' if verdict is Wanted.all else verdict + ' '}scenes written to {out}")


def _of_file(path: Path, run: int | None) -> list[Scene]:
    """All scenes of a file; VLATest's as they are."""
    from vlafuzz.formats.sources import read_scene_file
    from vlafuzz.objects import load_catalogue

    if run is not None:
        raise UsageError(f"--run {run}: {path} is a file of scenes, not a store", hint="leave out --run")
    return read_scene_file(path, load_catalogue(), "original").scenes()


def _export(store: Path, out: Path, run: int | None) -> None:
    """The minimal failures, checked once more, with a bar."""
    from vlafuzz.regression.export import export
    from vlafuzz.regression.folder import check_new, write_corpus
    from vlafuzz.store.store import Store
    from vlafuzz.triage.confirm import MOST
    from vlafuzz.triage.scene_runner import runner_of_run

    check_new(out)
    with Store.open(store) as opened, progress() as bar:
        task = bar.add_task("minimal findings checked", total=None)
        corpus = export(
            opened,
            partial(runner_of_run, store, later=MOST, note=Bar.note),  # triage chose by the seeds before
            name=out.name,
            run=run,
            watch=lambda done, of: bar.update(task, completed=done, total=of),
        )
    write_corpus(corpus, out)
    _tell(corpus, out)


def _demonstrate(source: Path, out: Path, run: int | None) -> None:
    """The witnesses of failures, played once more, with a bar."""
    from vlafuzz.regression.export import UNSOLVED
    from vlafuzz.regression.folder import whole

    try:
        from vlafuzz.integrations.lerobot import write_dataset
    except ModuleNotFoundError as error:
        told = f"--format lerobot needs the package {error.name!r}"
        raise PrerequisiteError(told, hint="pip install 'vlafuzz[lerobot]'") from None
    from vlafuzz.integrations.demonstrations import Demonstrations

    found = Demonstrations(source, run)
    with whole(out) as folder, progress() as bar:
        played = bar.track(found.play(), len(found.proofs), description="witnesses played")
        written = write_dataset(filter(None, played), folder, found.hz, found.robot)
        if not written:
            raise CorpusError(f"{source}: no witness solves its scene here", hint="`vlafuzz triage` it here")
    stderr().print(f"{written} demonstrations written to {out}")
    if left := len(found.proofs) - written:
        stderr().print(f"left out: {left}: {UNSOLVED}")


def _tell(corpus: Corpus, out: Path) -> None:
    bugs = len({case.signature for case in corpus.cases})
    stderr().print(f"{len(corpus.cases)} minimal failures ({bugs} signatures) written to {out}")
    for reason, count in corpus.evidence.left_out.items():
        stderr().print(f"left out: {count}: {reason}")


def _write(out: Path, scenes: list[Scene], format_: Format) -> int:
    """How many could be written."""
    from vlafuzz.formats.scene_lines import write_scenes
    from vlafuzz.formats.vlatest.original import as_original
    from vlafuzz.formats.vlatest.write import write_vlatest
    from vlafuzz.objects import load_catalogue
    from vlafuzz.objects.packs import packs_of

    try:
        if format_ is Format.vlafuzz:
            write_scenes(out, scenes)
            return len(scenes)
        ours = (scene for scene in scenes if not as_original(scene))  # of those as they were nothing is asked
        named = (placement.object for scene in ours for placement in scene.placements)
        unsaid = write_vlatest(out, scenes, load_catalogue(packs=packs_of(named)))
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise UsageError(
            f"{out}: cannot be written: {reason}", hint="give --out in a folder that is there"
        ) from None
    for reason, count in unsaid.items():
        stderr().print(f"left out: {count}: {reason}")
    return len(scenes) - sum(unsaid.values())


def _scenes(store: Store, run: int | None, wanted: Wanted) -> list[Scene]:
    if wanted is Wanted.failed:
        found = [finding.scene for finding in store.findings(run)]
    else:
        runs = [run] if run is not None else [each.id for each in store.runs()]
        trials = (trial for each in runs for trial in store.trials(each))
        found = [
            trial.scene for trial in trials if wanted in (Wanted.all, trial.outcome.verdict.name.lower())
        ]
    return list(dict.fromkeys(found))
