"""How ``vlafuzz run`` shows a run: its progress while it goes on, a table at the end."""

import shlex
import time
from collections.abc import Mapping

from rich.table import Table

from vlafuzz.campaign.forecast import FIRST, Forecast
from vlafuzz.campaign.results import Beside
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.cli.output import Bar, stdout
from vlafuzz.common.statistics import Share
from vlafuzz.common.text import duration, interval, percent, plural, points
from vlafuzz.failures.triage.pipeline import SOON
from vlafuzz.model.outcome import Verdict
from vlafuzz.search.base import POOL, RANDOM
from vlafuzz.search.probability import Probability


class RunProgress:
    """Shows rollouts, failures and causes so far on a bar, and corrects a forecast that does not hold."""

    def __init__(self, bar: Bar, budget: int, forecast: Forecast | None = None) -> None:
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


def print_summary(
    summary: Summary, beside: Beside | None = None, about: str = "", probability: Probability | None = None
) -> None:
    """Print a run in numbers, a guided one beside random generation.

    Args:
        probability: that the policy fails in a random scene, if the strategy estimates it.
    """
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
    if beside is not None:
        stdout().print(_beside(summary, beside), soft_wrap=True)


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items())


def _failures(summary: Summary, judged: int, probability: Probability | None) -> dict[str, str]:
    """How often the policy fails; the scenes of a guided run do not say so."""
    failed = summary.verdicts["failed"]
    if summary.strategy == RANDOM:
        share = Share.of_counts(failed, judged)
        return {"failure share": _share(share.share, share.low, share.high, "")}
    if summary.strategy == POOL:
        where = "a failure rate only where they are a random sample"
        return {"failures": f"{failed} of {judged} scenes, {where}"}
    lines = {"failures": f"{failed} among {judged} guided scenes, which is not the policy's failure rate"}
    if probability:
        lines["failure probability"] = _share(*probability, " of random scenes")
    return lines


def _share(share: float, low: float, high: float, of: str) -> str:
    return f"{percent(share)}{of}, 95% interval {interval(low, high)}"


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
