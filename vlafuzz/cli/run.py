"""``vlafuzz run``."""

from __future__ import annotations

import shlex
import sys
from typing import Annotated, Any

from vlafuzz.cli.flags import ConfigFlag, JsonFlag, TimeFlag, TrustFlag, configured, option, with_run_options
from vlafuzz.cli.one_run import Asked, checked, end, run_plan
from vlafuzz.cli.output import print_json


@with_run_options
def command(
    *,
    world: Annotated[
        str | None,
        option(
            "Where: the name of a world, WORLD:TASK in place of --task, or python:pkg.mod:factory.",
            "the first of `vlafuzz list worlds`",
        ),
    ] = None,
    time: TimeFlag = None,
    resume: Annotated[
        bool,
        option("Resume a stored run that ended early; flags that are not given are taken from it.", flag="--resume"),
    ] = False,
    triage: Annotated[
        bool, option("Then triage the store, as `vlafuzz triage` does.", flag="--triage", hidden=True)
    ] = False,
    certify: Annotated[
        bool | None,
        option(
            "Then triage the scenes that show the commonest causes, at up to about twice its cost.",
            "with strategy causes",
            flag="--certify/--no-certify",
        ),
    ] = None,
    unchecked: Annotated[
        bool, option("Skip the check whether the policy sees, hears and moves.", flag="--unchecked")
    ] = False,
    trust: TrustFlag = False,
    config: ConfigFlag = None,
    json: JsonFlag = False,
    fail_on_finding: Annotated[
        bool, option("Exit with 1 when scenes fail.", flag="--fail-on-finding", hidden=True)
    ] = False,
    **given: Any,
) -> None:
    """Fuzz a policy: find scenes in which it fails, and with strategy causes why.

    Runs are kept in a store, by default runs/<task>-<policy>-<seed>.db; several tasks share one. Scenes that a store
    knows are answered from it at no cost. A policy of your own is first checked, for seconds: a blind policy, for
    example, is not run. With --time, half of it is for the run and what is left is for triage, if any; all of it is for
    the run where what is left would probably certify nothing. Several tasks share it.

    --config also has what is rarely changed: batch, criteria, placement, pool, repeats, stop-early; triage, to triage
    the whole store then; and fail-on-finding, for exit code 1 when scenes fail.
    """
    from vlafuzz.common.deadline import deadline

    until = deadline("--time", time)
    _begin_early(given["policy"], given["workers"], given["executor"])
    from vlafuzz.campaign.config import RunConfig
    from vlafuzz.campaign.config import plan as plan_of
    from vlafuzz.campaign.resume import resume as resume_run
    from vlafuzz.cli.several import print_several, run_tasks
    from vlafuzz.worlds import task_of, tasks_named

    named = task_of(world, given["task"])
    tasks = tasks_named(named) if named else ()
    flags = configured(given | {"task": named})
    asked = Asked(certify=certify, triage=triage, json=json)
    if len(tasks) > 1:
        runs, path, left = run_tasks(tasks, flags, asked, until, resume=resume, unchecked=unchecked)
        print_several(runs, path, json=json)
        end(runs, left, fail_on_finding=fail_on_finding)
        return
    if resume:
        plan = resume_run(flags)
    else:
        plan = plan_of(RunConfig(**flags, command=shlex.join(["vlafuzz", *sys.argv[1:]])))
    plan, speed = checked(plan, flags, unchecked=unchecked)
    done = run_plan(plan, speed, until, asked)
    if json:
        print_json(done.document)
    end([done], fail_on_finding=fail_on_finding)


def _begin_early(policy: str | None, workers: int | None, executor: str | None) -> None:
    """Begin what takes seconds and is most likely needed: the usual world, and the simulator for workers."""
    from vlafuzz.rollouts import forks
    from vlafuzz.rollouts.capacity import most_workers
    from vlafuzz.worlds import known_worlds

    next(iter(known_worlds().values())).begin_early(policy)
    own = ":" in (policy or "")  # has one worker by default
    if executor in (None, "processes") and (workers or (1 if own else most_workers())) > 1:
        forks.load_early()
