"""Against exact intervals, in worlds whose failure probability is known, and with bad input."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from vlafuzz.common.statistics import wilson
from vlafuzz.search.probability import Draw, Rates, failure_probability

SHARE = 1 / 3  # of scenes that a known cause explains


def plain(outcomes: list[bool]) -> list[Draw]:
    return [Draw(scene=number, failed=failed) for number, failed in enumerate(outcomes)]


def guided(rng: np.random.Generator, *, inside: float, elsewhere: float = 0.05, rollouts: int = 60) -> list[Draw]:
    """Scenes fail with probability ``inside`` where a cause explains that, and not all of these are rolled out."""
    draws, rates = list[Draw](), Rates()
    while rollouts:
        explained = bool(rng.random() < SHARE)
        predicted = {"prediction": rates.predict(explained), "mean_prediction": rates.predict(SHARE)}
        draw = Draw(scene=len(draws), chance=rates.chance(explained=explained), **predicted)
        if rng.random() < draw.chance:
            failed, rollouts = bool(rng.random() < (inside if explained else elsewhere)), rollouts - 1
            rates.learn(explained=explained, failed=failed)
            draw = replace(draw, failed=failed)
        draws.append(draw)
    return draws


# Any outcomes, predictions and chances, also such as no search would have.
OUTCOMES = {"scene": st.integers(0, 5), "chance": st.floats(0.05, 1), "failed": st.sampled_from([None, False, True])}
PREDICTIONS = {"prediction": st.floats(0, 1), "mean_prediction": st.floats(0, 1), "error": st.floats(0, 0.1)}
SEARCHES = st.lists(st.builds(Draw, **OUTCOMES, **PREDICTIONS), min_size=1, max_size=20)


def test_nothing_is_known_without_draws():
    assert failure_probability([], over=True)[1:] == failure_probability([], over=False)[1:] == (0, 1)


@pytest.mark.parametrize("failures", [0, 5, 150, 300])
def test_without_predictions_it_is_wilsons_interval_at_the_end(failures: int):
    outcomes = [number < failures for number in range(300)]
    assert failure_probability(plain(outcomes), over=True) == pytest.approx((failures / 300, *wilson(failures, 300)))


@pytest.mark.parametrize("inside", [1.0, 0.95, 0.7, 0.2])
def test_the_interval_covers_whether_predictions_are_right_or_wrong(inside: float):
    truth = inside * SHARE + 0.05 * (1 - SHARE)
    runs = [guided(np.random.default_rng([3, seed]), inside=inside) for seed in range(200)]
    estimates = [failure_probability(run, over=True) for run in runs]
    assert sum(low <= truth <= high for _, low, high in estimates) >= 180  # 0.2 % of runs at 95 %
    assert np.mean([value for value, *_ in estimates]) == pytest.approx(truth, abs=0.02)


@pytest.mark.parametrize("rate", [0.5, 0.05])
def test_before_the_end_the_interval_covers_at_all_times_at_once(rate: float):
    covered = 0
    for seed in range(20):
        draws = plain((np.random.default_rng([4, seed]).random(200) < rate).tolist())
        intervals = [failure_probability(draws[:number], over=False)[1:] for number in range(1, 201, 3)]
        covered += all(low <= rate <= high for low, high in intervals)
    assert covered >= 17  # 1.6 % of runs at 95 %


def test_good_predictions_make_it_narrower_than_that_of_as_many_plain_rollouts():
    estimate = failure_probability(guided(np.random.default_rng(1), inside=1.0, rollouts=300), over=True)
    random = wilson(300 * (SHARE + 0.05 * (1 - SHARE)), 300)
    assert estimate.high - estimate.low < 0.7 * (random.high - random.low)


def test_fewer_scenes_are_rolled_out_where_their_outcome_is_nearly_sure():
    rates = Rates()
    for number in range(100):
        rates.learn(explained=True, failed=True)
        rates.learn(explained=False, failed=number % 2 == 0)
    assert (rates.chance(explained=False), rates.chance(explained=True)) == (1, 0.25)


def test_a_scene_that_is_drawn_again_and_again_tells_its_outcome_once():
    few = [Draw(scene=number % 20, failed=number % 20 < 8) for number in range(400)]
    estimate, once = failure_probability(few, over=True), wilson(8, 20)
    assert estimate.value == 0.4
    assert estimate.high - estimate.low == pytest.approx(once.high - once.low, rel=0.1)


@settings(max_examples=50, deadline=None)
@given(SEARCHES, st.booleans())
def test_the_interval_is_within_0_and_1_and_holds_the_estimate(draws: list[Draw], over: bool):
    value, low, high = failure_probability(draws, over=over)
    assert 0 <= low <= value <= high <= 1


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("chance", 0, "chance: expected more than 0"),
        ("chance", 1.5, "chance: expected 0 to 1, got 1.5"),
        ("prediction", -0.1, "prediction: expected 0 to 1, got -0.1"),
        ("mean_prediction", 1.1, "mean_prediction: expected 0 to 1, got 1.1"),
    ],
)
def test_a_draw_that_cannot_be_is_refused(field: str, value: float, message: str):
    with pytest.raises(ValueError, match=message):
        replace(Draw(scene=0, failed=True), **{field: value})
