"""Certification gives up what cannot be shown, and goes back where shrinking went too far."""

from collections.abc import Sequence

import numpy as np
import pytest

from tests.failures.triage.planted import CONDITIONS, SPACE, STAGES, Planted
from vlafuzz.failures.triage.attribute import attribute
from vlafuzz.failures.triage.certify import Shrunk
from vlafuzz.failures.triage.contrast import shown
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


@pytest.mark.parametrize(("without", "difference", "at_most"), [(0.4, 0.0, 0.05), (0.8, 0.0, 0.05), (0.4, 0.1, 0.1)])
def test_scenes_that_differ_little_or_not_are_seldom_shown_to_differ(without: float, difference: float, at_most: float):
    rng, runs = np.random.default_rng(7), 200
    rejected = 0
    for _ in range(runs):
        fails = np.cumsum(rng.random(60) < without + difference)
        others = np.cumsum(rng.random(60) < without)
        rejected += any(shown(int(fails[n - 1]), int(others[n - 1]), n) for n in range(1, 61))
    assert rejected <= runs * at_most + 3 * (runs * at_most) ** 0.5


def test_a_policy_that_fails_in_82_instead_of_40_percent_is_mostly_certified():
    rng, found = np.random.default_rng(8), 0
    for _ in range(100):
        fails, others = np.cumsum(rng.random(66) < 0.82), np.cumsum(rng.random(66) < 0.4)
        found += any(shown(int(fails[n - 1]), int(others[n - 1]), n) for n in range(1, 67))
    assert found >= 70


def test_four_pairs_that_differ_certify_and_three_do_not():
    assert shown(4, 0, 4)
    assert not shown(3, 0, 3)


def test_a_policy_that_fails_two_times_in_five_anyway_can_be_certified():
    rng = np.random.default_rng(3)

    def roll(scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        return [FAILED if DARK(scene) or rng.random() < 0.4 else PASSED for scene in scenes]

    oracle, scene = Oracle(roll, STAGES, None, budget=300), Planted([DARK]).finding(0)
    usual, same = SPACE.reset(scene, ["light"]), SPACE.reset(scene, ["camera-position"])
    answers = [one.answer for one in oracle.contrasts(scene, [usual, same])]
    assert answers == [Answer.PASSES, Answer.FAILS]
