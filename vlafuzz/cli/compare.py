"""``vlafuzz compare``."""

from __future__ import annotations

import json as json_format
import shlex
import sys
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.output import print_json, print_rows, progress, stderr
from vlafuzz.errors import UsageError, VlafuzzError

if TYPE_CHECKING:
    from vlafuzz.compare.compare import Comparison
    from vlafuzz.compare.failures import Found
    from vlafuzz.compare.runs import Job
    from vlafuzz.config import Plan, RunConfig
    from vlafuzz.corpus.records import Manifest, Run
    from vlafuzz.corpus.store import Corpus
    from vlafuzz.execute.base import Executor
    from vlafuzz.scene import Scene


def command(
    strategies: Annotated[
        str, typer.Option(help="What to compare, with commas; the others are set against the first.")
    ] = "random,nsga2,feedback",
    task: Annotated[str, typer.Option(help="What the robot is told to do.")] = "pick-up",
    subject: Annotated[
        str | None,
        typer.Option(
            help="The policy under test, or python:pkg.mod:factory.",
            show_default="mini, or pinhole where nothing renders",
        ),
    ] = None,
    budget: Annotated[int, typer.Option(help="Subject rollouts of every run.")] = 100,
    repeats: Annotated[int, typer.Option(help="Runs of every strategy.")] = 10,
    seed: Annotated[int, typer.Option(help="Of the first run of every strategy; the others count on.")] = 0,
    operators: Annotated[
        str | None,
        typer.Option(help="YAML file of ranges, or a shipped one's name.", show_default="tabletop"),
    ] = None,
    vary: Annotated[
        str | None, typer.Option(help="Only these operators vary: light,camera-position,…")
    ] = None,
    workers: Annotated[int, typer.Option(help="Processes that evaluate scenes.")] = 1,
    solvable: Annotated[
        int, typer.Option(help="Failures of every strategy that the expert tries to solve.")
    ] = 50,
    store: Annotated[
        Path | None, typer.Option(help="Where to keep all runs.", show_default="runs/compare-….db")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for plots and tables.", show_default="runs/compare-…")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV, a row a strategy.")] = False,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print markdown.")] = False,
) -> None:
    """Compare strategies: several runs of each with the same seeds and the same budget of rollouts.

    No run learns from another one's rollouts. All are kept in one store; the same command goes on where it
    was interrupted, and with more --repeats or --strategies it does what is missing.
    """
    from vlafuzz import config

    names = _names(strategies)
    _check(names, repeats, seed, solvable, sum((json, csv, markdown)))
    name = f"compare-{config.default_store(task, subject or config.default_subject(), '', 0).stem[:-3]}"
    where = store or Path("runs") / f"{name}.db"
    asked = config.RunConfig(
        task=task,
        subject=subject or config.default_subject(),
        strategy=names[0],
        budget=budget,
        seed=seed,
        operators=operators,
        vary=tuple(each.strip() for each in vary.split(",")) if vary is not None else (),
        store=where,
        workers=workers,
        command=shlex.join(["vlafuzz", *sys.argv[1:]]),
    )
    folder = out or where.with_suffix("")
    try:
        compared = _compare(asked, names, repeats, solvable, folder)
    except KeyboardInterrupt:
        stderr().print(
            f"interrupted: all trials so far are stored in {where}\nhint: the same command goes on",
            soft_wrap=True,
        )
        raise typer.Exit(130) from None
    _write(compared, folder)
    _print(compared, json=json, csv=csv, markdown=markdown)


def _names(strategies: str) -> list[str]:
    names = [name.strip() for name in strategies.split(",") if name.strip()]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise UsageError(f"--strategies: {twice[0]!r} is there twice", hint="name each of them once")
    if not names:
        raise UsageError(f"--strategies: expected names, got {strategies!r}", hint="random,nsga2")
    return names


def _check(names: list[str], repeats: int, seed: int, solvable: int, formats: int) -> None:
    """What can be known to be wrong before anything is planned."""
    from vlafuzz import config
    from vlafuzz.search.registry import strategy_factory

    for flag, value, least in (("--repeats", repeats, 1), ("--solvable", solvable, 0)):
        if value < least:
            hint = f"give {flag} {least} or more"
            raise UsageError(f"{flag}: expected at least {least}, got {value}", hint=hint)
    if seed + repeats - 1 > config.MOST:
        raise UsageError(f"--seed: too large for {repeats} repeats, got {seed}", hint="give a smaller one")
    if formats > 1:
        raise UsageError("--json, --csv and --markdown exclude each other", hint="give one of them")
    for name in names:
        strategy_factory(name)


