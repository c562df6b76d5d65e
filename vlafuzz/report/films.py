"""Films of failures and their witnesses, for a page."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from vlafuzz.common.text import plural
from vlafuzz.model.evidence import Actions
from vlafuzz.model.scene import Scene
from vlafuzz.report.view import View
from vlafuzz.rollouts import scene_runner
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.evaluator import Film

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
    """The view with films of its first ``limit`` cards, made run by run: each run needs its own simulator.

    A note says in how many the policy does not fail.
    """
    cards, most = list(view.cards), min(limit, len(view.cards))
    for done, index in enumerate(sorted(range(most), key=lambda index: view.runs.index(cards[index].of.run))):
        watch(done, most)
        of = cards[index].of
        failure = films(of.run, of.scene, None)
        solution = films(of.run, of.scene, of.witness.actions) if of.witness else None
        cards[index] = replace(cards[index], failure=failure, solution=solution)
    watch(most, most)
    shown, notes = [card.failure for card in cards if card.failure is not None], list(view.notes)
    if passed := sum(not film.failed for film in shown):
        reason = "policy, simulator or machine differ from those of the run, or the policy is stochastic"
        notes.append(f"In {passed} of {plural(len(shown), 'film')} the policy passes: {reason}.")
    return replace(view, cards=tuple(cards), notes=tuple(notes))
