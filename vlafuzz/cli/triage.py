"""``vlafuzz triage``."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.cli.output import print_json, print_rows, progress, stderr
from vlafuzz.errors import UsageError, check_number

if TYPE_CHECKING:
    from vlafuzz.store.records import Run
    from vlafuzz.triage.pipeline import Progress
    from vlafuzz.triage.scene_runner import SimulatorSceneRunner
    from vlafuzz.triage.summary import TriageSummary


def command(
    store: Annotated[Path, typer.Argument(help="A store that `vlafuzz run` wrote.")],
    max_rollouts: Annotated[
        int | None,
        typer.Option(
            help="Most policy rollouts to shrink and attribute one finding.",
            show_default="100, of a stochastic policy 1000",
        ),
    ] = None,
    limit: Annotated[
        int | None, typer.Option(help="Most findings to work on.", show_default="all that are left")
    ] = None,
    workers: Annotated[int, typer.Option(help="Processes that work on findings.")] = 1,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Say which failures can be trusted, and what they are due to.

    Every finding is confirmed, solved by the expert, shrunk to the operators that it takes, and attributed to
    them. Findings that were triaged before are left as they are.
    """
    for name, value in (("--max-rollouts", max_rollouts), ("--limit", limit), ("--workers", workers)):
        check_number(name, value, 1)
    if not store.is_file():
        raise UsageError(f"{store}: no such store", hint="`vlafuzz run` says where its store is")
    found = triage_store(store, max_rollouts, limit, workers, show=not json)
    if json:
        print_json(found)


def triage_store(
    store: Path, max_rollouts: int | None = None, limit: int | None = None, workers: int = 1, *, show: bool
) -> dict[str, Any]:
    """Triage what is left to triage in a store; what it then holds, as JSON, and as tables if so wished."""
    found, unjudged = _triage(store, max_rollouts, limit, workers)
    if show:
        _print(found)
    if unjudged:
        told = f"{unjudged} findings could not be judged: the policy broke, or they are no longer fair"
        stderr().print(f"{told}\nhint: they are tried again the next time", soft_wrap=True)
    return asdict(found) | {"unjudged": unjudged}


def _triage(
    store: Path, max_rollouts: int | None, limit: int | None, workers: int
) -> tuple[TriageSummary, int]:
    """Do it, with a bar: what the store then holds, and how many findings could not be judged."""
    from vlafuzz.store.store import Store
    from vlafuzz.triage.pipeline import triage
    from vlafuzz.triage.summary import summarise

    Store.open(store).close()  # an empty file is no store, and is not made one
    with Store.open(store, "write") as opened:
        with progress() as bar:
            task = bar.add_task("findings", total=None)

            def watch(now: Progress) -> None:
                said = f"findings, {now.rollouts} rollouts"
                bar.update(task, completed=now.done, total=now.findings, description=said)

            try:
                unjudged = triage(
                    opened,
                    partial(make_desk, store),
                    max_rollouts=max_rollouts,
                    limit=limit,
                    workers=workers,
                    watch=watch,
                )
            except KeyboardInterrupt:
                bar.stop()
                again = shlex.join(["vlafuzz", "triage", str(store)])
                stderr().print(f"interrupted: what is done is stored\nhint: go on with `{again}`")
                raise typer.Exit(130) from None
        return summarise(opened), unjudged


def make_desk(store: Path, run: Run, *, later: int = 0) -> SimulatorSceneRunner:
    """What a run's findings are worked on with; says when it is no longer what they were found with.

    Args:
        later: seeds to leave out, of a stochastic policy: others have chosen by them.
    """
    from vlafuzz.triage import scene_runner as runner

    made = runner.SimulatorSceneRunner(store, run.manifest, later=later)
    if made.changed:
        told = f"note: run {run.id} was made by another version: its {', '.join(made.changed)} differ"
        stderr().print(f"{told}; what no longer fails will count as flaky", soft_wrap=True)
    return made


def _print(found: TriageSummary) -> None:
    shares = {name: _share(count, found.triaged) for name, count in found.buckets.items()}
    rows = {
        "findings": found.findings,
        "triaged": found.triaged,
        "confirmed": _share(found.confirmed, found.triaged),
        "witnessed": _share(found.witnessed, found.triaged),
        **{f"in bucket {name}": share for name, share in shares.items()},
        "distinct cells before": found.distinct_cells,
        "distinct signatures after": found.distinct_signatures,
        "operators not nominal before, median": found.deviating_before,
        "operators left, median": found.deviating_after,
        "rollouts to shrink one, median": found.shrink_rollouts,
        "policy rollouts": found.policy_rollouts,
        "expert rollouts": found.expert_rollouts,
        "seconds": round(found.seconds, 1),
    }
    print_rows([{"what": name, "value": value} for name, value in rows.items()], title=found.store)
    if found.signatures:
        bugs = [{"signature": name, "findings": count} for name, count in found.signatures.items()]
        print_rows(bugs, title="bugs")


def _share(count: int, of: int) -> str:
    return f"{count} ({count / of:.0%})" if of else "0"
