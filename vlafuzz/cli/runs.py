"""The runs of ``vlafuzz run``, each with what follows it: forecast, run, causes, certification.

This is loaded after the simulator for workers has begun to load.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import typer
from rich.table import Table

from vlafuzz.campaign.config import BUDGET, SEARCH, Plan, RunConfig, default_store, further, plan as plan_of, start
from vlafuzz.campaign.forecast import Forecast, Speed
from vlafuzz.campaign.options import AUTO, LEAST
from vlafuzz.campaign.resume import begun, resume as resume_run
from vlafuzz.campaign.tally import TIME_OVER, Summary, Tally
from vlafuzz.cli.flags import typed
from vlafuzz.cli.output import Bar, interruptible, print_json, print_lines, print_list, print_rows, stdout
from vlafuzz.cli.triage import AGAIN, note_unjudged, shown_on
from vlafuzz.common.deadline import Deadline
from vlafuzz.common.plugins import command
from vlafuzz.common.text import duration, interval, named, percent, plural
from vlafuzz.doctor.exam import checked_plan
from vlafuzz.errors import PolicyError, StoreError
from vlafuzz.failures.causes import CauseList, causes_of
from vlafuzz.failures.events import told as told_early
from vlafuzz.failures.triage.pipeline import (
    PER_CAUSE,
    Allowance,
    affordable,
    certify_causes,
    hours,
    pace,
    runner_of_run,
)
from vlafuzz.model import Verdict
from vlafuzz.report.cards import evidence, told
from vlafuzz.report.tables import half_of_run, rate_of, standings_of
from vlafuzz.search.base import looks_for_causes, said_by
from vlafuzz.search.severity import NAME as SEVERITY
from vlafuzz.store.records import UNFINISHED
from vlafuzz.store.store import Store
from vlafuzz.worlds import default_policy, no_pictures, tasks_named, world_of

# Share of the budget that is spent to find the severity at which one half fails, and the fewest rollouts for it. With
# 60 rollouts, the 95 % interval of that severity is 0.17 to 0.28 wide in simulation.
PROBING, FEWEST = 0.25, 20
STARTING, FILMS = 10.0, 4  # seconds until the first film of a page; films of a card
# The keys of ``CauseList.document`` for a strategy that does not look for causes.
_NO_CAUSES = dict.fromkeys(("causes", "unexplained", "probability", "certification"))


class Done(NamedTuple):
    """A run that is over, also as JSON; ``again`` resumes it; whether Ctrl-C ended its certification."""

    summary: Summary
    document: dict[str, Any]
    again: str
    interrupted: bool


def run_plan(
    plan: Plan,
    speed: Speed | None,
    until: Deadline,
    *,
    certify: bool | None,
    json: bool,
    tasks: int = 1,
    again: str = "",
) -> Done:
    """Do a run with what follows it, and show it.

    Args:
        certify: whether to certify the commonest causes; by default if the strategy looks for any.
        json: whether to print nothing but notes.
        tasks: the forecast is for so many runs like this one; none where it was made before.
        again: the command that goes on after an interruption, by default that of the run alone.
    """
    certifying = looks_for_causes(plan.strategy) if certify is None else certify
    search = until.after(SEARCH) if certifying else until
    if speed:
        forecast = Forecast(plan, speed, certifying, search, until)
        if forecast.too_short:  # all of the time is for the run
            forecast = replace(forecast, search=until)
        if words := forecast.of_tasks(tasks):
            Bar.note(words)
        search = forecast.search
    names = (plan.manifest.policy, plan.manifest.strategy, plan.manifest.task)
    again = again or command("run", "--resume", "--store", plan.store, names=names)
    summary = _start(plan, search, again)
    causes, says = _causes(summary), said_by(plan.strategy, "about", "")
    document = asdict(summary)
    if summary.stopped:
        Bar.note(f"stopped: {summary.stopped}")
    if not json:
        _print_summary(summary, says)
    interrupted = False
    if certifying and causes and (not causes.found or _foresee(plan, causes, until)):
        interrupted = causes.found > 0 and not _certify(plan, summary, until)
        if not interrupted and not until.passed and (rest := further(plan, summary.run)):
            Bar.note(f"{rest.more} more rollouts, which certification did not need, look for what else fails")
            summary = _start(rest, until, again)
            interrupted = not _certify(plan, summary, until)
        causes, document = _causes(summary), asdict(summary)
    if not json:
        if causes and causes.causes:
            print_list([(*cause.conditions, cause.says) for cause in causes.causes], title=causes.title)
            print_lines(causes.left)
        _print_end(summary, causes, again)
    document |= (causes.document() if causes else _NO_CAUSES) | {"about": says}
    return Done(summary, document, again, interrupted)


def _start(plan: Plan, until: Deadline, again: str) -> Summary:
    def note() -> str:
        try:
            with Store.open(plan.store) as store:
                if any(run.status in UNFINISHED for run in store.runs()):
                    stored = f"all trials so far are stored in {plan.store}"
                    return f"interrupted: {stored}\nhint: continue with `{again}`"
        except StoreError:
            pass
        return "interrupted: nothing is stored yet"

    def show(tally: Tally) -> None:
        causes = "" if tally.causes is None else f", {plural(tally.causes, 'cause')}"
        more = f", {tally.verdicts[Verdict.FAILED]} failed{causes}"
        bar.progress("rollouts", tally.rollouts, plan.manifest.budget + plan.more, more)

    with interruptible(note, until) as bar:
        bar.progress("rollouts", 0, plan.manifest.budget + plan.more)
        try:
            return start(plan, show, until)
        except PolicyError as error:
            hint = f"when the policy is back, continue with `{again}`"
            raise PolicyError(error.message, hint=hint) from error


def _causes(summary: Summary) -> CauseList | None:
    with Store.open(Path(summary.store)) as store:
        return next(causes_of(store, run) for run in store.runs() if run.id == summary.run)


def _print_summary(summary: Summary, about: str) -> None:
    policy = f"{summary.label} ({summary.policy})" if summary.label else summary.policy
    title = f"run {summary.run}: {summary.task}, {policy}, {summary.strategy}, seed {summary.seed}"
    lines = {
        "strategy": about,
        "rollouts": f"{summary.rollouts} of {summary.budget}, in {summary.seconds:.0f} s",
        "proposals": f"{summary.proposals}, {summary.duplicates} of them answered from the store",
        "scenes": ", ".join(f"{count} {name}" for name, count in summary.verdicts.items()),
        "too early": told_early(summary.before_event),
        "invalid": named(f"{check} {count}" for check, count in summary.invalid.items()),
        "first error": summary.first_error,
        "store": summary.store,
    }
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold")
    table.add_column()
    for name, line in lines.items():
        if line:
            table.add_row(name, line)
    print_lines(title, style="italic")
    stdout().print(table)


def _print_end(summary: Summary, found: CauseList | None, again: str) -> None:
    """End with three lines: what fails, how sure that is, and the next command; without a judged scene with none.

    Args:
        again: the command that goes on with the run.
    """
    failed, judged = summary.findings, summary.findings + summary.verdicts["passed"]
    if not judged:
        return
    causes = found.causes if found else ()
    with Store.open(Path(summary.store)) as store:
        rate = rate_of(store, next(run for run in store.runs() if run.id == summary.run), found)
        sure = f"how often it fails is unknown without {'more ' * bool(rate)}random scenes"
        if rate and (rate.low > 0 or rate.high < 1):
            sure = f"{percent(rate.value)} of random scenes fail ({interval(rate.low, rate.high)})"
        elif summary.strategy == SEVERITY:
            sure = f"one half fails at severity {half_of_run(store, summary.run)}"
        step = _next(store, summary, found, again)
    print_lines(told(found, causes, failed, judged), style="bold red" if failed else "bold green")
    print_lines(f"{sure}: {evidence(summary.rollouts, found)}", style="bold")
    print_lines(f"Next, {step}", style="cyan")


def _next(store: Store, summary: Summary, found: CauseList | None, again: str) -> str:
    """Say what to do next, with the command and how long it takes."""
    if summary.stopped == TIME_OVER:
        left = (summary.budget - summary.rollouts) * summary.seconds / max(summary.rollouts, 1)
        return f"to go on: `{again}` (about {duration(left)})"
    if found and found.certify:
        return f"to certify what is left: {found.certify}"
    if summary.findings and not found:
        triage = command("triage", summary.store, names=[summary.policy, summary.task])
        return f"to find the causes: `{triage}`{hours(store, summary.findings)}"
    cards = max(len(found.causes) if found else 0, 1)
    page = ("--limit", cards, "--out", Path(summary.store).with_suffix(".html"))
    report = command("report", summary.store, *page, names=[summary.policy, summary.task])
    return f"to see it: `{report}` (about {duration(STARTING + FILMS * cards * pace(store, 1))})"


def _foresee(plan: Plan, found: CauseList, until: Deadline) -> bool:
    """Say how long certification takes at the speed of the run; whether there is time for a cause."""
    with Store.open(plan.store) as store:
        one = PER_CAUSE * pace(store, plan.triage_place.workers)
    if until.left < one:
        left = duration(max(until.left, 0.0))
        Bar.note(f"no cause is certified: one takes about {duration(one)}, and of --time {left} is left")
        return False
    most, count = affordable(plan.manifest.budget), plural(found.found, "cause")
    some = f"the {'' if most == 1 else f'{most} '}commonest of " if most < found.found else ""
    low, high = (duration(one * times * min(most, found.found)) for times in (0.5, 2.0))
    takes = f"about {PER_CAUSE} rollouts each, {low} to {high}"
    Bar.note(f"certifying {some}{count}, {takes}; --no-certify leaves this out, --time bounds it")
    return True


def _certify(plan: Plan, summary: Summary, until: Deadline) -> bool:
    """Certify the commonest causes of a run; whether nobody interrupted it."""
    runner = partial(runner_of_run, plan.store, note=Bar.note)
    others = command("triage", plan.store, names=[plan.manifest.policy, plan.manifest.task])
    try:
        with (
            interruptible(f"interrupted: all finished causes are stored\nhint: `{others}` goes on") as bar,
            Store.open(plan.store, "write") as store,
        ):
            watch, place = shown_on(bar, "causes"), plan.triage_place
            unjudged = certify_causes(
                store, runner, summary.run, allowance=Allowance(deadline=until), place=place, watch=watch
            )
    except typer.Exit:  # the causes so far are shown all the same
        return False
    if told := note_unjudged(unjudged):
        Bar.note(f"{told}\nhint: {AGAIN}")
    return True


def checked(plan: Plan, flags: Mapping[str, Any], *, unchecked: bool) -> tuple[Plan, Speed | None]:
    """The plan after the check of its policy; says why a policy was chosen that needs no pictures."""
    manifest = plan.manifest
    usual = next(iter(world_of(manifest.task).robots))
    if plan.resume is None and "policy" not in flags and manifest.robot == usual and no_pictures(manifest.task):
        hint = "`vlafuzz doctor` says what to install"
        Bar.note(f"note: nothing here draws pictures, so the policy is {manifest.policy}; {hint}")
    with Bar() as bar:
        return checked_plan(plan, unchecked=unchecked, watch=bar)


def with_severity(config: RunConfig, run_plan: Callable[..., Done], until: Deadline) -> tuple[RunConfig, Done]:
    """The configuration with the severity at which about one half fails, and the run that found it out.

    What that run leaves of the budget is for the run that follows.
    """
    budget = config.budget or BUDGET
    probing = replace(config, severity=1.0, strategy=SEVERITY, like=None, budget=max(FEWEST, int(budget * PROBING)))
    plan = plan_of(probing)
    done = run_plan(plan, None, until.after(0.5), certify=False)
    with Store.open(plan.store) as store:
        half = half_of_run(store, done.summary.run)
    severity = min(max(round(half.value, 2), LEAST), 1.0)
    Bar.note(f"severity {severity:g}: about one half fails there")
    left = max(budget - done.summary.rollouts, config.repeats)
    return replace(config, store=plan.store, severity=severity, budget=left), done


def run_tasks(
    tasks: Sequence[str],
    flags: Mapping[str, Any],
    run_plan: Callable[..., Done],
    until: Deadline,
    *,
    resume: bool,
    unchecked: bool,
    json: bool,
) -> tuple[list[Done], str]:
    """Run each task with the same flags, up to the first interruption, and print how policies do in them.

    All share one store and the time that is left, and the policy is checked once. With ``resume``, runs that ended
    early are taken up again, and those that are over are not repeated.

    Returns:
        The runs, and in a sentence which tasks were not begun as the time was over.
    """
    policy = flags.get("policy") or default_policy(tasks[0], flags.get("robot"))
    name = "all" if set(tasks) == set(tasks_named("all")) else str(flags["task"])
    path = flags.get("store") or default_store(name, policy, flags.get("seed", 0))
    shared = {**flags, "store": path, "policy": policy}
    config = RunConfig(**{**shared, "task": None}, command=typed())
    again = command(*(word for word in sys.argv[1:] if word != "--resume"), "--resume")
    first, left = None, ""
    runs: list[Done] = []
    for number, task in enumerate(tasks):
        if until.passed:
            left = f"--time was over before these tasks began: {', '.join(tasks[number:])}"
            break
        Bar.note(f"task {number + 1} of {len(tasks)}: {task}")
        asked = {**shared, "task": task}
        before = begun(asked) if resume else None
        if before and before.status not in UNFINISHED:
            Bar.note(f"run {before.id} of it is over")
            continue
        ready = replace(config, task=task)
        if config.severity == AUTO and not before:
            ready, _ = with_severity(ready, run_plan, until.after(1 / (len(tasks) - number)))
        plan = resume_run(asked) if before else plan_of(ready)
        foreseen, remaining = 0, len(tasks) - number
        if first is None:
            first, foreseen = checked(plan, flags, unchecked=unchecked), remaining
            plan = first[0]
        elif plan.resume is None:
            plan = replace(plan, manifest=replace(plan.manifest, checkup=first[0].manifest.checkup))
        runs.append(run_plan(plan, first[1], until.after(1 / remaining), tasks=foreseen, again=again))
        if runs[-1].interrupted:
            Bar.note(f"hint: `{again}` does the other tasks")
            break
    with Store.open(path) as store:
        rows = standings_of(store)
    if json:
        print_json({"tasks": [done.document for done in runs], "standings": [one.document() for one in rows]})
    else:
        print_rows([one.row() for one in rows], title=f"policies and tasks of {path}")
    return runs, left
