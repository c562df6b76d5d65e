"""The report as values, without HTML."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from vlafuzz.failures.described import DescribedFailure
from vlafuzz.failures.regions import Band
from vlafuzz.model import Scene
from vlafuzz.report.plots import Axis, Plot
from vlafuzz.report.tables import Table
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.evaluator import Film


class Strip(NamedTuple):
    """An axis with the value of a scene, and what fails for its cause."""

    axis: Axis
    value: float
    fails: Sequence[Band]


class Shot(NamedTuple):
    """A film of a card; ``kind`` is ``passes``, ``fails`` or ``solves``; ``missing``: why there is no film."""

    kind: str
    says: str
    film: Film | None
    missing: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Card:
    """A cause with a scene that shows it, or a failure without a cause.

    Attributes:
        of: the failure; None for a cause that no stored failure shows.
        more: digests of further failures that its cause explains, which have no card.
        badge: how well it is shown, and what that means; ``mark``: its kind, for its colour.
        step: what to do next, and the command.
        neighbours: scenes in which the policy should pass, the likeliest first, with their names.
        plot: the scenes among which it is; ``bands``: what fails there.
    """

    id: str
    title: str
    of: DescribedFailure | None
    more: Sequence[str] = ()
    badge: tuple[str, str]
    mark: str = "none"
    numbers: Sequence[tuple[str, str]] = ()
    strips: Sequence[Strip] = ()
    step: tuple[str, str] | None = None
    neighbours: Sequence[tuple[str, Scene]] = ()
    shots: Sequence[Shot] = ()
    plot: Plot | None = None
    bands: Sequence[Band] = ()

    @property
    def failing(self) -> Film | None:
        """The film of the failure."""
        return next((shot.film for shot in self.shots if shot.kind == "fails"), None)

    @property
    def picture(self) -> str:
        """Whether its picture is as good as ``white`` or ``black``, in a word for a filter."""
        return (self.failing.blank or "usual") if self.failing and self.failing.greys else "unknown"


class Head(NamedTuple):
    """Says what is found of a policy in a task, what is ``left`` to explain, and the failure rate if known."""

    name: str
    sentence: str
    rate: Probability | None = None
    evidence: str = ""
    left: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """The report of a store or corpus.

    Attributes:
        phase: what a run is doing, or how it ended; empty for a corpus.
        causes, failures: cards; failures are those without a cause.
        plots: one for all runs that differ in search and seed only.
        tables: how it was found out.
        todo: next steps, each a sentence and the command.
    """

    title: str
    source: str
    phase: str = ""
    heads: tuple[Head, ...] = ()
    causes: tuple[Card, ...] = ()
    failures: tuple[Card, ...] = ()
    plots: tuple[Plot, ...] = ()
    runs: tuple[Manifest, ...] = ()
    tables: tuple[Table, ...] = ()
    todo: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def cards(self) -> tuple[Card, ...]:
        return self.causes + self.failures
