"""Confirm: are the certified causes of one world causes in another one, too, or its simulator's own?"""

from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
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
from vlafuzz.model import Conditions, Rate, Scene, Space
from vlafuzz.rollouts import scene_runner
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Judged
from vlafuzz.worlds import task_in, world_of

WORKS = 0.7  # success in nominal scenes below which failures say more about the pictures than about a cause
# Rollouts of a scene until it is told: four where no failure is by chance. A failing one takes three times as long as a
# nominal one, and about half of them fail.
EXPECTED, SLOWER = 8, 2
Verdict = Literal["holds", "does not hold", "undecided"]


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
    verdict: Verdict
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


def confirm(source: Path, world: str, watch: Watch = SILENT) -> Confirmation:
    """Roll the policy out in another world, nominally and then where it is certified to fail and beside that.

    Raises:
        StoreError: nothing is certified.
        UsageError: the other world lacks a task, robot or setting.
    """
    first = {(one.run.key(), one.signature): one for one in reversed(listing_of(source).failures)}
    causes = [one for one in reversed(first.values()) if one.bucket == "minimal" and one.counterparts]
    if not causes:
        raise StoreError(f"{source}: it has no certified cause", hint="`vlafuzz triage` certifies those of a store")
    nominal, confirmed = dict[str, Rate](), list[Confirmed]()
    for run in {one.run.key(seeded=False): one.run for one in causes}.values():
        of_run = [one for one in causes if one.run.key(seeded=False) == run.key(seeded=False)]
        with closing(scene_runner.SimulatorSceneRunner(source, elsewhere(run, world))) as runner:
            space, began = space_of(source, run), monotonic()
            oracle = _oracle(runner, space, watch)
            nominal[title_of([run])] = rate = oracle.repeated(space.nominal(), MOST)
            passed = f"{rate.rollouts - rate.failures} of {rate.rollouts}"
            watch.note(f"{title_of([run])} in {world}: solves {passed} nominal scenes")
            if solved(rate) >= WORKS:
                scenes = sum(1 + len(one.counterparts) for one in of_run)
                seconds = SLOWER * EXPECTED * scenes * (monotonic() - began) / max(oracle.spent, 1)
                watch.note(f"about {duration(seconds)}: {plural(len(of_run), 'cause')}, as fast as these")
                confirmed += [_confirmed(one, oracle, PATIENCE * oracle.lead) for one in of_run]
    return Confirmation(world, nominal, tuple(confirmed))


def solved(rate: Rate) -> float:
    """The share of rollouts that passed; 0 where none could be judged."""
    return 1 - rate.share if rate.rollouts else 0.0


def _oracle(runner: SceneRunner, space: Space, watch: Watch) -> Oracle:
    """Rolls out, in the other world, the jittered scenes of the first one's ``space``: those that certified."""

    def roll(scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        watch.progress("rollouts", oracle.spent, None)
        there = [replace(scene, task=runner.space.task.name) for scene in scenes]
        return [Judged.of(outcome) for outcome in runner.evaluate(there, numbers)]

    lead = 1 if runner.deterministic else LEAD
    oracle = Oracle(roll, runner.stages, space.jittered, budget=maxsize, lead=lead)
    return oracle


def elsewhere(conditions: Conditions, world: str) -> Conditions:
    """The conditions of a run in another world."""
    task = task_in(world, conditions.task)
    other, known = world_of(task), {setting.name for setting in world_of(task).settings}
    if conditions.robot not in other.robots:
        raise UsageError(f"{world} has no robot {conditions.robot}", hint=f"known: {', '.join(other.robots)}")
    if lacking := next((name for name in conditions.world if name not in known), None):
        problem = f"the run has {lacking}={conditions.world[lacking]}, and {world} has no such setting"
        raise UsageError(problem, hint="test the policy without it, and confirm that store")
    return replace(conditions, task=task)


def _confirmed(one: DescribedFailure, oracle: Oracle, most: int) -> Confirmed:
    tests = oracle.contrasts(one.scene, list(one.counterparts.values()), most=most)
    answers, rate = [test.answer for test in tests], oracle.certified(one.scene)
    verdict: Verdict = "holds" if set(answers) == {Answer.PASSES} else "undecided"
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
