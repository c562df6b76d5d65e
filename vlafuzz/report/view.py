"""Pages as values, without HTML."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import interval
from vlafuzz.failures.causes import CauseList
from vlafuzz.failures.described import DescribedFailure
from vlafuzz.model.evidence import Solver
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.evaluator import Film

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
class Table:
    """Rows with the same keys, which are the column heads; the first column names the row."""

    title: str
    rows: Sequence[Mapping[str, object]]
    says: str = ""

    @property
    def columns(self) -> Mapping[str, bool]:
        """Column heads, and whether the column holds numbers."""
        numbers = tuple("–0123456789")
        return {head: all(str(row[head]).startswith(numbers) for row in self.rows) for head in self.rows[0]}


def cause_table(found: CauseList) -> Table:
    """The causes of a run; the share is left out where none is known."""
    rows = [cause.row() for cause in found.causes]
    if not any(cause.share for cause in found.causes):
        rows = [{head: value for head, value in row.items() if head != "share"} for row in rows]
    says = "; ".join(found.sentences)
    return Table(found.title, rows, f"{says[0].upper()}{says[1:]}.")


@dataclass(frozen=True, eq=False)
class Card:
    """A failure in the gallery, with films of the policy and of the witness."""

    of: DescribedFailure
    failure: Film | None = None
    solution: Film | None = None

    def role(self, operator: str) -> str:
        """Whether an operator is necessary or sufficient for the failure, in words."""
        causes = self.of.causes
        roles = {"necessary": causes.necessary, "sufficient alone": causes.sufficient}
        return ", ".join(role for role, operators in roles.items() if operator in operators)

    def without(self, operator: str) -> str:
        """How often the policy fails without an operator, in words; empty if unknown."""
        rate = self.of.counterpart_rates.get(operator)
        if rate is None:
            return ""
        counts = f"{rate.failures} of {rate.rollouts} rollouts fail"
        return f"without it {counts} ({interval(rate.low, rate.high)})"


@dataclass(frozen=True)
class Picture:
    """A PNG; ``says`` is the alternative text."""

    title: str
    png: bytes
    says: str


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """A page: a report, or a sheet of conclusions, pictures and tables, as of a comparison.

    Attributes:
        source: the store or folder.
        headline: the result in a sentence.
        todo: next steps, each a sentence and the command.
        notes: caveats, in sentences.
    """

    title: str
    source: str
    headline: str
    facts: tuple[tuple[str, str], ...] = ()
    todo: tuple[tuple[str, str], ...] = ()
    runs: tuple[Manifest, ...] = ()
    run_table: Table | None = None
    charts: tuple[Chart, ...] = ()
    cards: tuple[Card, ...] = ()
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()
    conclusions: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()

    @property
    def filmed(self) -> bool:
        return any(card.failure or card.solution for card in self.cards)

    @property
    def solved(self) -> bool:
        """Whether there is a film of a witness."""
        return any(card.solution for card in self.cards)

    @property
    def filters(self) -> dict[tuple[str, str], list[str]]:
        """The choices of each filter of the gallery, by its key and name."""
        shown = [card.of for card in self.cards]
        return {
            ("task", "Task"): sorted({one.scene.task for one in shown}),
            ("stage", "Lost stage"): sorted({one.lost_stage for one in shown}),
            ("operator", "Operator"): sorted({name for one in shown for name in one.operators}),
            ("evidence", "Evidence"): sorted({one.bucket for one in shown}),
        }
