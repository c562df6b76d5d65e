"""Films of failures and their witnesses, for a page that is written, and for one that follows a run."""

import threading
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from vlafuzz.common.text import plural
from vlafuzz.failures.triage import scene_runner
from vlafuzz.model.evidence import Actions
from vlafuzz.model.scene import Scene
from vlafuzz.report.view import View
from vlafuzz.store.records import Manifest, Trial
from vlafuzz.worlds import no_pictures
from vlafuzz.worlds.evaluation import Film

# Makes a film of the run's policy in a scene, or of the given actions; None if that raised an error.
Films = Callable[[Manifest, Scene, Actions | None], Film | None]
PAUSE = 20.0  # seconds between films of a run that goes on, as they take time from it


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


class NewestFilm:
    """The film of the newest failure by its stored actions, made in a thread: the policy is not asked."""

    def __init__(self, store: Path) -> None:
        self._store = store
        self._made: tuple[Trial, Film] | None = None
        self._thread: threading.Thread | None = None
        self._next = 0.0

    def of(self, newest: Trial | None, run: Manifest) -> tuple[Trial, Film] | None:
        """The last failure that was filmed, if any; the newest one is begun to be filmed."""
        busy = self._thread is not None and self._thread.is_alive()
        known = self._made is not None and self._made[0] is newest
        if newest is not None and not busy and not known and time.monotonic() >= self._next:
            self._thread = threading.Thread(target=self._make, args=(newest, run), daemon=True)
            self._thread.start()
        return self._made

    def _make(self, trial: Trial, run: Manifest) -> None:
        actions = trial.outcome.rollouts[-1].actions if trial.outcome.rollouts else None
        try:
            if actions is not None and not no_pictures(run.task):
                with closing(scene_runner.SimulatorSceneRunner(self._store, run, "expert")) as runner:
                    film = runner.film(trial.scene, actions)
                self._made = (trial, film) if film else self._made
        finally:
            self._next = time.monotonic() + PAUSE
