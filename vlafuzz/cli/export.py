"""``vlafuzz export``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.output import stderr
from vlafuzz.errors import UsageError

if TYPE_CHECKING:
    from vlafuzz.corpus.store import Corpus
    from vlafuzz.scene import Scene


class Wanted(StrEnum):
    """Which scenes."""

    failed = "failed"
    passed = "passed"
    all = "all"


def command(
    store: Annotated[Path, typer.Argument(help="A store that `vlafuzz run` wrote.")],
    out: Annotated[Path, typer.Option(help="File to write, one JSON scene a line.")],
    run: Annotated[int | None, typer.Option(help="Only this run.", show_default="all runs")] = None,
    verdict: Annotated[Wanted, typer.Option(help="Which scenes.")] = Wanted.failed,
) -> None:
    """Write the failing scenes of a store to a file, each of them once."""
    from vlafuzz.corpus.store import Corpus
    from vlafuzz.scene import write_scenes

    with Corpus.open(store) as corpus:
        scenes = _scenes(corpus, run, verdict)
    try:
        write_scenes(out, scenes)
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise UsageError(
            f"{out}: cannot be written: {reason}", hint="give --out in a folder that is there"
        ) from None
    stderr().print(f"{len(scenes)} {'' if verdict is Wanted.all else verdict + ' '}scenes written to {out}")


def _scenes(corpus: Corpus, run: int | None, wanted: Wanted) -> list[Scene]:
    if wanted is Wanted.failed:
        found = [finding.scene for finding in corpus.findings(run)]
    else:
        runs = [run] if run is not None else [each.id for each in corpus.runs()]
        trials = (trial for each in runs for trial in corpus.trials(each))
        found = [
            trial.scene for trial in trials if wanted in (Wanted.all, trial.outcome.verdict.name.lower())
        ]
    return list(dict.fromkeys(found))
