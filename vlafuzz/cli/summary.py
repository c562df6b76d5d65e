"""How ``vlafuzz run`` shows a run: a bar on stderr while it goes on, a table at the end."""

import shlex
import time
from typing import Self

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from vlafuzz.campaign.forecast import FIRST, Forecast
from vlafuzz.campaign.results import Beside
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.cli.heartbeat import Heartbeat
from vlafuzz.cli.output import Bar, stderr, stdout
from vlafuzz.common.deadline import Deadline
from vlafuzz.common.statistics import Share
from vlafuzz.common.text import duration, interval, percent, plural, points
from vlafuzz.failures.triage.pipeline import SOON
from vlafuzz.model.outcome import Verdict
from vlafuzz.search.base import POOL, RANDOM
from vlafuzz.search.probability import Probability


class RunBar:
    """A progress bar: rollouts of the budget, rollouts per second, failures and causes so far, time left.

    A forecast that does not hold is corrected, once that can be said.
    """

    def __init__(self, budget: int, forecast: Forecast | None = None, until: Deadline | None = None) -> None:
        self.rollouts, self._forecast = 0, forecast
        self._first: tuple[float, int] | None = None  # time and count when the first rollout was done
        console = stderr()
        self._progress = Progress(
            SpinnerColumn(),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]} · {task.fields[failed]} failed{task.fields[causes]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task = self._progress.add_task("rollouts", total=budget, rate="starting", failed=0, causes="")
        self._heartbeat = None if console.is_terminal else Heartbeat(Bar.note, until=until)

    def __call__(self, tally: Tally) -> None:
        """One more trial is stored."""
        self.rollouts = tally.rollouts
        self._correct(tally.rollouts)
        speed = self._progress.tasks[0].speed
        rate = f"{speed:.2f} rollouts/s" if speed else "…"
        failed = tally.verdicts[Verdict.FAILED]
        causes = "" if tally.causes is None else f" · {plural(tally.causes, 'cause')}"
        self._progress.update(self._task, completed=tally.rollouts, rate=rate, failed=failed, causes=causes)
        if self._heartbeat:
            total = self._progress.tasks[0].total
            more = f", {failed} failed{causes.replace(' · ', ', ')}"
            self._heartbeat.tell("rollouts", tally.rollouts, int(total or 0), more)

    def _correct(self, rollouts: int) -> None:
        now = time.monotonic()
        began, before = self._first = self._first or (now, rollouts)
        if self._forecast and rollouts - before >= FIRST:
            if corrected := self._forecast.after((now - began) / (rollouts - before), rollouts):
                self._progress.console.print(corrected, soft_wrap=True)
            self._forecast = None

    def __enter__(self) -> Self:
        self._progress.start()
        if self._heartbeat:
            self._heartbeat.tell("rollouts", self.rollouts, int(self._progress.tasks[0].total or 0))
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
        if self._heartbeat:
            self._heartbeat.stop()


def print_summary(
    summary: Summary, beside: Beside | None = None, about: str = "", probability: Probability | None = None
) -> None:
    """Print a run in numbers, a guided one beside random generation.

    Args:
        probability: that the policy fails in a random scene, if the strategy estimates it.
    """
    policy = f"{summary.label} ({summary.policy})" if summary.label else summary.policy
    title = f"run {summary.run}: {summary.task}, {policy}, {summary.strategy}, seed {summary.seed}"
    table = Table(show_header=False, title=title, title_justify="left")
    table.add_column(style="bold")
    table.add_column()
    for name, value in [("strategy", about)] * bool(about) + _lines(summary, probability):
        table.add_row(name, value)
    console = stdout()
    console.print(table)
    if beside is not None:
        console.print(_beside(summary, beside), soft_wrap=True)


def _lines(summary: Summary, probability: Probability | None) -> list[tuple[str, str]]:
    verdicts = summary.verdicts
    judged = verdicts["passed"] + verdicts["failed"]
    lines = [("policy", summary.checkup)] if summary.checkup not in ("", "ok") else []
    lines += [
        ("rollouts", f"{summary.rollouts} of {summary.budget}, in {summary.seconds:.0f} s"),
        ("proposals", f"{summary.proposals}, {summary.duplicates} of them answered from the store"),
        ("scenes", ", ".join(f"{count} {name}" for name, count in verdicts.items())),
    ]
    if summary.earlier and ":" in summary.policy:  # the user's own model, which may have changed
        note = f"{summary.earlier} scenes: if the model has changed, give another --store"
        lines.append(("by earlier runs", note))
    if summary.invalid:
        lines.append(("invalid", ", ".join(f"{check} {count}" for check, count in summary.invalid.items())))
    if judged:
        lines += [
            ("stages reached", ", ".join(f"{stage} {count}" for stage, count in summary.stages.items())),
            *_failures(summary, judged, probability),
        ]
    if summary.last_error is not None:
        lines.append(("last error", summary.last_error))
    if summary.progress_mean is not None:
        lines.append(("mean progress", f"{summary.progress_mean:.3f}"))
    return [*lines, ("store", summary.store)]


def _failures(summary: Summary, judged: int, probability: Probability | None) -> list[tuple[str, str]]:
    """How often the policy fails; the scenes of a guided run do not say so."""
    failed = summary.verdicts["failed"]
    if summary.strategy == RANDOM:
        share = Share.of_counts(failed, judged)
        return [("failure share", f"{percent(share.share)}, 95% interval {interval(share.low, share.high)}")]
    if summary.strategy == POOL:
        return [
            ("failures", f"{failed} of {judged} scenes, a failure rate only where they are a random sample")
        ]
    lines = [("failures", f"{failed} among {judged} guided scenes, which is not the policy's failure rate")]
    if probability:
        bounds = interval(probability.low, probability.high)
        estimate = f"{percent(probability.value)} of random scenes, 95% interval {bounds}"
        lines.append(("failure probability", estimate))
    return lines


def _beside(summary: Summary, beside: Beside) -> str:
    """The failure shares of the run and of random generation, in a sentence."""
    if not beside.random_judged:
        return (
            "beside random: unknown, the store has no random run of this policy, task and operators; "
            f"the same command with --strategy random {shlex.join(['--store', summary.store])} adds one"
            + (f", in about {duration(summary.seconds)}" if summary.seconds > SOON else "")
        )
    if beside.difference is None or beside.low is None or beside.high is None:
        return "beside random: unknown, no scene of this run could be judged"
    ours, random = beside.failed / beside.judged, beside.random_failed / beside.random_judged
    shares = f"{percent(ours)} of {beside.judged} scenes failed"
    shares += f", of {beside.random_judged} random ones {percent(random)}"
    bounds = f"95% interval {points(beside.low)} to {points(beside.high)}"
    difference = f"{points(beside.difference)} points, {bounds}"
    return f"beside random: {shares}: {difference}" + ("" if beside.tells else ": too few to tell")
