"""Pages as values, without HTML: the report, and sheets of plots, tables and sentences."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import interval, named
from vlafuzz.model.evidence import Causes, Rate, Solver, Witness
from vlafuzz.model.scene import Scene
from vlafuzz.search.base import RANDOM
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.evaluation import Film

# Buckets of findings with their meaning, from the most evidence to the least.
BUCKETS: Mapping[str, str] = {
    "minimal": "certified: it fails more often than without any one of its operators; the expert solves it",
    "witnessed": "mostly fails, the expert solves it; not shown to be minimal",
    "base": "fails even with all operators nominal, and no scene near it is known to pass",
    "unproven": "mostly fails, but the expert fails, too",
    "edge": "fails exactly as it is, but not in scenes that hardly differ",
    "flaky": "passes in most repeats, or in about half",
    "observed": "failed once; not triaged",
}


# Results of triage with their meaning, as shares of the triaged findings.
SHARES: Mapping[str, str] = {
    "confirmed": "mostly fails in its neighbourhood",
    "witnessed": "the expert solves it",
    "by sight": "of these, the seeing expert solves it, too",
    "minimal": "of these, every remaining operator matters",
    "base": "fails even with all operators nominal, and no scene near it is known to pass",
    "unproven": "the expert fails, too",
    "edge": "fails exactly as it is, but not in scenes that hardly differ",
    "flaky": "passes in most repeats, or in about half",
}


# Solvers of witnesses with what they know.
SOLVERS: Mapping[Solver, str] = {
    "expert": "the expert, by the simulator's state",
    "seeing": "the seeing expert, by what the camera shows",
}


@dataclass(frozen=True)
class Measure:
    """A share with its name, drawn as a bar; ``says`` explains the name.

    Attributes:
        rate: whether the share estimates a rate; if not, as the scenes were chosen, only counts show.
    """

    name: str
    share: Share
    says: str = ""
    rate: bool = True


@dataclass(frozen=True)
class Chart:
    """Measures under a title; ``says`` is a sentence on what they are shares of."""

    title: str
    says: str
    measures: tuple[Measure, ...]


@dataclass(frozen=True)
class OperatorRow:
    """How often an operator remains in shrunk scenes, is necessary there, and suffices alone."""

    name: str
    left: Share
    necessary: int
    sufficient: int


@dataclass(frozen=True)
class RunRow:
    """A run; ``failed``: of the scenes that it judged."""

    id: int
    manifest: Manifest
    status: str = ""
    failed: Share | None = None

    @property
    def guided(self) -> bool:
        """Whether a strategy or the user chose the scenes: then their failures are no failure rate."""
        return self.manifest.strategy != RANDOM


@dataclass(frozen=True)
class Deviation:
    """An operator's value in a scene and in its reference, and the threshold from which the policy fails.

    Attributes:
        fails_from: the range that fails; empty if there is no threshold, or none that is known. missing: why it is not
        known, in a clause.
    """

    operator: str
    value: str
    reference: str
    fails_from: str = ""
    missing: str = ""

    @property
    def range(self) -> str:
        """The range that fails, else the value."""
        return self.fails_from or ", ".join(filter(None, (self.value, self.missing)))


@dataclass(frozen=True)
class Table:
    """Rows with the same keys, which are the column heads; the first column names the row."""

    title: str
    rows: Sequence[Mapping[str, object]]
    says: str = ""

    @property
    def columns(self) -> Mapping[str, bool]:
        """Column heads, and whether the column holds numbers."""
        return {head: all(_is_number(row[head]) for row in self.rows) for head in self.rows[0]}


def _is_number(value: object) -> bool:
    return str(value).startswith(tuple("–0123456789"))


@dataclass(frozen=True, eq=False, kw_only=True)
class Card:
    """A failure in the gallery.

    Attributes:
        scene: the minimal scene of the finding if there is one, else the finding itself.
        findings: digests of the findings with this scene; ``alike``: of those that have no card, as this one shows what
            they do: near-duplicates, and failures that only add operators to it.
        run: the run that found the first of them.
        bucket: one of ``BUCKETS``.
        operators: those in which the scene differs from its reference; the confounder operators count as one.
        reference: the passing scene that it is compared with; None for the nominal one. counterpart_rates: how often
        the policy fails around the scene without an operator, by operator. rate: how often the policy fails around the
        scene; None if unknown.
        detail: the evidence, in a sentence.
        replay: the command that replays the scene.
        picture: PNG, shown if there are no films.
    """

    scene: Scene
    findings: tuple[str, ...]
    run: Manifest
    bucket: str
    lost_stage: str
    signature: str = ""
    operators: tuple[str, ...]
    deviations: tuple[Deviation, ...]
    causes: Causes
    counterpart_rates: Mapping[str, Rate] = field(default_factory=dict)
    reference: Scene | None = None
    witness: Witness | None = None
    rate: Rate | None = None
    detail: str
    replay: str
    alike: tuple[str, ...] = ()
    picture: bytes | None = None
    failure: Film | None = None
    solution: Film | None = None

    @property
    def key(self) -> tuple[str, str]:
        """See ``Finding.key``; of several findings that of the first."""
        return self.findings[0], self.run.key()

    @property
    def title(self) -> str:
        """The operators, in a few words."""
        if self.bucket == "base":
            return "fails at nominal"
        if len(self.operators) > 3:
            return f"{len(self.operators)} operators{'' if self.reference else ' not nominal'}"
        return " + ".join(self.operators) or "all operators nominal"

    def role(self, operator: str) -> str:
        """Whether an operator is necessary or sufficient for the failure, in words."""
        causes = self.causes
        roles = {"necessary": causes.necessary, "sufficient alone": causes.sufficient}
        return ", ".join(role for role, operators in roles.items() if operator in operators)

    def without(self, operator: str) -> str:
        """How often the policy fails without an operator, in words; empty if unknown."""
        rate = self.counterpart_rates.get(operator)
        if rate is None:
            return ""
        counts = f"{rate.failures} of {rate.rollouts} rollouts fail"
        return f"without it {counts} ({interval(rate.low, rate.high)})"


@dataclass(frozen=True)
class Filter:
    """A filter of the gallery, by one of ``choices`` at a time."""

    key: str
    name: str
    choices: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """The page.

    Attributes:
        headline: the result in a sentence.
        todo: next steps, each a sentence and the command.
        causes: those of each run whose strategy looks for them.
        cards: those of causes, then the others, by evidence, most first, and by signature.
        notes: caveats, in sentences.
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
    causes: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def filmed(self) -> bool:
        return any(card.failure or card.solution for card in self.cards)

    @property
    def solved(self) -> bool:
        """Whether there is a film of a witness."""
        return any(card.solution for card in self.cards)

    @property
    def filters(self) -> tuple[Filter, ...]:
        cards = self.cards
        return (
            _filter("task", "Task", (card.scene.task for card in cards)),
            _filter("stage", "Lost stage", (card.lost_stage for card in cards)),
            _filter("operator", "Operator", (name for card in cards for name in card.operators)),
            _filter("evidence", "Evidence", (card.bucket for card in cards)),
        )


