"""Films: what happens in a scene, to look at."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Protocol

from vlafuzz.evidence import Actions
from vlafuzz.report.view import Card, View
from vlafuzz.report.words import plural
from vlafuzz.scene import Scene
from vlafuzz.sim.base import Film
from vlafuzz.store.records import Manifest


class Films(Protocol):
    """Makes films."""

    def __call__(self, run: Manifest, scene: Scene, actions: Actions | None) -> Film | None:
        """What the run's policy does in a scene, or what given actions do; None where that broke."""


def filmed(view: View, films: Films, limit: int, watch: Callable[[int, int], None]) -> View:
    """The view with films of its first ``limit`` cards; run by run, as what makes them changes with it.

    Args:
        watch: hears how many of how many cards are done.
    """
    chosen = view.cards[:limit]
    order = sorted(range(len(chosen)), key=lambda index: view.runs.index(chosen[index].run))
    made: dict[int, Card] = {}
    for index in order:
        watch(len(made), len(chosen))
        made[index] = _filmed(chosen[index], films)
    watch(len(chosen), len(chosen))
    cards = tuple(made.get(index, card) for index, card in enumerate(view.cards))
    return replace(view, cards=cards, notes=(*view.notes, *_notes(cards)))


def _notes(cards: Sequence[Card]) -> Iterator[str]:
    """What is not as it was when the failures were found."""
    shown = [card.failure for card in cards if card.failure is not None]
    passed = sum(not film.failed for film in shown)
    if passed:
        films = plural(len(shown), "film")
        told = "policy, simulator or machine differ from those of the run, or the policy is stochastic"
        yield f"In {passed} of {films} the policy passes: {told}."


def _filmed(card: Card, films: Films) -> Card:
    failure = films(card.run, card.scene, None)
    solution = films(card.run, card.scene, card.witness) if card.witness is not None else None
    return replace(card, failure=failure, solution=solution)
