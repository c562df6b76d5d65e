"""One run of ``vlafuzz run``, with what follows it: forecast, run, causes, certification, how it ends."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from vlafuzz.cli.output import INTERRUPTED, Bar, interruptible, print_rows, stdout
from vlafuzz.common.plugins import trust_flag
from vlafuzz.common.text import duration, plural
from vlafuzz.errors import PolicyError, PrerequisiteError, StoreError, UsageError

if TYPE_CHECKING:
    from vlafuzz.campaign.config import Plan
    from vlafuzz.campaign.forecast import Forecast, Speed
    from vlafuzz.campaign.results import Again, Beside
    from vlafuzz.campaign.tally import Summary
    from vlafuzz.common.deadline import Deadline
    from vlafuzz.doctor.before_run import Checked
    from vlafuzz.failures.causes import CauseList
    from vlafuzz.failures.triage.jobs import Allowance
    from vlafuzz.report.effects import Effects

# The keys of ``CauseList.document`` for a strategy that does not look for causes.
_NO_CAUSES = dict.fromkeys(("causes", "unexplained", "probability", "certification"))


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


class _Results(NamedTuple):
    """What a store tells of a finished run; None where there is nothing of the kind.

    Attributes:
        beside: a guided run beside random ones.
        effects: how often the policy fails by the values of random scenes.
        again: what became of the scenes of a file that tells how they ended before.
    """

    beside: Beside | None
    effects: Effects | None
    again: Again | None
    causes: CauseList | None


def checked(plan: Plan, flags: Mapping[str, Any], *, unchecked: bool) -> Checked:
    """The plan after the check of its policy, with notes on what follows from this machine."""
    from vlafuzz.doctor.before_run import checked_plan

    if plan.resume is None:
        note_defaults(plan, flags)
    with Bar() as bar:
        return checked_plan(plan, unchecked=unchecked, watch=bar)


def note_defaults(plan: Plan, flags: Mapping[str, Any]) -> None:
    """Say which defaults follow from this machine, where the user would want to know."""
    from vlafuzz.rollouts.capacity import most_workers
    from vlafuzz.worlds import no_pictures, world_of

    usual = next(iter(world_of(plan.task.name).robots))
    if "policy" not in flags and plan.manifest.robot == usual and no_pictures(plan.task.name):
        hint = "`vlafuzz doctor` says what to install"
        Bar.note(f"note: nothing here draws pictures, so the policy is {plan.manifest.policy}; {hint}")
    used, batch, room = plan.place.workers, plan.manifest.batch, most_workers()
    if "workers" not in flags and plan.place.kind == "processes" and used == batch < room:
        faster = f"--config batch={room} is faster, and chooses them by less of what came before"
        Bar.note(f"note: {batch} scenes at a time keep {used} of {room} cores busy; {faster}")


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
        again: the command that goes on after an interruption, by default that of the run alone. over: of a run that
        came to its end before, where only what follows it is left to do.
    """
    from vlafuzz.campaign.forecast import Forecast
    from vlafuzz.campaign.launch import SEARCH
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
    results, allowance, told = _results(summary), Allowance(deadline=until), about(plan.strategy)
    if not asked.json:
        _print(summary, results, told)
    triaged: dict[str, Any] | None = {}
    if asked.triage or certifying:
        triaged = _triage(plan, summary, results.causes, allowance, forecast, asked)
        results = results._replace(causes=_causes(summary))
    if not asked.json:
        _print_causes(summary, results.causes, hint=not asked.triage)
    if not asked.triage and (triaged is None or allowance.used_up):
        _hint_at_rest(plan, results.causes)
    document = _document(summary, results) | {"about": told} | ({"triage": triaged} if asked.triage else {})
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
    from vlafuzz.cli.summary import RunProgress
    from vlafuzz.store.records import UNFINISHED
    from vlafuzz.store.store import Store

    def note() -> str:
        try:
            with Store.open(plan.store) as store:
                if any(run.status in UNFINISHED for run in store.runs()):
                    stored = f"all trials so far are stored in {plan.store}"
                    return f"interrupted: {stored}\nhint: continue with `{again}`"
        except StoreError:
            pass
        return "interrupted: nothing is stored yet"

    with interruptible(note, until) as bar:
        try:
            return start(plan, RunProgress(bar, plan.manifest.budget, forecast), until)
        except PolicyError as error:
            hint = f"when the policy is back, continue with `{again}`"
            raise PolicyError(error.message, hint=hint) from error


def _results(summary: Summary) -> _Results:
    from vlafuzz.campaign.results import again, beside_random
    from vlafuzz.failures.causes import causes_of
    from vlafuzz.failures.described import Spaces
    from vlafuzz.report.effects import effects_of
    from vlafuzz.search.base import POOL, RANDOM
    from vlafuzz.store.store import Store

    with Store.open(Path(summary.store)) as store:
        run = next(run for run in store.runs() if run.id == summary.run)
        return _Results(
            beside=None if summary.strategy in (RANDOM, POOL) else beside_random(store, run.id),
            effects=effects_of(store, run, Spaces(store.path).of(run.manifest)),
            again=again(store, run.id),
            causes=causes_of(store, run),
        )


