"""Certification gives up what cannot be shown, and goes back where shrinking went too far."""

from collections.abc import Sequence

import numpy as np
import pytest

from tests.failures.triage.planted import CONDITIONS, SPACE, STAGES, Planted
from vlafuzz.failures.triage.attribute import attribute
from vlafuzz.failures.triage.certify import Shrunk
from vlafuzz.failures.triage.contrast import EFFECT, LEVEL, evidence
from vlafuzz.failures.triage.oracle import Answer, Oracle
from vlafuzz.model.evidence import Rate
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.store.records import Judged

DARK, TILTED = CONDITIONS["light"][0], CONDITIONS["camera-orientation"][0]
FAILED, PASSED = Judged(Verdict.FAILED, "grasp", 1), Judged(Verdict.PASSED, None, 1)


def oracle_of(fails: Sequence[bool]) -> Oracle:
    """Rollouts end in this order, again and again."""

    def roll(scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        return [FAILED if fails[number % len(fails)] else PASSED for number in numbers]

    return Oracle(roll, STAGES, None, budget=1000, lead=1)


class Lucky(Planted):
    """In the light, the first two rollouts that shrink a scene fail, too."""

    def __call__(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        judged = super().__call__(scenes, numbers)
        return [
            FAILED if number < 2 and one.verdict is Verdict.PASSED and TILTED(scene) else one
            for scene, number, one in zip(scenes, numbers, judged, strict=True)
        ]


def test_what_was_reset_by_luck_comes_back():
    policy = Lucky([DARK, TILTED])
    shrunk = policy.shrunk(policy.finding(0))
    assert (shrunk.operators, shrunk.minimal) == (("light", "camera-orientation"), True)
    assert shrunk.rate.rollouts == shrunk.rate.failures >= 4


def test_thresholds_are_located_for_minimal_scenes_alone():
    policy = Planted([DARK])
    oracle, scene = policy.oracle(), policy.finding(0)
    kept = Shrunk(scene=scene, lost="grasp", operators=("light",), rate=Rate.of_counts(5, 5), firm=True)
    unresolved = Shrunk(**vars(kept) | {"unresolved": {"light": "fails at times"}})
    assert [len(attribute(shrunk, oracle, SPACE).thresholds) for shrunk in (kept, unresolved)] == [1, 0]


@pytest.mark.parametrize("without", [0.0, 0.3, 0.7])
def test_a_difference_of_exactly_the_least_effect_is_certified_in_at_most_one_of_twenty(without: float):
    rng = np.random.default_rng(7)
    rejected = 0
    for _ in range(300):
        fails = np.cumsum(rng.random(60) < without + EFFECT)
        others = np.cumsum(rng.random(60) < without)
        pairs = range(1, 61)
        rejected += any(evidence(int(fails[n - 1]), int(others[n - 1]), n) >= LEVEL for n in pairs)
    assert rejected <= 300 * 0.05 + 11  # three standard deviations


def test_four_pairs_that_differ_certify_and_three_do_not():
    assert evidence(3, 0, 3) < LEVEL <= evidence(4, 0, 4)


def test_a_policy_that_fails_two_times_in_five_anyway_can_be_certified():
    rng = np.random.default_rng(3)

    def roll(scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        return [FAILED if DARK(scene) or rng.random() < 0.4 else PASSED for scene in scenes]

    oracle, scene = Oracle(roll, STAGES, None, budget=300), Planted([DARK]).finding(0)
    usual, same = SPACE.reset(scene, ["light"]), SPACE.reset(scene, ["camera-position"])
    answers = [one.answer for one in oracle.contrasts(scene, [usual, same])]
    assert answers == [Answer.PASSES, Answer.FAILS]
