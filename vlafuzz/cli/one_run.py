"""One run of ``vlafuzz run``, with what follows it: forecast, run, causes, certification, how it ends."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from vlafuzz.cli import after_run
from vlafuzz.cli.output import INTERRUPTED, Bar, interruptible
from vlafuzz.common.plugins import trust_flag
from vlafuzz.errors import PolicyError, PrerequisiteError, UsageError

if TYPE_CHECKING:
    from vlafuzz.campaign.config import Plan
    from vlafuzz.campaign.forecast import Forecast, Speed
    from vlafuzz.campaign.tally import Summary
    from vlafuzz.common.deadline import Deadline


@dataclass(frozen=True, kw_only=True)
class Asked:
    """These flags of ``vlafuzz run`` say what follows a run, and whether only JSON is shown."""

    certify: bool | None
    triage: bool
    json: bool


class Done(NamedTuple):
    """A run that is over, also as JSON; ``again`` resumes it; whether Ctrl-C ended what follows it."""

    summary: Summary
    document: dict[str, Any]
    again: str
    interrupted: bool


def note_defaults(plan: Plan, flags: Mapping[str, Any]) -> None:
    """Say which defaults follow from this machine, where the user would want to know."""
    from vlafuzz.rollouts.capacity import most_workers
    from vlafuzz.worlds import no_pictures, world_of

    usual = next(iter(world_of(plan.task.name).robots))
    if "policy" not in flags and plan.manifest.robot == usual and no_pictures(plan.task.name):
        hint = "`vlafuzz doctor` says what to install"
        Bar.note(f"note: nothing here draws pictures, so the policy is {plan.manifest.policy}; {hint}")
    used, batch = plan.place.workers, plan.manifest.batch
    if "workers" not in flags and plan.place.kind == "processes" and used == batch < most_workers():
        room = most_workers()
        Bar.note(
            f"note: {batch} scenes at a time keep {used} of {room} cores busy; --config batch={room} is "
            "faster, and chooses them by less of what came before"
        )


def run_plan(
    plan: Plan,
    speed: Speed | None,
    until: Deadline,
    asked: Asked,
    *,
    tasks: int = 1,
    again: str = "",
    over: Summary | None = None,
) -> Done:
    """Do a run with what follows it, and show it.

    Args:
        tasks: the forecast is for so many runs like this one; none where it was made before.
        again: the command that goes on after an interruption, by default that of the run alone.
        over: of a run that came to its end before, where only what follows it is left to do.
    """
    from vlafuzz.campaign.forecast import Forecast
    from vlafuzz.campaign.launch import SEARCH
    from vlafuzz.cli.summary import print_summary
    from vlafuzz.failures.triage.jobs import Allowance
    from vlafuzz.search.base import about, looks_for_causes

    certifying = looks_for_causes(plan.strategy) if asked.certify is None else asked.certify
    search = until.after(SEARCH) if asked.triage or certifying else until
    forecast = Forecast(plan, speed, certifying, search, until) if speed else None
    if forecast and not asked.triage:
        forecast = forecast.best()
    if forecast and (words := forecast.of_tasks(tasks)):
        Bar.note(words)
    trust = trust_flag(plan.manifest.policy, plan.manifest.strategy)
    again = again or shlex.join(["vlafuzz", "run", "--resume", "--store", str(plan.store), *trust])
    summary = over or _start(plan, forecast, forecast.search if forecast else search, again)
    beside, effects = after_run.beside_random(summary), after_run.effects(summary)
    then = after_run.again(summary)
    if not asked.json:
        found = after_run.causes(summary)
        print_summary(summary, beside, about(plan.strategy), found.probability if found else None)
        after_run.print_again(then)
        after_run.print_effects(effects)
    allowance = Allowance(deadline=until)
    triaged: dict[str, Any] | None = {}
    if asked.triage or certifying:
        triaged = after_run.triage_run(
            plan, summary, allowance, forecast, everything=asked.triage, show=not asked.json
        )
    found = after_run.causes(summary)
    if not asked.json:
        after_run.print_causes(summary, found, hint=not asked.triage)
    if not asked.triage and (triaged is None or allowance.used_up):
        after_run.hint_at_rest(plan, found)
    more = {"about": about(plan.strategy)} | ({"triage": triaged} if asked.triage else {})
    document = after_run.document(summary, beside, effects, found, then) | more
    return Done(summary, document, again, interrupted=triaged is None)


def end(runs: Sequence[Done], left: str = "", *, fail_on_finding: bool) -> None:
    """Say whether runs ended early, with the exit code of their results.

    Args:
        left: which tasks were not begun, in a sentence.
    """
    for summary, *_ in runs:
        if summary.stopped:
            Bar.note(f"{f'{summary.task} ' * (len(runs) > 1)}stopped: {summary.stopped}")
    if any(done.interrupted for done in runs):
        raise typer.Exit(INTERRUPTED)
    for summary, _, again, _ in runs:
        of = f"{summary.task}: " * (len(runs) > 1)
        if summary.unjudged and not summary.verdicts["error"]:
            raise UsageError(f"{of}{summary.unjudged}", hint=_why_not(summary))
        if summary.short:
            then = f"then `{again}` goes on" if summary.stopped else "the same command tries them again"
            doctor = shlex.join(["vlafuzz", "doctor", "--policy", summary.policy])
            raise PrerequisiteError(f"{of}{summary.short}", hint=f"`{doctor}` says what is wrong; {then}")
    if left:
        raise UsageError(left, hint="give it more --time; with --resume it goes on")
    if fail_on_finding and any(done.summary.findings for done in runs):
        raise typer.Exit(1)


def _why_not(summary: Summary) -> str:
    if not summary.proposals:
        return "give it more --time"
    checks = ", ".join(f"{check} {count}" for check, count in summary.invalid.items())
    export = shlex.join(["vlafuzz", "export", summary.store, "--verdict", "all", "--out", "F.jsonl"])
    return f"no scene is fair ({checks}): `{export}` writes them, `vlafuzz lint -v F.jsonl` says why"


def _start(plan: Plan, forecast: Forecast | None, until: Deadline, again: str) -> Summary:
    from vlafuzz.campaign.launch import start
    from vlafuzz.cli.summary import RunBar

    def note() -> str:
        if not _is_begun(plan):
            return "interrupted: nothing is stored yet"
        return f"interrupted: all trials so far are stored in {plan.store}\nhint: continue with `{again}`"

    with interruptible(note), RunBar(plan.manifest.budget, forecast, until) as bar:
        try:
            return start(plan, bar, until)
        except PolicyError as error:
            hint = f"when the policy is back, continue with `{again}`"
            raise PolicyError(error.message, hint=hint) from error


def _is_begun(plan: Plan) -> bool:
    """Whether the store has a run that can be resumed."""
    from vlafuzz.errors import StoreError
    from vlafuzz.store.records import UNFINISHED
    from vlafuzz.store.store import Store

    try:
        with Store.open(plan.store) as store:
            return any(run.status in UNFINISHED for run in store.runs())
    except StoreError:
        return False
