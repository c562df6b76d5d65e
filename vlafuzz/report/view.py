"""View: what the page shows, as values. Nothing here knows HTML."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from vlafuzz.evidence import Actions, Causes
from vlafuzz.regression.corpus import Share
from vlafuzz.report.words import named
from vlafuzz.scene import Scene
from vlafuzz.sim.base import Film
from vlafuzz.store.records import Manifest

# How far the evidence for a finding goes, the most first, and what that means.
BUCKETS: Mapping[str, str] = {
    "minimal": "fails again, the expert solves it, and every operator left in it matters",
    "witnessed": "fails again, the expert solves it; not shown to be minimal",
    "base": "fails even where all operators are nominal",
    "unproven": "fails again, but the expert fails, too",
    "flaky": "does not mostly fail again",
    "observed": "failed once; not triaged",
}


# What triage came to, as shares of the findings that were triaged.
SHARES: Mapping[str, str] = {
    "confirmed": "failed again, in a fresh environment",
    "witnessed": "the expert solves it",
    "minimal": "of these, every operator left in it matters",
    "base": "fails even where all operators are nominal",
    "unproven": "the expert fails, too",
    "flaky": "does not mostly fail again",
}


@dataclass(frozen=True)
class Measure:
    """A share with its name, drawn as a bar; ``says`` explains the name."""

    name: str
    share: Share
    says: str = ""


@dataclass(frozen=True)
class Chart:
    """Some measures under one title, ``says`` in a sentence of what they are shares."""

    title: str
    says: str
    measures: tuple[Measure, ...]


@dataclass(frozen=True)
class OperatorRow:
    """How often an operator is left in shrunk scenes, is necessary there, and suffices alone."""

    name: str
    left: Share
    necessary: int
    sufficient: int


@dataclass(frozen=True)
class RunRow:
    """One run; ``failed`` of the scenes that it judged."""

    id: int
    task: str
    policy: str
    strategy: str
    seed: int
    budget: int
    status: str
    failed: Share | None


@dataclass(frozen=True)
class Deviation:
    """What an operator does to a scene, beside its nominal value, and from where on the policy fails."""

    operator: str
    value: str
    nominal: str
    fails_from: str = ""


@dataclass(frozen=True, eq=False)
class Card:
    """A failure in the gallery.

    Attributes:
        scene: what is left of the finding where that is minimal, else the finding itself.
        found: digests of the findings of which it is left.
        run: that found the first of them.
        bucket: one of ``BUCKETS``.
        operators: not nominal in the scene, the confounders' as one.
        witness: the actions that solve the scene, if it has a witness.
        detail: more on its evidence, in a sentence.
        replay: the command that shows it again.
        picture: PNG; where there are films they show more.
    """

    scene: Scene
    found: tuple[str, ...]
    run: Manifest
    bucket: str
    lost_stage: str
    signature: str
    operators: tuple[str, ...]
    deviations: tuple[Deviation, ...]
    causes: Causes
    witness: Actions | None
    detail: str
    replay: str
    picture: bytes | None = None
    failure: Film | None = None
    solution: Film | None = None

    @property
    def title(self) -> str:
        """What it takes, in a few words."""
        if self.bucket == "base":
            return "fails at nominal"
        if len(self.operators) > 3:
            return f"{len(self.operators)} operators not nominal"
        return " + ".join(self.operators) or "all operators nominal"

    def role(self, operator: str) -> str:
        """What is known of an operator's part in the failure."""
        causes = self.causes
        roles = {"necessary": causes.necessary, "sufficient alone": causes.sufficient}
        return ", ".join(role for role, operators in roles.items() if operator in operators)


@dataclass(frozen=True)
class Filter:
    """Something to narrow the gallery by; one of ``choices`` at a time."""

    key: str
    name: str
    choices: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class View:
    """The page.

    Attributes:
        headline: the result in a sentence.
        facts: names and values.
        todo: what is to be done next, each a sentence and the command.
        runs: manifests of all of them.
        cards: those with the most evidence first, those of one signature together.
        notes: what the reader should know of the page, in sentences.
    """

    title: str
    source: str
    headline: str
    facts: tuple[tuple[str, str], ...]
    todo: tuple[tuple[str, str], ...]
    runs: tuple[Manifest, ...]
    run_rows: tuple[RunRow, ...]
    charts: tuple[Chart, ...]
    operators: tuple[OperatorRow, ...]
    cards: tuple[Card, ...]
    notes: tuple[str, ...] = ()

    @property
    def signatures(self) -> tuple[tuple[str, int], ...]:
        """Findings by bug, the most frequent first."""
        counted: Counter[str] = Counter()
        for card in self.cards:
            if card.signature and card.bucket != "base":
                counted[card.signature] += len(card.found)
        return tuple(counted.most_common())

    @property
    def filmed(self) -> bool:
        """Whether there is any film."""
        return any(card.failure or card.solution for card in self.cards)

    @property
    def filters(self) -> tuple[Filter, ...]:
        """Those by which the gallery can be narrowed."""
        cards = self.cards
        return (
            _filter("task", "Task", ((card.scene.task,) for card in cards)),
            _filter("stage", "Lost stage", ((card.lost_stage,) for card in cards)),
            _filter("operator", "Operator", (card.operators for card in cards)),
            _filter("evidence", "Evidence", ((card.bucket,) for card in cards)),
        )


def title_of(runs: Sequence[Manifest]) -> str:
    """Which policies in which tasks."""
    if not runs:
        return "no run yet"
    return f"{named(run.policy for run in runs)} on {named(run.task for run in runs)}"


def in_order(cards: Iterable[Card]) -> tuple[Card, ...]:
    """Those with the most evidence first, then those of the most frequent signature."""
    cards = list(cards)
    often = Counter(card.signature for card in cards)
    ranks = {name: rank for rank, name in enumerate(BUCKETS)}
    return tuple(sorted(cards, key=lambda card: (ranks[card.bucket], -often[card.signature], card.signature)))


def _filter(key: str, name: str, values: Iterable[tuple[str, ...]]) -> Filter:
    return Filter(key, name, tuple(sorted({value for each in values for value in each})))


def operator_rows(shrunk: Iterable[tuple[Sequence[str], Causes]]) -> tuple[OperatorRow, ...]:
    """From the operators that are left in scenes and their causes, the operator most often left first."""
    parts = list(shrunk)
    left = Counter(name for operators, _ in parts for name in operators)
    necessary = Counter(name for _, causes in parts for name in causes.necessary)
    sufficient = Counter(name for _, causes in parts for name in causes.sufficient)
    return tuple(
        OperatorRow(name, Share.of_counts(count, len(parts)), necessary[name], sufficient[name])
        for name, count in left.most_common()
    )
