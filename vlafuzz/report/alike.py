"""Alike findings: those that were not triaged and look like another one share its card."""

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vlafuzz.model.space import Space
from vlafuzz.report.cards import Spaces
from vlafuzz.report.view import Card, Deviation

NEAR = 0.1  # distance of embeddings: a scene of which every gene is nudged by 2 % of its range is nearer


def alike_as_one(cards: Sequence[Card], spaces: Spaces, causes: Collection[tuple[str, str]]) -> list[Card]:
    """One card for scenes that hardly differ, and one for a failure and those that only add operators to it.

    Triaged findings and those that show a cause keep cards of their own. Scenes of different search spaces, such as
    those of two tasks, are never alike.

    Args:
        causes: keys of the findings that show one, see ``Finding.key``.
    """
    observed = [card for card in cards if not _is_triaged(card)]
    observed.sort(key=lambda card: (card.key not in causes, len(card.deviations)))
    shown = defaultdict[tuple[Space, str, str], list[_Shown]](list)
    for card in observed:
        space = spaces.of(card.run)
        here = shown[space, card.run.key(), card.lost_stage]
        one = _Shown(card, frozenset(card.deviations), space.embed(card.scene))
        same = (other for other in here if other.shows(one))
        if card.key in causes or (other := next(same, None)) is None:
            here.append(one)
        else:
            other.alike.append(card.scene.digest)
    alike = {one.card: tuple(one.alike) for some in shown.values() for one in some}
    return [replace(card, alike=alike.get(card, ())) for card in cards if card in alike or _is_triaged(card)]


def _is_triaged(card: Card) -> bool:
    return card.bucket != "observed"


@dataclass(frozen=True)
class _Shown:
    card: Card
    deviations: frozenset[Deviation]
    point: NDArray[np.float64]
    alike: list[str] = field(default_factory=list)

    def shows(self, other: "_Shown") -> bool:
        """Whether its card shows the failure of another one, too."""
        if self.card.operators == other.card.operators:
            return bool(np.linalg.norm(self.point - other.point) <= NEAR)
        return bool(self.deviations) and self.deviations < other.deviations
