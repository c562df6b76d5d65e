"""Films of the failures and their witnesses."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from vlafuzz.common.text import plural
from vlafuzz.failures.triage import scene_runner
from vlafuzz.model.evidence import Actions
from vlafuzz.model.scene import Scene
from vlafuzz.report.view import Card, View
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.evaluation import Film

# Makes a film of the run's policy in a scene, or of the given actions; None if that raised an error.
Films = Callable[[Manifest, Scene, Actions | None], Film | None]


class RunFilms:
    """Films made in the simulator; it is kept while the run stays the same, as starting it takes seconds."""

    def __init__(self, source: Path) -> None:
        self._source = source
        self._run: Manifest | None = None
        self._runner: scene_runner.SimulatorSceneRunner | None = None

    def __call__(self, run: Manifest, scene: Scene, actions: Actions | None) -> Film | None:
        if self._runner is None or run != self._run:
            self.close()
            self._run, self._runner = run, scene_runner.SimulatorSceneRunner(self._source, run)
        return self._runner.film(scene, actions)

    def close(self) -> None:
        if self._runner is not None:
            self._runner.close()
            self._runner = None


def filmed(view: View, films: Films, limit: int, watch: Callable[[int, int], None]) -> View:
    """The view with films of its first ``limit`` cards, made run by run: each run needs its own simulator."""
    chosen = view.cards[:limit]
    order = sorted(range(len(chosen)), key=lambda index: view.runs.index(chosen[index].run))
    with_films: dict[int, Card] = {}
    for index in order:
        watch(len(with_films), len(chosen))
        with_films[index] = _filmed(chosen[index], films)
    watch(len(chosen), len(chosen))
    cards = tuple(with_films.get(index, card) for index, card in enumerate(view.cards))
    return replace(view, cards=cards, notes=(*view.notes, *_notes(cards)))


def _notes(cards: Sequence[Card]) -> Iterator[str]:
    """Notes on differences from the run that found the failures."""
    shown = [card.failure for card in cards if card.failure is not None]
    passed = sum(not film.failed for film in shown)
    if passed:
        films = plural(len(shown), "film")
        reason = "policy, simulator or machine differ from those of the run, or the policy is stochastic"
        yield f"In {passed} of {films} the policy passes: {reason}."


def _filmed(card: Card, films: Films) -> Card:
    failure = films(card.run, card.scene, None)
    solution = films(card.run, card.scene, card.witness.actions) if card.witness else None
    return replace(card, failure=failure, solution=solution)