def title_of(runs: Sequence[Manifest]) -> str:
    if not runs:
        return "no run yet"
    return f"{named(run.short for run in runs)} on {named(run.task for run in runs)}"


def in_order(cards: Iterable[Card]) -> tuple[Card, ...]:
    """Ordered by evidence, the most first, then by the frequency of the signature."""
    cards = list(cards)
    counts = Counter(card.signature for card in cards)
    ranks = list(BUCKETS)
    return tuple(sorted(cards, key=lambda card: (ranks.index(card.bucket), -counts[card.signature], card.signature)))


def _filter(key: str, name: str, values: Iterable[str]) -> Filter:
    return Filter(key, name, tuple(sorted(set(values))))


def operator_rows(shrunk: Iterable[tuple[Sequence[str], Causes]]) -> tuple[OperatorRow, ...]:
    """From the operators that remain in scenes, and the causes; the most frequent operator first."""
    scenes = list(shrunk)
    left = Counter(name for operators, _ in scenes for name in operators)
    necessary = Counter(name for _, causes in scenes for name in causes.necessary)
    sufficient = Counter(name for _, causes in scenes for name in causes.sufficient)
    return tuple(
        OperatorRow(name, Share.of_counts(count, len(scenes)), necessary[name], sufficient[name])
        for name, count in left.most_common()
    )
