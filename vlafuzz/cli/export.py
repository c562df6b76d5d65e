"""``vlafuzz export``."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import Frame, TrustFlag
from vlafuzz.cli.output import Bar, stderr
from vlafuzz.common.text import plural
from vlafuzz.errors import PrerequisiteError, StoreError, UsageError, VlafuzzError, check_number
from vlafuzz.model.scene_lines import is_document

if TYPE_CHECKING:
    from vlafuzz.failures.corpus.corpus import Corpus


class Wanted(StrEnum):
    """Verdicts to export."""

    failed = "failed"
    passed = "passed"
    all = "all"


class Shown(StrEnum):
    """Scenes to demonstrate."""

    failed = "failed"
    minimal = "minimal"
    random = "random"


class Format(StrEnum):
    """File formats."""

    vlafuzz = "vlafuzz"
    vlatest = "vlatest"
    lerobot = "lerobot"
    store = "store"


def export(
    sources: Annotated[
        list[Path],
        typer.Argument(
            help="A store that `vlafuzz run` wrote; a file of scenes, .jsonl; several of VLATest's, .json; "
            "for lerobot also a corpus; for store several stores.",
            metavar="SOURCE...",
        ),
    ],
    out: Annotated[Path, typer.Option(help="File to write; with --minimal or lerobot a new folder.")],
    run: Annotated[int | None, typer.Option(help="Only this run.", show_default="all runs")] = None,
    verdict: Annotated[Wanted, typer.Option(help="Which scenes.")] = Wanted.failed,
    minimal: Annotated[
        bool, typer.Option("--minimal", help="A corpus: what is left of triaged findings, with proofs.")
    ] = False,
    controls: Annotated[
        int | None,
        typer.Option(
            help="Random scenes in a corpus, in which `vlafuzz regress` compares policies; up to five times "
            "as many if the policy rarely passes.",
            show_default="200",
        ),
    ] = None,
    firm: Annotated[
        float | None,
        typer.Option(
            help="Share of 20 rollouts, 19 jittered and one exact, that have to fail in a scene of a corpus, "
            "and to pass in its counterparts. A scene that fails less often moves on in the same direction.",
            show_default="until it is clear that most do",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            help="Processes that check the scenes of a corpus, or demonstrate.",
            show_default="1 for a corpus, else as many as there are cores",
        ),
    ] = None,
    trust: TrustFlag = False,
    format_: Annotated[
        Format,
        typer.Option(
            "--format",
            help="One JSON scene a line, a scene file of VLATest, a data set of LeRobot, or one store with "
            "all runs of several.",
        ),
    ] = Format.vlafuzz,
    scenes: Annotated[
        Shown | None,
        typer.Option(
            help="What lerobot's episodes show: failing scenes, minimal ones with the passing scenes beside, "
            "or as many random ones to compare with.",
            show_default="failed",
        ),
    ] = None,
    demos: Annotated[
        int | None, typer.Option(help="Episodes of lerobot in all.", show_default="one a scene, or --demos-per-scene")
    ] = None,
    demos_per_scene: Annotated[
        int | None,
        typer.Option(
            help="Episodes of lerobot for each scene: the others with other grasps, slightly jittered.",
            show_default="1",
        ),
    ] = None,
    hold_out: Annotated[
        float | None,
        typer.Option(
            help="Share of the failures that lerobot's episodes leave out, whole causes. Their scenes are "
            "written to OUT-held-out.jsonl, for `vlafuzz run --scenes`.",
            show_default="0",
        ),
    ] = None,
    frame: Annotated[
        Frame | None,
        typer.Option(
            help="How VLATest's scenes become ours. fit: stretch their box onto ours; keep: keep distances; "
            "original: change nothing, keep their robots and names; robot: the same, seen from the robot as "
            "ours are: can be run.",
            show_default="fit",
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what became of each of VLATest's files as JSON.")] = False,
) -> None:
    """Write scenes of a store to a file, or its minimal failures to a folder; read scenes of VLATest.

    With --minimal every failure is repeated until it is clear, with its witness and its passing counterparts, and only
    what holds is written. The policy's outcomes in random scenes, the controls, are recorded as well. `vlafuzz regress`
    and `vlafuzz report` read the folder. Of a store of several tasks each gets a folder in OUT: OUT/pick-up, OUT/put-on
    and so on.

    With --format lerobot the expert solves the failing scenes, and its solutions are written as episodes with the
    pictures, state and actions of the policy: demonstrations to train it with. The store keeps the solutions.

    VLATest's files become one file of ours, in order; scenes with an object that has no counterpart here are left out,
    with a note.

    With --format store all runs, trials and failures of several stores are written to a new one. A scene that fails for
    one policy in several stores is one failure; a run that is in two of them appears twice.
    """
    foreign = format_ is Format.vlafuzz and not minimal and all(map(is_document, sources))
    wanted = {"scenes": scenes, "demos": demos, "demos-per-scene": demos_per_scene, "hold-out": hold_out}
    _refuse(wanted, format_ is not Format.lerobot or minimal, "only --format lerobot has it")
    of_files = {"frame": frame, "json": json or None}
    _refuse(of_files, not foreign, "only VLATest's files, written as ours, have it")
    _refuse({"run": run}, foreign, f"{sources[0]} is a file of scenes, not a store")
    _refuse({"controls": controls}, not minimal, "only a corpus has controls, see --minimal")
    check_number("--workers", workers, 1)
    if foreign:
        from vlafuzz.cli.scenes import import_scenes

        import_scenes(sources, out, frame or Frame.FIT, json=json)
    elif format_ is Format.store and not minimal:
        _merge(sources, out)
    elif len(sources) > 1:
        problem = f"{sources[1]}: several sources are for VLATest's files and --format store"
        raise UsageError(problem, hint="export one after the other")
    elif minimal:
        if verdict is not Wanted.failed or format_ is not Format.vlafuzz:
            raise UsageError(
                "--minimal goes with neither --verdict nor --format",
                hint="its folder has scenes.jsonl, which `vlafuzz run --scenes` reads",
            )
        _export_corpus(sources[0], out, run, controls, firm, workers or 1)
    elif format_ is Format.lerobot:
        if verdict is not Wanted.failed:
            raise UsageError(f"--verdict {verdict}: only failures have witnesses", hint="leave it out")
        _export_demonstrations(sources[0], out, run, scenes, demos, demos_per_scene, hold_out, workers)
    else:
        _export_scenes(sources[0], out, run, verdict, format_)


def _refuse(flags: Mapping[str, object], unfit: bool, reason: str) -> None:
    """Raise a UsageError for flags that have no meaning here."""
    for name, value in flags.items():
        if unfit and value is not None:
            raise UsageError(f"--{name}{'' if value is True else f' {value}'}: {reason}", hint="leave it out")


def _export_scenes(store: Path, out: Path, run: int | None, verdict: Wanted, format_: Format) -> None:
    """Write scenes to one file, ours or one of VLATest."""
    from vlafuzz.exports.export import SCENE_FILES, scenes_of, write_file
    from vlafuzz.worlds import world_with
    from vlafuzz.worlds.capabilities import SceneFormats

    chosen = scenes_of(store, run, verdict.value)
    exported = write_file(out, chosen, format_.value)
    if format_ is Format.vlatest and not all(map(world_with(SceneFormats).is_foreign, chosen)):
        Bar.note("note: positions are stretched from our box onto VLATest's, which undoes --frame fit")
    what = "scenes" if verdict is Wanted.all or store.suffix in SCENE_FILES else f"{verdict} scenes"
    stderr().print(f"{exported.written} {what} written to {out}")
    _print_left_out(exported.left_out)


def _export_demonstrations(
    store: Path,
    out: Path,
    run: int | None,
    scenes: Shown | None,
    demos: int | None,
    demos_per_scene: int | None,
    hold_out: float | None,
    workers: int | None,
) -> None:
    """Let the expert solve failing scenes, and write a data set for LeRobot."""
    check_number("--demos", demos, 1)
    check_number("--demos-per-scene", demos_per_scene, 1)
    if demos is not None and demos_per_scene is not None:
        problem = f"--demos {demos} and --demos-per-scene {demos_per_scene} exclude each other"
        raise UsageError(problem, hint="give one of them")
    if hold_out is not None and not 0 <= hold_out < 1:
        raise UsageError(f"--hold-out {hold_out:g}: not a share from 0 to below 1", hint="--hold-out 0.2")
    from vlafuzz.exports.training import write_demonstrations
    from vlafuzz.rollouts.capacity import most_workers

    with Bar() as bar:
        written = write_demonstrations(
            store,
            out,
            run,
            which=(scenes or Shown.failed).value,
            number=demos,
            per_scene=demos_per_scene or 1,
            hold_out=hold_out or 0.0,
            workers=workers or most_workers(),
            watch=bar,
        )
    stderr().print(f"{plural(written.demonstrations, 'demonstration')} written to {out}", soft_wrap=True)
    if written.held_out:
        held = plural(written.held_out, "held-out scene")
        stderr().print(f"{held} written to {written.held_out_file}", soft_wrap=True)
    _print_left_out(written.left_out)


def _export_corpus(
    store: Path, out: Path, run: int | None, controls: int | None, firm: float | None, workers: int
) -> None:
    """Check the minimal failures once more and write those that hold: a corpus, or one for each task."""
    check_number("--controls", controls, 0)
    if firm is not None and not 0.5 <= firm <= 1:
        raise UsageError(f"--firm {firm:g}: not a share from 0.5 to 1", hint="--firm 0.9 leaves out the rest")
    from vlafuzz.cli.triage import note_alone
    from vlafuzz.failures.corpus.controls import CONTROLS
    from vlafuzz.failures.corpus.export import export as export_corpus
    from vlafuzz.failures.corpus.export import tasks_of
    from vlafuzz.failures.corpus.folder import check_new, write_corpus
    from vlafuzz.failures.triage.scene_runner import runner_of_run
    from vlafuzz.store.store import Store

    check_new(out)
    note_alone(store)
    wanted = CONTROLS if controls is None else controls
    failed: list[VlafuzzError] = []
    with Store.open(store) as opened, Bar() as bar:
        tasks = tasks_of(opened, run)
        kept = [one for one in opened.runs() if run in (None, one.id)]
        for task in dict.fromkeys(one.manifest.task for one in kept):
            if task not in tasks:
                bar.note(f"no corpus of {task}: no minimal finding; `vlafuzz triage` makes them")
        for task in tasks:
            folder = out if len(tasks) == 1 else out / task.replace("/", "-")
            try:
                corpus = export_corpus(
                    opened,
                    partial(runner_of_run, store, note=Bar.note),
                    name=folder.name,
                    run=run,
                    task=task,
                    controls=wanted,
                    firm=firm,
                    workers=workers,
                    watch=bar,
                )
            except (StoreError, PrerequisiteError) as error:
                failed.append(error)
                if len(failed) == len(tasks):
                    raise
                bar.note(f"no corpus of {task}: {error}")
                continue
            write_corpus(corpus, folder)
            _print_corpus(corpus, folder, wanted)


def _print_corpus(corpus: Corpus, folder: Path, controls: int) -> None:
    causes = plural(len({case.signature for case in corpus.cases}), "cause")
    failures = f"{plural(len(corpus.cases), 'minimal failure')} ({causes})"
    stderr().print(f"{failures} and {len(corpus.controls)} controls written to {folder}", soft_wrap=True)
    if len(corpus.controls) < controls:
        stderr().print(f"only {len(corpus.controls)} of {controls} controls were fair and could be judged")
    _print_left_out(corpus.evidence.left_out)


def _print_left_out(left_out: Mapping[str, int]) -> None:
    for reason, count in left_out.items():
        stderr().print(f"left out: {count}: {reason}")


def _merge(stores: list[Path], out: Path) -> None:
    """Merge all runs, trials and failures of several stores into a new one, in the given order."""
    from vlafuzz.store.merge import merge as merge_stores

    twice = next((store for number, store in enumerate(stores) if store in stores[:number]), None)
    if twice is not None:
        raise UsageError(f"{twice}: given twice", hint="give each store once")
    merged = merge_stores(stores, out)
    stderr().print(
        f"{merged.runs} runs, {merged.trials} trials and {merged.findings} failures written to {out}", soft_wrap=True
    )
