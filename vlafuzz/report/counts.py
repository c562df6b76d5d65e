"""Counts of a store: how each policy does in each task, and which of its scenes were drawn at random."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import interval, percent
from vlafuzz.failures.causes import CauseList, all_causes
from vlafuzz.search.base import RANDOM
from vlafuzz.search.probability import Probability
from vlafuzz.search.severity import Half, half_of, severity_of
from vlafuzz.store.records import Run, Trial
from vlafuzz.store.store import Store


@dataclass(frozen=True, kw_only=True)
class Standing:
    """How a policy does in a task.

    Attributes:
        rate: how often it fails in random scenes, by the newest run that tells; None if none does.
        causes: that the newest run found whose strategy looks for causes, of which ``certified`` are certified; None
            without such a run.
        rollouts: of all runs, without those of triage.
    """

    policy: str
    task: str
    rate: Probability | None
    causes: int | None
    certified: int | None
    rollouts: int

    def row(self) -> dict[str, object]:
        """The columns of a table for people."""
        rate = self.rate
        return {
            "policy": self.policy,
            "task": self.task,
            "fails in random scenes": f"{percent(rate.value)} ({interval(rate.low, rate.high)})" if rate else "–",
            "causes": "–" if self.causes is None else self.causes,
            "certified": "–" if self.certified is None else self.certified,
            "rollouts": self.rollouts,
        }

    def document(self) -> dict[str, object]:
        """The columns for programs: the rate with its 95 % interval, as ``rate``, ``low`` and ``high``."""
        rate = self.rate._asdict() if self.rate else dict.fromkeys(Probability._fields)
        rates = {"rate": rate.pop("value"), **rate}
        known = {"causes": self.causes, "certified": self.certified, "rollouts": self.rollouts}
        return {"policy": self.policy, "task": self.task, **rates, **known}


def rollouts_of(store: Store, run: Run) -> int:
    """The rollouts of a run, without those that another run had made."""
    return sum(len(trial.outcome.rollouts) for trial in store.trials(run.id) if not trial.duplicate)


def draws(store: Store, run: Run) -> Callable[[Trial], bool]:
    """Tells whether a trial of a run is a random draw, whose choice depended on no outcome."""
    if run.manifest.strategy == RANDOM:
        return lambda trial: True
    attribution = store.causes(run.id)
    drawn = set(attribution.at_random) if attribution else set[int]()
    return lambda trial: trial.proposal in drawn


def standings_of(store: Store, lists: Sequence[CauseList] | None = None) -> tuple[Standing, ...]:
    """One for each policy and task of a store, in the order in which they were first tried.

    Args:
        lists: of the same store, if they are there already.
    """
    by_run = {one.run: one for one in (all_causes(store) if lists is None else lists)}
    groups = defaultdict[tuple[str, str], list[Run]](list)
    for run in store.runs():
        groups[run.manifest.model, run.manifest.task].append(run)
    standings = []
    for (policy, task), several in groups.items():
        newest = several[::-1]
        found = next((by_run[run.id] for run in newest if run.id in by_run), None)
        rates = (_rate(store, run, by_run.get(run.id)) for run in newest)
        standings.append(
            Standing(
                policy=policy,
                task=task,
                rate=next(filter(None, rates), None),
                causes=found.found if found else None,
                certified=found.certified if found else None,
                rollouts=sum(rollouts_of(store, run) for run in several),
            )
        )
    return tuple(standings)


def _rate(store: Store, run: Run, found: CauseList | None) -> Probability | None:
    """How often random scenes fail: the share of a random run, or what a strategy estimates."""
    if run.manifest.strategy != RANDOM:
        return found.probability if found else None
    failed = Share.of_counts(*store.judged([run.id]))
    return Probability(failed.share, failed.low, failed.high) if failed.of else None


def half_of_run(store: Store, run: int) -> Half:
    """The severity at which one half fails, by a run of the strategy ``severity``."""
    judged = (trial for trial in store.trials(run) if trial.outcome.judged)
    return half_of([(severity_of(trial.proposal), not trial.outcome.passed) for trial in judged])


def half_in_words(half: Half) -> str:
    """The severity at which one half fails, as a phrase."""
    if half.low >= 1:
        return "above 1: fewer than one half fail in the whole ranges"
    if half.high <= 0:
        return "0: nominal scenes fail as often"
    return f"{half.value:.2f} of the ranges, 95% interval {half.low:.2f}–{half.high:.2f}{'+' * (half.high >= 1)}"
