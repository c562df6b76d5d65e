"""Standings: how each policy of a store does in each task, as rows for people and for programs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import interval, percent
from vlafuzz.report.causes import CauseList, all_causes
from vlafuzz.report.counts import Counts, count
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store


@dataclass(frozen=True, kw_only=True)
class Standing:
    """How a policy does in a task.

    Attributes:
        rate: how often it fails in random scenes, by the newest run that tells; None if none does. causes: that the
        newest run found whose strategy looks for causes, of which ``certified`` are
            certified; None without such a run.
        rollouts: of all runs, without those of triage, which are ``triage_rollouts``.
    """

    policy: str
    task: str
    rate: Probability | None
    causes: int | None
    certified: int | None
    rollouts: int
    triage_rollouts: int

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
            "to certify": self.triage_rollouts,
        }

    def document(self) -> dict[str, object]:
        """The columns for programs: the rate with its 95 % interval, as ``rate``, ``low`` and ``high``."""
        rate = self.rate
        return {
            "policy": self.policy,
            "task": self.task,
            "rate": rate.value if rate else None,
            "low": rate.low if rate else None,
            "high": rate.high if rate else None,
            "causes": self.causes,
            "certified": self.certified,
            "rollouts": self.rollouts,
            "triage_rollouts": self.triage_rollouts,
        }


def standings_of(store: Store) -> tuple[Standing, ...]:
    """The standings of a store."""
    return standings(store, store.runs(), count(store), all_causes(store))


def standings(store: Store, runs: Sequence[Run], counts: Counts, lists: Sequence[CauseList]) -> tuple[Standing, ...]:
    """One for each policy and task of the runs, in the order in which they were first tried.

    Args:
        counts, lists: of the same store.
    """
    groups = defaultdict[tuple[str, str], list[Run]](list)
    for run in runs:
        groups[run.manifest.model, run.manifest.task].append(run)
    manifests = {run.id: run.manifest for run in runs}
    found_by = {finding.key: manifests[finding.run] for finding in store.findings()}
    spent = defaultdict[tuple[str, str], int](int)
    for row in store.triaged():
        if row.key in found_by:  # always, unless somebody changed the store
            spent[found_by[row.key].model, row.scene.task] += row.policy_rollouts
    by_run = {one.run: one for one in lists}
    return tuple(
        _standing(store, several, by_run, counts.begun[task, model], spent[model, task])
        for (model, task), several in groups.items()
    )


def _standing(
    store: Store, runs: Sequence[Run], lists: Mapping[int, CauseList], rollouts: int, triage: int
) -> Standing:
    newest = runs[::-1]
    found = next((lists[run.id] for run in newest if run.id in lists), None)
    rates = (_rate(store, run, lists.get(run.id)) for run in newest)
    return Standing(
        policy=runs[0].manifest.model,
        task=runs[0].manifest.task,
        rate=next(filter(None, rates), None),
        causes=found.found if found else None,
        certified=found.certified if found else None,
        rollouts=rollouts,
        triage_rollouts=triage,
    )


def _rate(store: Store, run: Run, found: CauseList | None) -> Probability | None:
    """How often random scenes fail: the share of a random run, or what a strategy estimates."""
    if run.manifest.strategy != "random":
        return found.probability if found else None
    failed = Share.of_counts(*store.judged([run.id]))
    return Probability(failed.share, failed.low, failed.high) if failed.of else None
