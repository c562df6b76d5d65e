"""``vlafuzz export``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from vlafuzz.cli.flags import TrustFlag, option, refuse
from vlafuzz.cli.output import Bar
from vlafuzz.common.files import writing
from vlafuzz.common.text import plural
from vlafuzz.errors import PrerequisiteError, StoreError, UsageError, VlafuzzError, check_number
from vlafuzz.model.scene_lines import is_document, write_scenes

Shown = Literal["failed", "random"]
Format = Literal["vlafuzz", "lerobot"]


def export(
    sources: Annotated[
        list[Path],
        typer.Argument(
            help="A store that `vlafuzz run` wrote; files of VLATest's scenes, .json; for lerobot also a corpus.",
            metavar="SOURCE...",
        ),
    ],
    out: Annotated[Path, option("File to write; with --minimal or lerobot a new folder.")],
    run: Annotated[int | None, option("Only this run.", "all runs")] = None,
    minimal: Annotated[bool, option("A corpus: what is left of triaged failures, proven.", flag="--minimal")] = False,
    controls: Annotated[
        int | None,
        option(
            "Random scenes in a corpus, in which `vlafuzz regress` compares policies; up to five times as many until "
            "16 of them pass, and a fifth of this number.",
            "200",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        option(
            "Processes that check the scenes of a corpus, or demonstrate.",
            "1 for a corpus, else as many as there are cores",
        ),
    ] = None,
    trust: TrustFlag = False,
    format_: Annotated[Format, option("One JSON scene a line, or a data set of LeRobot.", flag="--format")] = "vlafuzz",
    scenes: Annotated[
        Shown | None,
        option("What lerobot's episodes show: failing scenes, or as many random ones to compare with.", "failed"),
    ] = None,
    demos: Annotated[int | None, option("Episodes of lerobot in all.", "one a scene")] = None,
) -> None:
    """Write the failing scenes of a store to a file, or its minimal failures to a folder; read scenes of VLATest.

    With --minimal every failure is repeated until it is clear, with its witness and its passing counterparts, and only
    what holds is written. The policy's outcomes in random scenes, the controls, are recorded as well. `vlafuzz regress`
    and `vlafuzz report` read the folder. Of a store of several tasks each gets a folder in OUT: OUT/pick-up, OUT/put-on
    and so on.

    With --format lerobot the expert solves the failing scenes, and its solutions are written as episodes with the
    pictures, state and actions of the policy: demonstrations to train it with.

    VLATest's files become one file of ours, in order, with their robots, objects and distances, for `vlafuzz run
    --pack`.
    """
    foreign = format_ == "vlafuzz" and not minimal and all(map(is_document, sources))
    if format_ != "lerobot" or minimal:
        refuse({"--scenes": scenes, "--demos": demos}, "only --format lerobot has it")
    if foreign:
        refuse({"--run": run}, f"{sources[0]} is a file of scenes, not a store")
    if not minimal:
        refuse({"--controls": controls}, "only a corpus has controls, see --minimal")
    check_number("--workers", workers, 1)
    if len(sources) > 1 and not foreign:
        problem = f"{sources[1]}: several sources are for VLATest's files"
        raise UsageError(problem, hint="export one after the other")
    if foreign:
        _import_scenes(sources, out)
    elif minimal:
        if format_ != "vlafuzz":
            hint = "its folder has scenes.jsonl, which `vlafuzz run --scenes` reads"
            raise UsageError("--minimal does not go with --format", hint)
        _export_corpus(sources[0], out, run, controls, workers or 1)
    elif format_ == "lerobot":
        _export_demonstrations(sources[0], out, run, scenes, demos, workers)
    else:
        from vlafuzz.exports.selection import scenes_of

        chosen = scenes_of(sources[0], run)
        with writing(out):
            write_scenes(out, chosen)
        Bar.note(f"{len(chosen)} failed scenes written to {out}")


def _export_demonstrations(
    store: Path, out: Path, run: int | None, scenes: Shown | None, demos: int | None, workers: int | None
) -> None:
    """Let the expert solve failing scenes, and write a data set for LeRobot."""
    check_number("--demos", demos, 1)
    from vlafuzz.exports.training import write_demonstrations
    from vlafuzz.rollouts.capacity import most_workers

    with Bar() as bar:
        written = write_demonstrations(
            store, out, run, which=scenes or "failed", number=demos, workers=workers or most_workers(), watch=bar
        )
    Bar.note(f"{plural(written.demonstrations, 'demonstration')} written to {out}")
    _note_left_out(written.left_out)


def _export_corpus(store: Path, out: Path, run: int | None, controls: int | None, workers: int) -> None:
    """Check the minimal failures once more and write those that hold: a corpus, or one for each task."""
    check_number("--controls", controls, 0)
    from vlafuzz.failures.corpus.controls import CONTROLS
    from vlafuzz.failures.corpus.export import export as export_corpus, tasks_of
    from vlafuzz.failures.corpus.folder import check_new, write_corpus
    from vlafuzz.failures.triage.pipeline import runner_of_run
    from vlafuzz.store.store import Store

    check_new(out)
    wanted, failed = CONTROLS if controls is None else controls, list[VlafuzzError]()
    with Store.open(store) as opened, Bar() as bar:
        tasks = tasks_of(opened, run)
        for task in dict.fromkeys(one.manifest.task for one in opened.runs() if run in (None, one.id)):
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
            causes = plural(len({case.signature for case in corpus.cases}), "cause")
            failures = f"{plural(len(corpus.cases), 'minimal failure')} ({causes})"
            bar.note(f"{failures} and {len(corpus.controls)} controls written to {folder}")
            if len(corpus.controls) < wanted:
                bar.note(f"only {len(corpus.controls)} of {wanted} controls were fair and could be judged")
            _note_left_out(corpus.evidence.left_out)


def _note_left_out(left_out: Mapping[str, int]) -> None:
    for reason, count in left_out.items():
        Bar.note(f"left out: {count}: {reason}")


def _import_scenes(files: Sequence[Path], out: Path) -> None:
    """Write the scenes of VLATest's files as one file of ours, in order."""
    if out.is_dir() or not out.parent.is_dir():
        raise UsageError(f"--out: cannot write {str(out)!r}", hint="give a file in a folder that exists")
    from vlafuzz.worlds import usual_world

    imported = {path: usual_world().imported(path) for path in files}
    with writing(out):
        write_scenes(out, [scene for scenes in imported.values() for scene in scenes])
    Bar.note(f"{sum(map(len, imported.values()))} scenes written to {out}")
