"""Confirm: are the certified causes of one world causes in another one, too, or its simulator's own?"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from sys import maxsize
from time import monotonic
from typing import Literal

from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import StoreError, UsageError
from vlafuzz.failures.described import DescribedFailure, space_of, title_of
from vlafuzz.failures.listed import listing_of
from vlafuzz.failures.triage.certify import PATIENCE
from vlafuzz.failures.triage.oracle import LEAD, MOST, Answer, Oracle
from vlafuzz.model import Conditions, Rate, Scene, Space, Verdict
from vlafuzz.rollouts import scene_runner
from vlafuzz.rollouts.crew import crew_at
from vlafuzz.rollouts.registry import Place, default_workers
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Judged, Repeats
from vlafuzz.worlds import task_in, world_of

WORKS = 0.7  # success in nominal scenes below which failures say more about the pictures than about a cause
# Rollouts of a scene until it is told: four where no failure is by chance. A failing one takes three times as long as a
# nominal one, and about half of them fail.
EXPECTED, SLOWER = 8, 2
Standing = Literal["holds", "does not hold", "undecided"]


@dataclass(frozen=True, kw_only=True)
class Confirmed:
    """A cause in two worlds: how often the policy fails with it and, at most, without one of its operators.

    Attributes:
        found: with and without it where it was found; None if unknown. other: the same in the other world.
        scene: digest of the minimal scene.
        why: one is undecided.
    """

    cause: str
    task: str
    scene: str
    found: tuple[Rate | None, Rate | None]
    other: tuple[Rate, Rate]
    verdict: Standing
    why: str = ""


@dataclass(frozen=True)
class Confirmation:
    """The causes in another world; ``nominal``: by policy and task, how often it fails in nominal scenes there."""

    world: str
    nominal: dict[str, Rate]
    causes: tuple[Confirmed, ...]

    @property
    def unfit(self) -> str:
        """Says that the policy does not work in the other world, and on which tasks; empty where it does."""
        shares = {what: solved(rate) for what, rate in self.nominal.items()}
        low = [f"{what} solves {share:.0%}" for what, share in shares.items() if share < WORKS]
        least = f"of nominal scenes in {self.world}, fewer than {WORKS:.0%}"
        return f"{', '.join(low)} {least}: its causes are not compared" if low else ""

    @property
    def says(self) -> str:
        """The result in a sentence."""
        counts = Counter(one.verdict for one in self.causes)
        held = f"{counts['holds']} of {plural(len(self.causes), 'cause')} hold in {self.world}"
        rest = f"{counts['does not hold']} do not, {counts['undecided']} undecided"
        return "; ".join(filter(None, [f"{held}, {rest}" if self.causes else "", self.unfit]))


def confirm(source: Path, world: str, watch: Watch = SILENT, workers: int | None = None) -> Confirmation:
    """Roll the policy out in another world, nominally and then where it is certified to fail and beside that.

    Args:
        workers: processes; by default as many as `vlafuzz triage` takes. Results do not depend on it.

    Raises:
        StoreError: nothing is certified.
        UsageError: the other world lacks a task, robot or setting.
        SimulatorError: no worker stays alive.
    """
    first = {(one.run.key(), one.signature): one for one in reversed(listing_of(source).failures)}
    causes = [one for one in reversed(first.values()) if one.bucket == "minimal" and one.counterparts]
    if not causes:
        raise StoreError(f"{source}: it has no certified cause", hint="`vlafuzz triage` certifies those of a store")
    runs = {one.run.key(seeded=False): one.run for one in causes}
    place = Place(workers or min(default_workers(run.policy) for run in runs.values()))
    nominal, confirmed = dict[str, Rate](), list[Confirmed]()
    for key, run in runs.items():
        of_run = [one for one in causes if one.run.key(seeded=False) == key]
        make = partial(scene_runner.SimulatorSceneRunner, source, elsewhere(run, world))
        with crew_at(place, make, run.policy) as crew:
            there = _There(crew.runner, space_of(source, run), watch)
            began = monotonic()
            ((_, rate),) = crew.each(there.nominal, [there.space.nominal()])
            nominal[title_of([run])] = rate
            passed = f"{rate.rollouts - rate.failures} of {rate.rollouts}"
            watch.note(f"{title_of([run])} in {world}: solves {passed} nominal scenes")
            if solved(rate) < WORKS:
                continue
            scenes = sum(1 + len(one.counterparts) for one in of_run)
            seconds = SLOWER * EXPECTED * scenes * (monotonic() - began) / len(there.rolled)
            watch.note(f"about {duration(seconds)}: {plural(len(of_run), 'cause')}, as fast as these")
            answers = dict(crew.each(there.confirmed, of_run))
            confirmed += [answers[number] for number in sorted(answers)]
    return Confirmation(world, nominal, tuple(confirmed))


def solved(rate: Rate) -> float:
    """The share of rollouts that passed; 0 where none could be judged."""
    return 1 - rate.share if rate.rollouts else 0.0


@dataclass(frozen=True)
class _There:
    """Rolls out, in the other world, the jittered scenes of the first one's ``space``: those that certified.

    ``rolled``: all rollouts so far, which causes share.
    """

    runner: SceneRunner
    space: Space
    watch: Watch
    rolled: Repeats = field(default_factory=dict)

    def nominal(self, scene: Scene) -> Rate:
        return self._oracle().repeated(scene, MOST)

    def confirmed(self, one: DescribedFailure) -> Confirmed:
        oracle = self._oracle()
        tests = oracle.contrasts(one.scene, list(one.counterparts.values()), most=PATIENCE * oracle.lead)
        answers, rate = [test.answer for test in tests], oracle.certified(one.scene)
        verdict: Standing = "holds" if set(answers) == {Answer.PASSES} else "undecided"
        verdict = "does not hold" if Answer.FAILS in answers else verdict
        why = f"{plural(rate.rollouts, 'pair')} of rollouts do not tell"
        if not (rate.rollouts and all(test.rate.rollouts for test in tests)):
            why = "the scene or one without it is not fair there, or crashed"
        known = [one.counterpart_rates[name] for name in one.counterparts if name in one.counterpart_rates]
        return Confirmed(
            cause=one.title,
            task=one.run.task,
            scene=one.scene.digest,
            found=(one.rate, max(known, key=lambda rate: rate.share, default=None)),
            other=(rate, max((test.rate for test in tests), key=lambda rate: rate.share)),
            verdict=verdict,
            why=why if verdict == "undecided" else "",
        )

    def _oracle(self) -> Oracle:
        lead = 1 if self.runner.deterministic else LEAD
        return Oracle(self._roll, self.runner.stages, self.space.jittered, budget=maxsize, lead=lead)

    def _roll(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        tries = {(scene.digest, n): scene for scene, n in zip(scenes, numbers, strict=True)}
        new = [key for key in tries if key not in self.rolled]
        there = [replace(tries[key], task=self.runner.space.task.name) for key in new]
        outcomes = self.runner.evaluate(there, [number for _, number in new])
        judged = dict(zip(new, map(Judged.of, outcomes), strict=True))
        self.rolled.update({key: one for key, one in judged.items() if one.verdict is not Verdict.ERROR})
        self.watch.progress("rollouts", len(self.rolled), None)
        return [self.rolled.get(key) or judged[key] for key in tries]


def elsewhere(conditions: Conditions, world: str) -> Conditions:
    """The conditions of a run in another world."""
    task = task_in(world, conditions.task)
    other, known = world_of(task), {setting.name for setting in world_of(task).settings}
    pictures = {setting.name for setting in world_of(conditions.task).settings if setting.served} - known
    if conditions.robot not in other.robots:
        raise UsageError(f"{world} has no robot {conditions.robot}", hint=f"known: {', '.join(other.robots)}")
    values = {name: value for name, value in conditions.world.items() if name not in pictures}  # it has one quality
    if lacking := next((name for name in values if name not in known), None):
        problem = f"the run has {lacking}={conditions.world[lacking]}, and {world} has no such setting"
        raise UsageError(problem, hint="test the policy without it, and confirm that store")
    return replace(conditions, task=task, world=values)