def _compare(asked: RunConfig, names: list[str], repeats: int, solvable: int, folder: Path) -> Comparison:
    """Run what is missing, count what there is, and let the expert try some of it."""
    from vlafuzz import config
    from vlafuzz.compare.compare import compare
    from vlafuzz.compare.failures import found
    from vlafuzz.compare.runs import jobs, stored, todo
    from vlafuzz.compare.solvable import sample
    from vlafuzz.corpus.store import Corpus

    first = config.plan(asked)
    assert asked.store
    wanted = jobs(names, repeats, asked.seed)
    if asked.store.exists():  # looked into before it is opened to write, which may make it newer
        with Corpus.open(asked.store) as corpus:
            stored(asked.store, corpus.runs(), first.manifest, wanted)
    _make_folder(folder)
    with Corpus.open(asked.store, "write") as corpus:
        there = stored(asked.store, corpus.runs(), first.manifest, wanted)
        _run(asked, corpus, todo(wanted, there), there, first.manifest.commit)
        there = stored(asked.store, corpus.runs(), first.manifest, wanted)
        counted: dict[str, list[Found]] = {name: [] for name in names}
        for job in wanted:
            counted[job.strategy].append(found(corpus, there[job], first.meaningful))
    sampled = {name: sample(its, solvable) for name, its in counted.items()}
    solved = _solve(asked.store, there[wanted[0]], sampled, folder)
    return compare(counted, names[0], store=str(asked.store), sampled=sampled, solved=solved)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise UsageError(f"--out: {folder}: cannot be made: {reason}", hint="give another folder") from None


def _run(
    asked: RunConfig, corpus: Corpus, missing: list[Job], there: dict[Job, Run], commit: str | None
) -> None:
    """Do the runs that are missing, with a bar.

    Args:
        commit: of the code that is loaded: what is committed in the meantime makes no other version of it.
    """
    from vlafuzz import config
    from vlafuzz.cli.pace import Pace
    from vlafuzz.compare.runs import work_through

    if not missing:
        return
    with Pace(len(missing), asked.budget or 0, list(there.values())) as pace:

        def plan(job: Job) -> Plan:
            pace.begin(f"{job.strategy}, seed {job.seed}")
            if job not in there:
                made = config.plan(replace(asked, strategy=job.strategy, seed=job.seed))
                return replace(made, manifest=replace(made.manifest, commit=commit))
            flags: dict[str, object] = {"task": asked.task, "subject": asked.subject, "budget": asked.budget}
            flags |= {"store": asked.store, "workers": asked.workers, "batch": asked.batch}
            return config.resume(flags | job._asdict())

        def fuzz(planned: Plan, executor: Executor) -> None:
            summary = config.fuzz(planned, corpus, executor, pace, alone=True)
            if not summary.verdicts["passed"] + summary.verdicts["failed"]:
                raise VlafuzzError(
                    f"no scene could be judged: {summary.last_error or summary.stopped}",
                    hint="`vlafuzz doctor` checks this machine; then begin with another --store",
                )
            if summary.stopped:
                pace.say(f"{summary.strategy}, seed {summary.seed} stopped: {summary.stopped}")

        work_through(missing, plan, config.make_executor, fuzz)


def _solve(store: Path, run: Run, sampled: dict[str, list[Scene]], folder: Path) -> dict[str, bool]:
    """Whether the expert solves the sampled failures, with a bar."""
    from vlafuzz import desk
    from vlafuzz.compare.solvable import Witnesses

    manifest: Manifest = run.manifest
    scenes = [scene for its in sampled.values() for scene in its]
    witnesses = Witnesses(folder / "witnesses.jsonl", manifest)
    if witnesses.missing(scenes):
        with closing(desk.SimulatorDesk(store, manifest)) as tools, progress() as bar:
            task = bar.add_task("failures tried by the expert", total=None)
            witnesses.find(scenes, tools, lambda done, of: bar.update(task, completed=done, total=of))
    return dict(witnesses.solved)


def _write(compared: Comparison, folder: Path) -> None:
    from vlafuzz.cli import compared as shown
    from vlafuzz.compare.plots import plot

    told = json_format.dumps(asdict(compared), indent=2, allow_nan=False)
    (folder / "compare.json").write_text(told + "\n", encoding="utf-8")
    (folder / "compare.md").write_text(shown.markdown(compared), encoding="utf-8")
    shown.write_runs(compared, folder / "runs.csv")
    plots = plot(compared, folder)
    names = [path.name for path in (*plots, folder / "compare.json", folder / "compare.md")]
    stderr().print(f"written to {folder}: {', '.join(names)}, runs.csv", soft_wrap=True)


def _print(compared: Comparison, *, json: bool, csv: bool, markdown: bool) -> None:
    from vlafuzz.cli import compared as shown

    if json:
        print_json(asdict(compared))
    elif csv:
        print_rows(shown.csv_rows(compared), csv=True)
    elif markdown:
        sys.stdout.write(shown.markdown(compared))
    else:
        shown.print_comparison(compared)
