"""``vlafuzz run`` with several tasks: one forecast, one store, and one table of policies and tasks."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vlafuzz.cli.one_run import Asked, Done, checked, run_plan
from vlafuzz.cli.output import Bar, print_json, print_rows

if TYPE_CHECKING:
    from vlafuzz.campaign.config import Plan, RunConfig
    from vlafuzz.campaign.tally import Summary
    from vlafuzz.common.deadline import Deadline


def run_tasks(
    tasks: Sequence[str], flags: Mapping[str, Any], asked: Asked, until: Deadline, *, resume: bool, unchecked: bool
) -> tuple[list[Done], Path, str]:
    """Run each task with the same flags, up to the first interruption; the policy is checked once.

    Args:
        until: the tasks share the time that is left.
        resume: runs that ended early are taken up again, and those that are over are not repeated.

    Returns:
        The runs, their store, and in a sentence which tasks were not begun as the time was over.
    """
    config, runs, first = _config(tasks, flags), list[Done](), None
    again = shlex.join(["vlafuzz", *(word for word in sys.argv[1:] if word != "--resume"), "--resume"])
    assert config.store
    for number, task in enumerate(tasks):
        if until.passed:
            left = f"--time was over before these tasks began: {', '.join(tasks[number:])}"
            return runs, config.store, left
        Bar.note(f"task {number + 1} of {len(tasks)}: {task}")
        plan, over = _plan(replace(config, task=task), again=resume)
        speed, foreseen, remaining = None, 0, len(tasks) - number
        if over is None:
            if first is None:
                first, foreseen = checked(plan, flags, unchecked=unchecked), remaining
                plan = first.plan
            elif plan.resume is None:
                plan = replace(plan, manifest=replace(plan.manifest, checkup=first.plan.manifest.checkup))
            speed = first.speed
        share = until.after(1 / remaining)
        done = run_plan(plan, speed, share, asked, tasks=foreseen, again=again, over=over)
        runs.append(done)
        if done.interrupted:
            Bar.note(f"hint: `{again}` does the other tasks")
            break
    return runs, config.store, ""


def _config(tasks: Sequence[str], flags: Mapping[str, Any]) -> RunConfig:
    """The configuration that all tasks share, with its store and policy filled in."""
    from vlafuzz.campaign.config import RunConfig, default_store
    from vlafuzz.worlds import default_policy, tasks_named

    policy = flags.get("policy") or default_policy(tasks[0], flags.get("robot"))
    name = "all" if set(tasks) == set(tasks_named("all")) else "-".join(tasks)
    store = default_store(name, policy, flags.get("seed", 0))
    command = shlex.join(["vlafuzz", *sys.argv[1:]])
    return RunConfig(**{"store": store} | dict(flags) | {"policy": policy, "task": None, "command": command})


def _plan(config: RunConfig, *, again: bool) -> tuple[Plan, Summary | None]:
    """The plan of a task; with the summary of its run if that came to its end before."""
    from vlafuzz.campaign.config import plan
    from vlafuzz.campaign.resume import begun, flags_of, resume, summary_of
    from vlafuzz.store.records import UNFINISHED
    from vlafuzz.store.store import Store

    run = begun(config) if again else None
    if run is None:
        return plan(config), None
    if run.status in UNFINISHED:
        return resume(flags_of(config)), None
    assert config.store
    planned = replace(plan(config), manifest=run.manifest)
    with closing(planned.policy), Store.open(config.store) as store:
        return planned, summary_of(store, run)


def print_several(runs: Sequence[Done], path: Path, *, json: bool) -> None:
    """Print how each policy of a store does in each task, as JSON also the runs."""
    from vlafuzz.report.counts import standings_of
    from vlafuzz.store.store import Store

    with Store.open(path) as store:
        rows = standings_of(store)
    if json:
        documents = [done.document for done in runs]
        print_json({"tasks": documents, "standings": [one.document() for one in rows]})
    else:
        print_rows([one.row() for one in rows], title=f"policies and tasks of {path}")
