"""The report as values, without HTML."""

from dataclasses import dataclass

from vlafuzz.failures.causes import ListedCause
from vlafuzz.failures.described import DescribedFailure
from vlafuzz.model.scene import Scene
from vlafuzz.report.plots import Band, Plot
from vlafuzz.report.sheet import Table
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.evaluator import Film


@dataclass(frozen=True)
class Strip:
    """An operator's axis with what fails on it; places are shares of the axis, in [0, 1].

    Attributes:
        name: of the quantity; ``low`` and ``high``: the ends of its range, with units.
        nominal: where the nominal value is.
        fails: the ranges that fail.
        here: the value in the scene.
        says: the same in words.
    """

    name: str
    low: str
    high: str
    nominal: float
    fails: tuple[tuple[float, float], ...]
    here: float
    says: str


@dataclass(frozen=True)
class Number:
    """A number of a card, and what it means."""

    value: str
    says: str


@dataclass(frozen=True, eq=False)
class Shot:
    """A film of a card; ``kind`` is ``passes``, ``fails`` or ``solves``."""

    kind: str
    says: str
    film: Film


@dataclass(frozen=True, eq=False, kw_only=True)
class Card:
    """A cause with a scene that shows it, or a failure without a cause.

    Attributes:
        id: anchor in the page.
        title: what it takes, as a title.
        of: the failure; None for a cause that no stored failure shows.
        cause: None for a failure of no cause.
        badge: how well it is shown, and what that means.
        step: what to do next, and the command.
        neighbours: scenes in which the policy should pass, the likeliest first, with their names.
        plot: the scenes among which it is; ``bands``: what fails there.
    """

    id: str
    title: str
    of: DescribedFailure | None
    cause: ListedCause | None = None
    badge: tuple[str, str]
    numbers: tuple[Number, ...] = ()
    strips: tuple[Strip, ...] = ()
    step: tuple[str, str] | None = None
    neighbours: tuple[tuple[str, Scene], ...] = ()
    shots: tuple[Shot, ...] = ()
    plot: Plot | None = None
    bands: tuple[Band, ...] = ()


@dataclass(frozen=True)
class Head:
    """What is found of a policy in a task, in a sentence, with its failure rate in random scenes if that is known."""

    name: str
    sentence: str
    rate: Probability | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """The report of a store or corpus.

    Attributes:
        source: the store or folder.
        phase: what a run is doing, or how it ended; empty for a corpus.
        cards: those of causes first.
        plots: one for all runs that differ in search and seed only.
        facts, tables: how it was found out.
        todo: next steps, each a sentence and the command.
        notes: caveats, in sentences.
    """

    title: str
    source: str
    phase: str = ""
    heads: tuple[Head, ...] = ()
    cards: tuple[Card, ...] = ()
    plots: tuple[Plot, ...] = ()
    runs: tuple[Manifest, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    tables: tuple[Table, ...] = ()
    todo: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def causes(self) -> tuple[Card, ...]:
        return tuple(card for card in self.cards if card.id.startswith("cause"))

    @property
    def failures(self) -> tuple[Card, ...]:
        """The cards of failures without a cause."""
        return self.cards[len(self.causes) :]

    @property
    def filters(self) -> dict[tuple[str, str], list[str]]:
        """The choices of each filter of the gallery, by its key and name."""
        shown = [card.of for card in self.failures if card.of]
        choices = {
            ("task", "Task"): {one.scene.task for one in shown},
            ("stage", "Fails at"): {one.lost_stage for one in shown},
            ("operator", "Changed"): {name for one in shown for name in one.operators},
        }
        return {key: sorted(values) for key, values in choices.items() if len(values) > 1}
