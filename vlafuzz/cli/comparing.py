"""What ``vlafuzz compare`` does: the runs, the expert's sample, triage of some of it, each with a bar."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from vlafuzz.cli.output import progress, stderr
from vlafuzz.errors import UsageError, VlafuzzError

if TYPE_CHECKING:
    from vlafuzz.campaign.config import Plan, RunConfig
    from vlafuzz.compare.compare import Comparison
    from vlafuzz.compare.evidence import Evidence
    from vlafuzz.compare.failures import Found
    from vlafuzz.compare.runs import Job
    from vlafuzz.compare.solvable import Sampled
    from vlafuzz.execute.base import Executor
    from vlafuzz.store.records import Manifest, Run
    from vlafuzz.store.store import Store


class Sizes(NamedTuple):
    """How many failures of each strategy the expert tries, and how many of these are triaged."""

    tried: int
    triaged: int


def compare(asked: RunConfig, names: list[str], repeats: int, sizes: Sizes, folder: Path) -> Comparison:
    """Run what is missing, count what there is, let the expert try some of it, and triage some of that."""
    from vlafuzz.compare import compare as figures
    from vlafuzz.compare.solvable import sample, solvable

    assert asked.store
    counted = _count(asked, names, repeats, folder)
    sampled = {name: sample(its, sizes.tried) for name, its in counted.items()}
    solved = _solve(asked.store, counted[names[0]][0].run, sampled, folder)
    return figures.compare(
        counted,
        names[0],
        store=str(asked.store),
        solvable={name: solvable(its, solved) for name, its in sampled.items()},
        evidence=_triage(asked, sampled, solved, sizes.triaged) if sizes.triaged else {},
    )


def _count(asked: RunConfig, names: list[str], repeats: int, folder: Path) -> dict[str, list[Found]]:
    """Run what is missing: by strategy, what its runs found."""
    from vlafuzz.campaign import config
    from vlafuzz.compare.failures import found
    from vlafuzz.compare.runs import jobs, stored, todo
    from vlafuzz.store.store import Store

    first = config.plan(asked)
    assert asked.store
    wanted = jobs(names, repeats, asked.seed)
    if asked.store.exists():  # looked into before it is opened to write, which may make it newer
        with Store.open(asked.store) as store:
            stored(asked.store, store.runs(), first.manifest, wanted)
    _make_folder(folder)
    with Store.open(asked.store, "write") as store:
        there = stored(asked.store, store.runs(), first.manifest, wanted)
        _run(asked, store, todo(wanted, there), there, first.manifest.commit)
        there = stored(asked.store, store.runs(), first.manifest, wanted)
        counted: dict[str, list[Found]] = {name: [] for name in names}
        for job in wanted:
            counted[job.strategy].append(found(store, there[job], first.embed))
    return counted


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise UsageError(f"--out: {folder}: cannot be made: {reason}", hint="give another folder") from None


def _run(
    asked: RunConfig, store: Store, missing: list[Job], there: dict[Job, Run], commit: str | None
) -> None:
    """Do the runs that are missing, with a bar.

    Args:
        commit: of the code that is loaded: what is committed in the meantime makes no other version of it.
    """
    from vlafuzz.campaign import config, launch
    from vlafuzz.campaign.resume import resume
    from vlafuzz.cli.pace import Pace
    from vlafuzz.compare.runs import work_through

    if not missing:
        return
    with Pace([asked.budget or 0] * len(missing), list(there.values())) as pace:

        def plan(job: Job) -> Plan:
            pace.begin(f"{job.strategy}, seed {job.seed}")
            if job not in there:
                made = config.plan(replace(asked, strategy=job.strategy, seed=job.seed))
                return replace(made, manifest=replace(made.manifest, commit=commit))
            flags: dict[str, object] = {"task": asked.task, "policy": asked.policy, "budget": asked.budget}
            flags |= {"store": asked.store, "batch": asked.batch, "workers": asked.workers}
            flags |= {"executor": asked.executor, "address": asked.address}
            return resume(flags | job._asdict())

        def fuzz(planned: Plan, executor: Executor) -> None:
            summary = launch.fuzz(planned, store, executor, pace, alone=True)
            if not summary.verdicts["passed"] + summary.verdicts["failed"]:
                raise VlafuzzError(
                    f"no scene could be judged: {summary.last_error or summary.stopped}",
                    hint="`vlafuzz doctor` checks this machine; then give another --store",
                )
            if summary.stopped:
                pace.say(f"{summary.strategy}, seed {summary.seed} stopped: {summary.stopped}")

        work_through(missing, plan, launch.make_executor, fuzz)


def _solve(store: Path, run: Run, sampled: dict[str, list[Sampled]], folder: Path) -> dict[str, bool]:
    """Whether the expert solves the sampled failures, with a bar."""
    from vlafuzz.compare.solvable import Witnesses
    from vlafuzz.triage import scene_runner as runner

    manifest: Manifest = run.manifest
    scenes = [each.scene for its in sampled.values() for each in its]
    witnesses = Witnesses(folder / "witnesses.jsonl", manifest)
    if witnesses.missing(scenes):
        with closing(runner.SimulatorSceneRunner(store, manifest)) as tools, progress() as bar:
            task = bar.add_task("failures tried by the expert", total=None)
            witnesses.find(scenes, tools, lambda done, of: bar.update(task, completed=done, total=of))
    return dict(witnesses.solved)


def _triage(
    asked: RunConfig, sampled: dict[str, list[Sampled]], solved: dict[str, bool], size: int
) -> dict[str, Evidence | None]:
    """What triage makes of some of the sampled failures, with a bar; the store keeps it."""
    from vlafuzz.cli.triage import make_desk
    from vlafuzz.compare.evidence import choose, evidence, findings
    from vlafuzz.store.store import Store
    from vlafuzz.triage.pipeline import triage

    assert asked.store
    with Store.open(asked.store, "write") as store, progress() as bar:
        task = bar.add_task("sampled failures triaged", total=None)
        chosen = {name: findings(store, choose(its, solved, size)) for name, its in sampled.items()}
        unjudged = triage(
            store,
            partial(make_desk, asked.store),
            findings=list(dict.fromkeys(each for its in chosen.values() for each in its.values())),
            workers=asked.workers,
            watch=lambda now: bar.update(task, completed=now.done, total=now.findings),
        )
        triaged = store.triaged()
    if unjudged:
        told = f"{unjudged} of the sampled failures could not be judged"
        stderr().print(f"{told}: the policy broke, or they are no longer fair", soft_wrap=True)
    return {name: evidence(its, triaged) for name, its in chosen.items()}
