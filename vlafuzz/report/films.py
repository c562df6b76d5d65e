"""Films of failures beside what passes, for a page."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from vlafuzz.common.text import plural
from vlafuzz.failures.causes import SOLVERS
from vlafuzz.failures.described import DescribedFailure
from vlafuzz.model import Actions, Scene
from vlafuzz.report.view import Card, Shot, View
from vlafuzz.rollouts import scene_runner
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.evaluator import Film

# Makes a film of the run's policy in a scene, or of the given actions; says why there is none if that broke.
Films = Callable[[Manifest, Scene, Actions | None], Film | str]
ShotsOf = Callable[[Card, DescribedFailure], Iterator[Shot]]
TRIED = 2  # neighbours, of which the first that passes is shown


class RunFilms:
    """Films made in the simulator, which is kept while the run stays the same, as starting it takes seconds.

    What the policy does in a scene is filmed once: many failures have the same nominal scene.

    Args:
        policy: another one than that of the runs.
        elsewhere: the stores or corpora of runs that are not in ``source``, by their keys.
    """

    def __init__(
        self, source: Path, policy: str | None = None, elsewhere: Mapping[str, Path] = MappingProxyType({})
    ) -> None:
        self._source, self._policy, self._elsewhere = source, policy, elsewhere
        self._run: Manifest | None = None
        self._runner: scene_runner.SimulatorSceneRunner | None = None
        self._made: dict[str, Film | str] = {}

    def __call__(self, run: Manifest, scene: Scene, actions: Actions | None) -> Film | str:
        if self._runner is None or run != self._run:
            self.close()
            source = self._elsewhere.get(run.key(), self._source)
            self._run, self._runner = run, scene_runner.SimulatorSceneRunner(source, run, self._policy)
        if actions is not None:
            return self._runner.film(scene, actions)
        if scene.digest not in self._made:
            self._made[scene.digest] = self._runner.film(scene, None)
        return self._made[scene.digest]

    def close(self) -> None:
        self._made.clear()
        if self._runner is not None:
            self._runner.close()
            self._runner = None


def filmed(view: View, shots_of: ShotsOf, limit: int, watch: Callable[[int, int], None]) -> View:
    """The view with films of its first ``limit`` cards, made run by run: each run needs its own simulator.

    A note says in how many the policy does not fail.
    """
    chosen = [(card, card.of) for card in view.cards if card.of][:limit]
    shots: dict[Card, list[Shot]] = {}
    for done, (card, of) in enumerate(sorted(chosen, key=lambda pair: view.runs.index(pair[1].run))):
        watch(done, len(chosen))
        shots[card] = list(shots_of(card, of))
    watch(len(chosen), len(chosen))
    causes, failures = (
        tuple(replace(card, shots=shots.get(card, ())) for card in cards) for cards in (view.causes, view.failures)
    )
    shown = [shot.film for several in shots.values() for shot in several if shot.kind == "fails" and shot.film]
    notes = list(view.notes)
    if passed := sum(not film.failed for film in shown):
        reason = "it fails in scenes that hardly differ, or is stochastic, or simulator or machine are other ones"
        notes.append(f"In {passed} of {plural(len(shown), 'film')} the policy passes: {reason}.")
    return replace(view, causes=causes, failures=failures, notes=tuple(notes))


def of_both(names: Sequence[str], films: Sequence[Films], card: Card, of: DescribedFailure) -> Iterator[Shot]:
    """What each of two policies does in the scene of a failure, and the reference solution."""
    for name, one in zip(names, films, strict=True):
        film = one(of.run, of.scene, None)
        kind = "fails" if isinstance(film, Film) and film.failed else "passes"
        yield _shot(kind, name, film)
    yield from _reference(films[0], of)


def beside(films: Films, card: Card, of: DescribedFailure) -> Iterator[Shot]:
    """What passes beside it, the failure, and the reference solution; each with a film, or why there is none."""
    neighbour = None
    for name, scene in card.neighbours[:TRIED]:
        if scene == of.scene:
            continue
        film = films(of.run, scene, None)
        passes = isinstance(film, Film) and not film.failed
        if neighbour is None or passes:
            neighbour = _shot("passes", name, film, fails="fails, too")
        if passes:
            break
    if neighbour:
        yield neighbour
    yield _shot("fails", "this scene", films(of.run, of.scene, None), passes="passes this time")
    yield from _reference(films, of)


def _reference(films: Films, of: DescribedFailure) -> Iterator[Shot]:
    if of.witness:
        solves = f"solves it ({SOLVERS[of.witness.solver]})"
        film = films(of.run, of.scene, of.witness.actions)
        yield _shot("solves", "reference", film, passes=solves, fails="fails here")


def _shot(kind: str, name: str, film: Film | str, *, passes: str = "passes", fails: str = "") -> Shot:
    """A shot with what is seen in it; ``fails`` is by default at which stage."""
    if isinstance(film, str):
        return Shot(kind, name, None, film or "the scene cannot be rolled out here")
    fails = fails or ({"": "fails", "success": "fails before success"}.get(film.lost) or f"fails at {film.lost}")
    return Shot(kind, f"{name}: {fails if film.failed else passes}", film)
