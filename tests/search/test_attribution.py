"""Attribution: which units a failure needs, where the policy also fails by chance."""

import math

import numpy as np

from vlafuzz.search.causes.attribution import Attribution
from vlafuzz.search.causes.background import Background
from vlafuzz.search.causes.suspects import RATE_PRIOR, Ended, Suspects

UNITS, BACKGROUND = 6, 0.4


def attributed(seed: int, usual: float = 1.0) -> tuple[bool, float]:
    """Whether the two units that a failure takes are found, by tests that fail by chance in 40 %; and their number.

    ``usual``: share of the failures by chance that lose the same stage as the fault.
    """
    rng, background = np.random.default_rng(seed), Background()
    for number in range(20):
        background.learn(failed=number % 5 < 2)
    fault = np.zeros(UNITS, dtype=bool)
    fault[rng.choice(UNITS, 2, replace=False)] = True
    suspects = Suspects(np.full(UNITS, 0.6), RATE_PRIOR, background.chances, 0.1, usual)
    attribution = Attribution(np.zeros(1), suspects, background, confirmed=math.log(20), answer=None)
    while (kept := attribution.next_test(rng)) is not None:
        by_chance = Ended.THERE if rng.random() < usual else Ended.ELSEWHERE
        otherwise = by_chance if rng.random() < BACKGROUND else Ended.PASSED
        attribution.learn(kept, otherwise if (fault & ~kept).any() else Ended.THERE)
    return attribution.cause is not None and bool((attribution.cause == fault).all()), suspects.tests


def test_a_failure_is_attributed_even_if_chance_suggests_a_wrong_answer_first():
    assert sum(found for found, _ in map(attributed, range(20))) >= 19


def test_a_failure_that_loses_an_unusual_stage_takes_fewer_tests():
    at_any, at_its_own = ([attributed(seed, usual) for seed in range(20)] for usual in (1.0, 0.1))
    assert sum(found for found, _ in at_its_own) >= 19
    assert sum(tests for _, tests in at_its_own) < 0.8 * sum(tests for _, tests in at_any)


def test_a_stage_that_chance_seldom_loses_speaks_against_chance():
    background = Background()
    background.lost.update(grasp=9, lift=1)
    (usual, often), (unusual, seldom) = background.usual("grasp", 0.5), background.usual("lift", 0.5)
    assert usual > 0.8
    assert often > 0.6
    assert unusual < 0.2
    assert seldom < 0.3
