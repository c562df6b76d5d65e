"""Against exact intervals, in worlds whose failure probability is known, and with bad input."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import beta

from vlafuzz.common.statistics import wilson
from vlafuzz.search.probability import Draw, failure_probability


def plain(outcomes: list[bool]) -> list[Draw]:
    return [Draw(failed=failed, left=len(outcomes) - number) for number, failed in enumerate(outcomes)]


def guided(rng: np.random.Generator, *, inside: float, budget: int) -> list[Draw]:
    """A third of scenes is predicted to fail, and fails with probability ``inside``; others with 0.05.

    A failure costs a second rollout.
    """
    draws, left = list[Draw](), budget
    while left > 0:
        predicted = rng.random() < 1 / 3
        failed = bool(rng.random() < (inside if predicted else 0.05))
        draws.append(Draw(failed=failed, left=left, prediction=float(predicted), mean_prediction=1 / 3))
        left -= 1 + failed
    return draws


@st.composite
def searches(draw: st.DrawFn) -> list[Draw]:
    """Any outcomes and predictions, also such as no search would have."""
    fraction = st.floats(0, 1)
    return [
        Draw(failed=draw(st.booleans()), left=left, prediction=draw(fraction), mean_prediction=draw(fraction))
        for left in range(draw(st.integers(1, 20)), 0, -1)
    ]


def test_nothing_is_known_without_draws():
    assert failure_probability([])[1:] == (0, 1)


@pytest.mark.parametrize("number", [50, 300, 1200])
def test_without_failures_the_upper_bound_is_about_three_and_a_half_in_all_draws(number: int):
    value, low, high = failure_probability(plain([False] * number))
    assert (value, low) == (0, 0)
    assert 3.0 < number * high < 3.7


def test_if_all_scenes_fail_the_interval_mirrors_that_of_none():
    value, low, high = failure_probability(plain([True] * 300))
    assert (value, high) == (1, 1)
    assert 3.0 < 300 * (1 - low) < 3.7


@pytest.mark.parametrize("failures", [5, 20, 90, 150])
def test_at_the_end_of_the_budget_it_is_about_as_narrow_as_the_exact_interval(failures: int):
    outcomes = np.random.default_rng(failures).permutation(300) < failures
    value, low, high = failure_probability(plain(outcomes.tolist()))
    exact = beta.ppf(0.975, failures + 1, 300 - failures) - beta.ppf(0.025, failures, 301 - failures)
    assert value == pytest.approx(failures / 300)
    assert high - low < 1.2 * exact


@pytest.mark.parametrize("inside", [1.0, 0.95, 0.7, 0.2])
def test_the_interval_covers_whether_predictions_are_right_or_wrong(inside: float):
    truth = inside / 3 + 0.05 * 2 / 3
    runs = [guided(np.random.default_rng([3, seed]), inside=inside, budget=60) for seed in range(60)]
    estimates = [failure_probability(run) for run in runs]
    assert sum(low <= truth <= high for _, low, high in estimates) >= 53  # 0.1 % of runs at 95 %
    assert np.mean([value for value, *_ in estimates]) == pytest.approx(truth, abs=0.04)


def test_good_predictions_make_it_narrower_than_plain_random_rollouts():
    run = guided(np.random.default_rng(1), inside=1.0, budget=300)
    estimate, random = failure_probability(run), wilson(110, 300)
    assert len(run) < 230
    assert estimate.high - estimate.low < 0.9 * (random.high - random.low)


def test_a_larger_budget_than_planned_narrows_the_interval_further_if_slowly():
    outcomes = (np.random.default_rng(0).random(600) < 0.2).tolist()
    first = plain(outcomes[:200])
    low, high = failure_probability(first)[1:]
    more = failure_probability(first + plain(outcomes[200:]))
    assert more.high - more.low < 0.95 * (high - low)


@settings(max_examples=20, deadline=None)
@given(searches())
def test_the_interval_is_within_0_and_1_holds_the_estimate_and_only_shrinks(draws: list[Draw]):
    before = failure_probability([])
    for number in range(1, len(draws) + 1, 4):
        value, low, high = failure_probability(draws[:number])
        assert 0 <= before.low <= low <= value <= high <= before.high <= 1
        before = failure_probability(draws[:number])


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("left", 0, "left: expected 1 to inf, got 0"),
        ("prediction", -0.1, "prediction: expected 0 to 1, got -0.1"),
        ("mean_prediction", 1.1, "mean_prediction: expected 0 to 1, got 1.1"),
    ],
)
def test_a_draw_that_cannot_be_is_refused(field: str, value: float, message: str):
    with pytest.raises(ValueError, match=message):
        replace(Draw(failed=True, left=1), **{field: value})
