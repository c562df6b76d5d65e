"""What follows a run: its causes and effects, certification, and hints at how to go on."""

from __future__ import annotations

import shlex
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from vlafuzz.cli.output import Bar, print_rows, stdout
from vlafuzz.common.plugins import trust_flag
from vlafuzz.common.text import duration, plural

if TYPE_CHECKING:
    from vlafuzz.campaign.config import Plan
    from vlafuzz.campaign.forecast import Forecast
    from vlafuzz.campaign.results import Again, Beside
    from vlafuzz.campaign.tally import Summary
    from vlafuzz.failures.triage.jobs import Allowance
    from vlafuzz.report.causes import CauseList
    from vlafuzz.report.effects import Effects


# The keys of ``CauseList.document`` for a strategy that does not look for causes.
_NO_CAUSES = dict.fromkeys(("causes", "unexplained", "probability", "certification"))


def document(
    summary: Summary,
    beside: Beside | None,
    effects: Effects | None,
    found: CauseList | None,
    then: Again | None = None,
) -> dict[str, Any]:
    """A run as JSON."""
    parts = {
        "random": asdict(beside) if beside else None,
        "effects": effects.document() if effects else None,
        "again": asdict(then) if then else None,
    }
    return asdict(summary) | parts | (found.document() if found else _NO_CAUSES)


def print_causes(summary: Summary, found: CauseList | None, *, hint: bool) -> None:
    """Print the causes, or with ``hint`` how to find them, and how to see the first."""
    from vlafuzz.cli import triage

    if found:
        triage.print_causes(replace(found, probability=None))  # which the summary has said
    elif hint:
        hint_at_triage(summary)
    _hint_at_replay(summary, found)


def _hint_at_replay(summary: Summary, found: CauseList | None) -> None:
    """How to see the first cause that a failure shows, or without one the first failure."""
    shown = found.shown if found else None
    if scene := shown or summary.first_failure:
        command = shlex.join(["vlafuzz", "replay", summary.store, scene[:12]])
        what = "cause" if shown else "failure"
        stdout().print(f"see the first {what}: {command}", soft_wrap=True)  # in one piece, to copy


def hint_at_triage(summary: Summary) -> None:
    if summary.findings:
        from vlafuzz.failures.triage.pipeline import hours
        from vlafuzz.store.store import Store

        with Store.open(Path(summary.store)) as store:
            takes = hours(store, summary.findings)
        command = shlex.join(["vlafuzz", "triage", summary.store, *trust_flag(summary.policy)])
        failures = plural(summary.findings, "failure")
        whose = "its cause" if summary.findings == 1 else "their causes"
        stdout().print(f"{failures}; `{command}` finds {whose}{takes}", soft_wrap=True)


def hint_at_rest(plan: Plan, found: CauseList | None) -> None:
    """How to certify as many causes as are missing after an interruption, or when the time is over."""
    from vlafuzz.failures.triage.pipeline import affordable, hours
    from vlafuzz.store.store import Store

    missing = min(found.found, affordable(plan.manifest.budget)) - found.certified if found else 0
    if missing > 0:
        trust = trust_flag(plan.manifest.policy)
        command = shlex.join(["vlafuzz", "triage", str(plan.store), "--limit", str(missing), *trust])
        with Store.open(plan.store) as store:
            Bar.note(f"hint: continue with `{command}`{hours(store, missing)}")


def triage_run(
    plan: Plan,
    summary: Summary,
    allowance: Allowance,
    forecast: Forecast | None = None,
    *,
    everything: bool,
    show: bool,
) -> dict[str, Any] | None:
    """Triage all findings of the store, or only those that show causes of the run; None if interrupted.

    Args:
        forecast: that of the run, which is corrected by the time that its rollouts took.
    """
    from vlafuzz.cli.triage import AGAIN, broken, triage_store
    from vlafuzz.failures.triage.pipeline import PER_CAUSE, PER_FINDING, affordable, pace
    from vlafuzz.store.store import Store

    found = None if everything else causes(summary)
    if found and found.found:
        most = affordable(plan.manifest.budget)
        some = f"the {'' if most == 1 else f'{most} '}commonest of " if most < found.found else ""
        count = plural(found.found, "cause")
        with Store.open(Path(summary.store)) as store:
            seconds = pace(store, plan.triage_workers)
        one = forecast.certifying(PER_FINDING, seconds) if forecast else PER_FINDING * seconds
        left = allowance.deadline.left
        if left < one * PER_CAUSE / PER_FINDING:
            needed = f"one takes about {duration(one)}, and of --time {duration(max(left, 0.0))} is left"
            Bar.note(f"no cause is certified: {needed}")
            hint_at_rest(plan, found)
            return {}
        each = f"{PER_CAUSE} rollouts or more each, about {duration(one * min(most, found.found))}"
        Bar.note(f"certifying {some}{count}, {each}; --no-certify leaves this out, --time bounds it")
    try:
        result = triage_store(
            Path(summary.store),
            workers=plan.triage_workers,
            allowance=allowance,
            causes_of=None if everything else summary.run,
            show=everything and show,
        )
    except typer.Exit:  # the causes so far are shown all the same
        return None
    if told := broken(result):
        Bar.note(f"{told}\nhint: {AGAIN}")
    return result


def causes(summary: Summary) -> CauseList | None:
    from vlafuzz.report.causes import causes_of
    from vlafuzz.store.store import Store

    with Store.open(Path(summary.store)) as store:
        return next(causes_of(store, run) for run in store.runs() if run.id == summary.run)


def beside_random(summary: Summary) -> Beside | None:
    """A guided run beside random generation; None where there is nothing to compare."""
    from vlafuzz.campaign.results import beside_random
    from vlafuzz.search.base import POOL, RANDOM
    from vlafuzz.store.store import Store

    if summary.strategy in (RANDOM, POOL):
        return None
    with Store.open(Path(summary.store)) as store:
        return beside_random(store, summary.run)


def again(summary: Summary) -> Again | None:
    """What became of the scenes of a file that tells how they ended before; else None."""
    from vlafuzz.campaign.results import again
    from vlafuzz.store.store import Store

    with Store.open(Path(summary.store)) as store:
        return again(store, summary.run)


def print_again(then: Again | None) -> None:
    """Print how many scenes that failed before pass now."""
    if then is not None:
        stdout().print(str(then), style="bold", soft_wrap=True)


def effects(summary: Summary) -> Effects | None:
    """How often the policy fails by the values of random scenes; None if the store has none."""
    from vlafuzz.report.cards import Spaces
    from vlafuzz.report.effects import effects_of
    from vlafuzz.store.store import Store

    with Store.open(Path(summary.store)) as store:
        run = next(run for run in store.runs() if run.id == summary.run)
        return effects_of(store, run, Spaces(store.path).of(run.manifest))


def print_effects(effects: Effects | None) -> None:
    """Print the effects as a table, or that there is none to be seen."""
    if effects is None:
        return
    table = effects.table
    if table.rows:
        print_rows(table.rows, title=table.title)
    stdout().print(effects.says, soft_wrap=True)
    if advice := effects.advice:
        stdout().print(advice, soft_wrap=True)