def _causes(summary: Summary) -> CauseList | None:
    from vlafuzz.failures.causes import causes_of
    from vlafuzz.store.store import Store

    with Store.open(Path(summary.store)) as store:
        return next(causes_of(store, run) for run in store.runs() if run.id == summary.run)


def _document(summary: Summary, results: _Results) -> dict[str, Any]:
    """A run as JSON."""
    parts = {
        "random": asdict(results.beside) if results.beside else None,
        "effects": results.effects.document() if results.effects else None,
        "again": asdict(results.again) if results.again else None,
    }
    return asdict(summary) | parts | (results.causes.document() if results.causes else _NO_CAUSES)


def _print(summary: Summary, results: _Results, about: str) -> None:
    """Print the run in numbers, how the scenes of a file end now, and what operators do to the policy."""
    from vlafuzz.cli.summary import print_summary

    probability = results.causes.probability if results.causes else None
    print_summary(summary, results.beside, about, probability)
    if results.again is not None:
        stdout().print(str(results.again), style="bold", soft_wrap=True)
    if (effects := results.effects) is None:
        return
    table = effects.table
    if table.rows:
        print_rows(table.rows, title=table.title)
    for text in filter(None, (effects.says, effects.advice)):
        stdout().print(text, soft_wrap=True)


def _print_causes(summary: Summary, found: CauseList | None, *, hint: bool) -> None:
    """Print the causes, or with ``hint`` how to find them; and how to see the first cause or failure."""
    from vlafuzz.cli.triage import print_causes
    from vlafuzz.failures.triage.pipeline import hours
    from vlafuzz.store.store import Store

    if found:
        print_causes(replace(found, probability=None))  # which the summary has said
    elif hint and summary.findings:
        with Store.open(Path(summary.store)) as store:
            takes = hours(store, summary.findings)
        command = shlex.join(["vlafuzz", "triage", summary.store, *trust_flag(summary.policy)])
        whose = "its cause" if summary.findings == 1 else "their causes"
        failures = plural(summary.findings, "failure")
        stdout().print(f"{failures}; `{command}` finds {whose}{takes}", soft_wrap=True)
    shown = found.shown if found else None
    if scene := shown or summary.first_failure:
        command = shlex.join(["vlafuzz", "replay", summary.store, scene[:12]])
        what = "cause" if shown else "failure"
        stdout().print(f"see the first {what}: {command}", soft_wrap=True)  # in one piece, to copy


def _hint_at_rest(plan: Plan, found: CauseList | None) -> None:
    """How to certify as many causes as are missing after an interruption, or when the time is over."""
    from vlafuzz.failures.triage.pipeline import affordable, hours
    from vlafuzz.store.store import Store

    missing = min(found.found, affordable(plan.manifest.budget)) - found.certified if found else 0
    if missing > 0:
        trust = trust_flag(plan.manifest.policy)
        command = shlex.join(["vlafuzz", "triage", str(plan.store), "--limit", str(missing), *trust])
        with Store.open(plan.store) as store:
            Bar.note(f"hint: continue with `{command}`{hours(store, missing)}")


def _triage(
    plan: Plan, summary: Summary, found: CauseList | None, allowance: Allowance, forecast: Forecast | None, asked: Asked
) -> dict[str, Any] | None:
    """Triage all of the store, or what shows causes of the run, unless no cause would be done in time.

    None if interrupted.
    """
    from vlafuzz.cli.triage import AGAIN, broken, triage_store

    if found and found.found and not asked.triage and not _foresee(plan, found, allowance.deadline, forecast):
        _hint_at_rest(plan, found)
        return {}
    try:
        result = triage_store(
            plan.store,
            allowance,
            plan.triage_place,
            causes_of=None if asked.triage else summary.run,
            show=asked.triage and not asked.json,
        )
    except typer.Exit:  # the causes so far are shown all the same
        return None
    if told := broken(result):
        Bar.note(f"{told}\nhint: {AGAIN}")
    return result


def _foresee(plan: Plan, found: CauseList, until: Deadline, forecast: Forecast | None) -> bool:
    """Say how long certification takes by the time that rollouts took; whether there is time for a cause."""
    from vlafuzz.failures.triage.pipeline import PER_CAUSE, PER_FINDING, affordable, pace
    from vlafuzz.store.store import Store

    with Store.open(plan.store) as store:
        seconds = pace(store, plan.triage_place.workers)
    one = forecast.certifying(PER_FINDING, seconds) if forecast else PER_FINDING * seconds
    if until.left < one * PER_CAUSE / PER_FINDING:
        left = duration(max(until.left, 0.0))
        Bar.note(f"no cause is certified: one takes about {duration(one)}, and of --time {left} is left")
        return False
    most, count = affordable(plan.manifest.budget), plural(found.found, "cause")
    some = f"the {'' if most == 1 else f'{most} '}commonest of " if most < found.found else ""
    each = f"{PER_CAUSE} rollouts or more each, about {duration(one * min(most, found.found))}"
    Bar.note(f"certifying {some}{count}, {each}; --no-certify leaves this out, --time bounds it")
    return True
