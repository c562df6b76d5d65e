"""Pace: a bar over several runs, and early on how long all of them will take."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Self

from vlafuzz.campaign.tally import Tally
from vlafuzz.cli.output import progress, stderr
from vlafuzz.store.records import UNFINISHED, Run

_FIRST = 20  # rollouts after which the rest can be estimated


class Pace:
    """Hears of every trial of every run.

    Args:
        budgets: rollouts of each run that is to be done.
        known: runs of the same conditions: where some are over, they say at once how long a rollout takes.
    """

    def __init__(self, budgets: Sequence[int], known: Sequence[Run]) -> None:
        self._budgets, self._begun = budgets, 0
        self._bar = progress()
        self._task = self._bar.add_task("", total=sum(budgets))
        self._began: tuple[float, int] | None = (
            None  # when the first rollout was done, and how many then were
        )
        over = [run for run in known if run.status not in UNFINISHED and run.seconds]
        self._told = bool(over)
        if over:
            seconds = sum(run.seconds or 0.0 for run in over) / sum(run.manifest.budget for run in over)
            self._estimate(seconds, "at the speed of the runs in the store")

    def begin(self, name: str) -> None:
        """The next run."""
        self._begun += 1
        self._bar.update(self._task, description=f"run {self._begun} of {len(self._budgets)}: {name}")

    def __call__(self, tally: Tally) -> None:
        """One more trial is stored."""
        now = time.monotonic()
        done = sum(self._budgets[: self._begun - 1]) + tally.rollouts
        self._bar.update(self._task, completed=done)
        if self._began is None:
            self._began = (now, done)
        elif not self._told and done - self._began[1] >= _FIRST:
            self._told = True
            seconds, rollouts = now - self._began[0], done - self._began[1]
            self._estimate(seconds / rollouts, f"at the speed of the first {rollouts} rollouts")

    def say(self, text: str) -> None:
        """A line above the bar."""
        stderr().print(text, soft_wrap=True)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def _estimate(self, seconds_each: float, how: str) -> None:
        total = sum(self._budgets)
        told = f"{len(self._budgets)} runs, {total} rollouts: about {_duration(seconds_each * total)} {how}"
        self.say(told)


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
