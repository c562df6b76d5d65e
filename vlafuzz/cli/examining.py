"""How commands check a policy: all of it for ``vlafuzz doctor``, in seconds before ``vlafuzz run``."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from vlafuzz.cli.output import progress, stderr
from vlafuzz.diagnostics.check import Check
from vlafuzz.errors import PrerequisiteError, UsageError, VlafuzzError, check_number

if TYPE_CHECKING:
    from vlafuzz.campaign.config import Plan
    from vlafuzz.policies.base import Policy

MOST = 1000
UNCHECKED = "unchecked"


def examine(name: str, given: Mapping[str, Any], n: int) -> Iterator[Check]:
    """All checks of a policy, up to the first that is refused, with a bar.

    Args:
        given: fields of a ``RunConfig``.
        n: nominal rollouts.
    """
    check_number("--n", n, 1, MOST)
    made = _make(name)
    if isinstance(made, Check):
        yield made
        return
    from vlafuzz.campaign import config
    from vlafuzz.diagnostics.exam import Exam

    with closing(made):
        manifest = config.plan(config.RunConfig(policy=name, **given), policy=made).manifest
        said = f"{n} rollouts; where they fail, some dozens more, with corrections"
        stderr().print(f"{name}: a few seconds of questions, then {said}", soft_wrap=True)
        with closing(Exam(manifest, made)) as exam, progress() as bar:
            task = bar.add_task("checks", total=None)
            for check in exam.thorough(n):
                bar.update(task, advance=1, description=f"after {check.check}")
                yield check


def looked_at(plan: Plan, *, unchecked: bool) -> Plan:
    """A run whose label says what is wrong with its policy, as far as seconds tell.

    Policies that come along are not asked: their tests have, and to load the simulator for it takes as long
    as a hundred rollouts of theirs. A run that is gone on with keeps its label,
    and is not asked where it was not.

    Raises:
        PrerequisiteError: it is nothing that could be run.
    """
    from vlafuzz.policies.registry import POLICIES

    known = plan.manifest
    if known.policy in POLICIES or known.checkup == UNCHECKED:
        return plan
    label = UNCHECKED if unchecked else _label(plan)
    return plan if plan.resume is not None else replace(plan, manifest=replace(known, checkup=label))


def _label(plan: Plan) -> str:
    from vlafuzz.diagnostics.exam import Exam

    name = plan.manifest.policy
    with closing(Exam(plan.manifest, plan.policy)) as exam, progress() as bar:
        checks = list(bar.track(exam.quick(), description="checkup"))
    closer = shlex.join(["vlafuzz", "doctor", "--policy", name])
    for check in checks:
        if check.verdict == "refuse":
            raise PrerequisiteError(
                f"{name} is not run: {check.found}",
                hint=f"{check.follows}; `{closer}` looks closer, --unchecked runs it all the same",
            )
        if check.verdict == "warn":
            stderr().print(f"note: {name}: {check.found}: {check.follows}", soft_wrap=True)
    return "; ".join(check.follows for check in checks if check.verdict == "warn") or "ok"


def _make(name: str) -> Policy | Check:
    """The policy, or what keeps it from being there.

    Raises:
        UsageError: no such policy.
    """
    from vlafuzz.policies.registry import make_policy

    try:
        return make_policy(name)
    except UsageError:
        raise
    except VlafuzzError as error:
        return Check("connects", error.message, "refuse", error.hint or "")
