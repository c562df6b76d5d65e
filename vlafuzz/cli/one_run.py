"""One run of ``vlafuzz run``, with what follows it: forecast, run, causes, certification.

This is loaded after the simulator for workers has begun to load.
"""

import shlex
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import typer
from rich.table import Table

from vlafuzz.campaign.config import Plan
from vlafuzz.campaign.forecast import FIRST, Forecast, Speed
from vlafuzz.campaign.launch import SEARCH, start
from vlafuzz.campaign.results import Beside, beside_random
from vlafuzz.campaign.results import again as how_again
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.cli.output import Bar, interruptible, print_lines, print_rows, stdout
from vlafuzz.cli.triage import AGAIN, broken, print_causes, triage_store
from vlafuzz.common.deadline import Deadline
from vlafuzz.common.plugins import trust_flag
from vlafuzz.common.statistics import Share
from vlafuzz.common.text import duration, interval, percent, plural, points
from vlafuzz.errors import PolicyError, StoreError
from vlafuzz.failures.causes import CauseList, causes_of
from vlafuzz.failures.described import Spaces
from vlafuzz.failures.triage.jobs import Allowance
from vlafuzz.failures.triage.pipeline import PER_CAUSE, PER_FINDING, SOON, affordable, hours, pace
from vlafuzz.model.outcome import Verdict
from vlafuzz.report.effects import effects_of
from vlafuzz.search.base import POOL, RANDOM, about, looks_for_causes
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import UNFINISHED
from vlafuzz.store.store import Store

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
    causes, says, allowance = _causes(summary), about(plan.strategy), Allowance(deadline=until)
    document = asdict(summary) | _results(summary, causes, says, show=not asked.json)
    triaged: dict[str, Any] | None = {}
    if asked.triage or certifying:
        triaged = _triage(plan, summary, causes, allowance, forecast, asked)
        causes = _causes(summary)
    if not asked.json:
        _print_causes(summary, causes, hint=not asked.triage)
    if not asked.triage and (triaged is None or allowance.used_up):
        _hint_at_rest(plan, causes)
    document |= (causes.document() if causes else _NO_CAUSES) | {"about": says}
    return Done(summary, document | ({"triage": triaged} if asked.triage else {}), again, interrupted=triaged is None)


def _start(plan: Plan, forecast: Forecast | None, until: Deadline, again: str) -> Summary:

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
            return start(plan, _Progress(bar, plan.manifest.budget, forecast), until)
        except PolicyError as error:
            hint = f"when the policy is back, continue with `{again}`"
            raise PolicyError(error.message, hint=hint) from error


class _Progress:
    """Shows rollouts, failures and causes so far on a bar, and corrects a forecast that does not hold."""

    def __init__(self, bar: Bar, budget: int, forecast: Forecast | None) -> None:
        self._bar, self._budget, self._forecast = bar, budget, forecast
        self._first: tuple[float, int] | None = None  # time and count when the first rollout was done
        bar.progress("rollouts", 0, budget)

    def __call__(self, tally: Tally) -> None:
        """One more trial is stored."""
        causes = "" if tally.causes is None else f", {plural(tally.causes, 'cause')}"
        more = f", {tally.verdicts[Verdict.FAILED]} failed{causes}"
        self._bar.progress("rollouts", tally.rollouts, self._budget, more)
        now = time.monotonic()
        began, before = self._first = self._first or (now, tally.rollouts)
        if self._forecast and (done := tally.rollouts - before) >= FIRST:
            if corrected := self._forecast.after((now - began) / done, tally.rollouts):
                self._bar.note(corrected)
            self._forecast = None


def _causes(summary: Summary) -> CauseList | None:

    with Store.open(Path(summary.store)) as store:
        return next(causes_of(store, run) for run in store.runs() if run.id == summary.run)


def _results(summary: Summary, causes: CauseList | None, says: str, *, show: bool) -> dict[str, Any]:
    """What the store tells of a finished run as JSON, and with ``show`` printed after the run in numbers.

    A guided run is put beside random ones; random scenes tell how often the policy fails by their values; scenes of a
    file that says how they ended before are compared with that.
    """
    with Store.open(Path(summary.store)) as store:
        run = next(run for run in store.runs() if run.id == summary.run)
        beside = None if summary.strategy in (RANDOM, POOL) else beside_random(store, run.id)
        effects = effects_of(store, run, Spaces(store.path).of(run.manifest))
        again = how_again(store, run.id)
    if show:
        _print_summary(summary, says, causes.probability if causes else None)
        if beside is not None:
            print_lines(_beside(summary, beside))
        if again is not None:
            stdout().print(str(again), style="bold", soft_wrap=True)
        if effects is not None:
            if effects.table.rows:
                print_rows(effects.table.rows, title=effects.table.title)
            print_lines(effects.says, effects.advice)
    parts = {"random": beside, "effects": effects, "again": again}
    return {name: None if part is None else asdict(part) for name, part in parts.items()}


