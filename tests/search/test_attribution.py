"""Attribution: which units a failure needs, where the policy also fails by chance."""

import math

import numpy as np

from vlafuzz.search.causes.attribution import Attribution
from vlafuzz.search.causes.background import Background
from vlafuzz.search.causes.suspects import RATE_PRIOR, Mask, Suspects

UNITS, BACKGROUND = 6, 0.4


def attributed(seed: int) -> tuple[Mask, Mask | None]:
    """The two units that a failure takes, and those that are found by tests that fail by chance in 40 %."""
    rng, background = np.random.default_rng(seed), Background()
    for number in range(20):
        background.learn(failed=number % 5 < 2)
    fault = np.zeros(UNITS, dtype=bool)
    fault[rng.choice(UNITS, 2, replace=False)] = True
    suspects = Suspects(np.full(UNITS, 0.6), RATE_PRIOR, background.chances, 0.1)
    attribution = Attribution(np.zeros(1), suspects, background, confirmed=math.log(20), quiet=False)
    while (kept := attribution.next_test(rng)) is not None:
        attribution.learn(kept, failed=not (fault & ~kept).any() or rng.random() < BACKGROUND)
    return fault, attribution.cause


def test_a_failure_is_attributed_even_if_chance_suggests_a_wrong_answer_first():
    found = [cause is not None and (cause == fault).all() for fault, cause in map(attributed, range(20))]
    assert sum(found) >= 19