def _print_summary(summary: Summary, about: str, probability: Probability | None) -> None:
    """Print a run in numbers."""
    policy = f"{summary.label} ({summary.policy})" if summary.label else summary.policy
    title = f"run {summary.run}: {summary.task}, {policy}, {summary.strategy}, seed {summary.seed}"
    judged = summary.verdicts["passed"] + summary.verdicts["failed"]
    again = summary.earlier if ":" in summary.policy else 0  # the user's own model, which may have changed
    lines = {
        "strategy": about,
        "policy": summary.checkup if summary.checkup != "ok" else "",
        "rollouts": f"{summary.rollouts} of {summary.budget}, in {summary.seconds:.0f} s",
        "proposals": f"{summary.proposals}, {summary.duplicates} of them answered from the store",
        "scenes": ", ".join(f"{count} {name}" for name, count in summary.verdicts.items()),
        "by earlier runs": f"{again} scenes: if the model has changed, give another --store" * bool(again),
        "invalid": _counts(summary.invalid),
        "stages reached": _counts(summary.stages) if judged else "",
        **(_failures(summary, judged, probability) if judged else {}),
        "last error": summary.last_error,
        "mean progress": "" if summary.progress_mean is None else f"{summary.progress_mean:.3f}",
        "store": summary.store,
    }
    table = Table(show_header=False, title=title, title_justify="left")
    table.add_column(style="bold")
    table.add_column()
    for name, line in lines.items():
        if line:
            table.add_row(name, line)
    stdout().print(table)


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items())


def _failures(summary: Summary, judged: int, probability: Probability | None) -> dict[str, str]:
    """How often the policy fails; the scenes of a guided run do not say so."""
    failed = summary.verdicts["failed"]
    if summary.strategy == RANDOM:
        share = Share.of_counts(failed, judged)
        return {"failure share": f"{percent(share.share)}, 95% interval {interval(share.low, share.high)}"}
    if summary.strategy == POOL:
        where = "a failure rate only where they are a random sample"
        return {"failures": f"{failed} of {judged} scenes, {where}"}
    lines = {"failures": f"{failed} among {judged} guided scenes, which is not the policy's failure rate"}
    if probability:
        bounds = interval(probability.low, probability.high)
        lines["failure probability"] = f"{percent(probability.value)} of random scenes, 95% interval {bounds}"
    return lines


def _beside(summary: Summary, beside: Beside) -> str:
    """The failure shares of the run and of random generation, in a sentence."""
    if not beside.random_judged:
        takes = f", in about {duration(summary.seconds)}" if summary.seconds > SOON else ""
        return (
            "beside random: unknown, the store has no random run of this policy, task and operators; "
            f"the same command with --strategy random {shlex.join(['--store', summary.store])} adds one{takes}"
        )
    if beside.difference is None or beside.low is None or beside.high is None:
        return "beside random: unknown, no scene of this run could be judged"
    ours, random = beside.failed / beside.judged, beside.random_failed / beside.random_judged
    shares = f"{percent(ours)} of {beside.judged} scenes failed"
    shares += f", of {beside.random_judged} random ones {percent(random)}"
    bounds = f"95% interval {points(beside.low)} to {points(beside.high)}"
    few = "" if beside.tells else ": too few to tell"
    return f"beside random: {shares}: {points(beside.difference)} points, {bounds}{few}"


def _print_causes(summary: Summary, found: CauseList | None, *, hint: bool) -> None:
    """Print the causes, or with ``hint`` how to find them; and how to see the first cause or failure."""
    if found:
        print_causes(replace(found, probability=None))  # which the summary has said
    elif hint and summary.findings:
        with Store.open(Path(summary.store)) as store:
            takes = hours(store, summary.findings)
        command = shlex.join(["vlafuzz", "triage", summary.store, *trust_flag(summary.policy)])
        whose = "its cause" if summary.findings == 1 else "their causes"
        print_lines(f"{plural(summary.findings, 'failure')}; `{command}` finds {whose}{takes}")
    shown = found.shown if found else None
    if scene := shown or summary.first_failure:
        command = shlex.join(["vlafuzz", "replay", summary.store, scene[:12]])
        print_lines(f"see the first {'cause' if shown else 'failure'}: {command}")


def _hint_at_rest(plan: Plan, found: CauseList | None) -> None:
    """How to certify as many causes as are missing after an interruption, or when the time is over."""
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
    if found and found.found and not asked.triage and not _foresee(plan, found, allowance.deadline, forecast):
        _hint_at_rest(plan, found)
        return {}
    of, show = None if asked.triage else summary.run, asked.triage and not asked.json
    try:
        result = triage_store(plan.store, allowance, plan.triage_place, causes_of=of, show=show)
    except typer.Exit:  # the causes so far are shown all the same
        return None
    if told := broken(result):
        Bar.note(f"{told}\nhint: {AGAIN}")
    return result


def _foresee(plan: Plan, found: CauseList, until: Deadline, forecast: Forecast | None) -> bool:
    """Say how long certification takes by the time that rollouts took; whether there is time for a cause."""
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
