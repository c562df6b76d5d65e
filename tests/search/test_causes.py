"""What the strategy `causes` finds in policies that fail for known reasons."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.search.worlds import CATALOGUE, space
from vlafuzz.common.statistics import wilson
from vlafuzz.model import Scene, Verdict
from vlafuzz.search.base import Cause, Proposal
from vlafuzz.search.causes.rules import Rule, Rules
from vlafuzz.search.causes.strategy import Causes
from vlafuzz.search.causes.units import Units
from vlafuzz.search.scoring import Score
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

PASSED = Score(Verdict.PASSED, 1.0, 1.0, slack=0.5)
FAILED = Score(Verdict.FAILED, 0.3, 1.0, cell="grasp|base|x0y0")

Fails = Callable[[Scene], bool]


def played(fails: Fails, budget=150, seed=0, rate=1.0, where=None, like: Sequence[Cause] = ()) -> Causes:
    """The strategy after a run against a policy that fails at a rate where it ``fails``."""
    where = where or space()
    strategy, rng = Causes(where, seed, budget, like=like), np.random.default_rng(seed)
    outstanding: deque[Proposal] = deque()
    for number in range(budget + strategy.outstanding):
        if number < budget:
            outstanding += strategy.ask(1)
        if number >= strategy.outstanding:
            proposal = outstanding.popleft()
            failing = fails(where.decode(proposal.genome)) and rng.random() < rate
            strategy.tell([proposal], [FAILED if failing else PASSED])
    return strategy


def dark(scene: Scene) -> bool:
    return scene.light.intensity < 0.25


def turned_left_and_far(scene: Scene) -> bool:
    return scene.camera.yaw > 2 and scene.camera.distance > 0.02


def operators(strategy: Causes) -> set[tuple[str, ...]]:
    return {cause.operators for cause in strategy.causes()}


def test_a_cause_of_one_operator_is_found_once_and_its_smallest_scene_has_nothing_else_in_it():
    (cause,) = played(dark).causes()
    assert (cause.operators, cause.failures > 3) == (("light",), True)
    scene = space().decode(cause.genome)
    assert dark(scene)
    deviating = {name for name, severity in space().severities(scene).items() if severity > 0.02}
    assert deviating == {"light"}


def test_two_causes_are_told_apart_and_both_conditions_of_one_are_kept():
    found = operators(played(lambda scene: dark(scene) or turned_left_and_far(scene), 200))
    assert found == {("light",), ("camera-position", "camera-orientation")}


def test_a_cause_comes_with_its_tests_since_it_was_suspected():
    for cause in played(lambda scene: dark(scene) or turned_left_and_far(scene), 200).causes():
        assert cause.tests.keys() == {"", *cause.operators}
        assert all(cause.tests[""])
        assert not any(failed for name in cause.operators for failed in cause.tests[name])
        assert 1 <= len(cause.tests[""]) < 10


def test_tests_against_another_reference_than_nominal_are_none_of_a_cause():
    causes = played(lambda scene: not 0.3 < scene.light.intensity < 0.8, 200).causes()
    assert causes
    assert not any(cause.tests for cause in causes)


def test_a_policy_that_fails_seven_times_of_ten_has_the_same_cause():
    assert ("light",) in operators(played(dark, 200, rate=0.7))


def crowded(scene: Scene) -> bool:
    target = scene.targets[0]
    return any(np.hypot(other.x - target.x, other.y - target.y) < 0.18 for other in scene.confounders)


@pytest.mark.parametrize(
    "vary",
    [
        ("confounder-count", "confounder-position", "light"),  # the target stays where it is
        ("confounder-count", "light"),
        ("confounder-count", "light", "target-position"),  # the confounders stay where they are
    ],
    ids=" ".join,
)
def test_some_operators_only_are_enough(vary: tuple[str, ...]):
    found = operators(played(lambda scene: dark(scene) or crowded(scene), 200, where=space("pick-up", *vary)))
    assert ("light",) in found
    assert {name for names in found for name in names} <= {*vary, "confounders"}


@pytest.mark.parametrize("count", ["{low: 2, high: 2, nominal: 2}", "{low: 1, high: 3, nominal: 1}"])
def test_there_may_always_be_confounders_in_ranges_of_their_own(count: str, tmp_path: Path):
    (tmp_path / "own.yaml").write_text(
        "extends: tabletop\n"
        "vary: [light, target-position, confounder-position, confounder-count]\n"
        "operators:\n"
        "  confounder-position:\n"
        "    x: {low: -0.18, high: 0.08, step: 0.02}\n"
        "    y: {low: -0.2, high: 0.1, step: 0.02}\n"
        "    nominal: [[0.08, -0.20], [-0.18, -0.20], [0.08, 0.1], [-0.18, 0.1]]\n"
        f"  confounder-count: {count}\n"
    )
    own = SearchSpace(load_operators(tmp_path / "own.yaml"), CATALOGUE, "pick-up")
    assert operators(played(dark, 120, where=own)) == {("light",)}


def test_a_cause_that_takes_less_replaces_one_that_chance_has_left_more_in():
    units = Units(space("pick-up", "light", "target-position").genes)
    light, place = ([unit.operator for unit in units.units].index(name) for name in ("light", "target-position"))
    rules = Rules()
    for several in ([place, light], [light]):
        levels, kept = units.reference.copy(), np.zeros(len(units.units), dtype=bool)
        for index in several:
            levels[list(units.units[index].indices)] = 0
            kept[index] = True
        deviations = units.deviations(levels[None])[0]
        added = rules.add(Rule.of(kept, levels, deviations, units, {}), deviations, units)
    assert (list(rules), added.kept.sum(), added.hits) == ([added], 1, 2)


def test_where_nothing_varies_nothing_is_a_cause():
    nothing = SearchSpace(load_operators().only(()), CATALOGUE, "pick-up")
    assert operators(played(lambda _: True, 20, where=nothing)) == set()


def test_every_cause_of_a_policy_that_confounders_disturb_has_confounders():
    assert (found := operators(played(crowded, 200)))
    assert all("confounders" in cause for cause in found)


def test_known_causes_are_avoided():
    drawn = []

    def fails(scene: Scene) -> bool:
        drawn.append(scene.light.intensity < 1)
        return drawn[-1]

    played(fails, 200)
    assert np.mean(drawn[:40]) > np.mean(drawn[-80:])


@pytest.mark.parametrize("seed", range(2))
def test_a_cause_at_the_ends_of_two_ranges_is_found_though_few_random_scenes_show_it(seed: int):
    def fails(scene: Scene) -> bool:
        return scene.camera.yaw > 4.4 and scene.light.intensity < 0.12

    rng = np.random.default_rng(99)
    assert np.mean([fails(space().sample(rng)) for _ in range(600)]) < 0.02
    assert operators(played(fails, 250, seed)) == {("light", "camera-orientation")}


def test_a_policy_that_fails_in_the_nominal_scene_is_compared_with_a_scene_that_it_passes():
    assert ("target-position",) in operators(played(lambda scene: scene.targets[0].x < 0.0, 200))


def test_a_failure_that_is_not_attributed_yet_counts_as_unexplained():
    strategy = Causes(space(), 0, 100)
    proposals = strategy.ask(16)
    strategy.tell(proposals, [PASSED, *[FAILED] * 15])
    nominal = 5  # of the sixteen are the reference once more, jittered
    assert len(strategy.unexplained) in (15 - nominal, 15 - nominal + 1)
    assert strategy.causes() == []


@pytest.mark.parametrize(
    "seed", range(1, 4)
)  # of the first 48, three intervals do not contain it, that of 0 among them
def test_the_probability_of_failure_lies_in_its_interval_which_is_that_of_half_as_many_random_scenes(seed: int):
    rng = np.random.default_rng(99)
    true = np.mean([dark(space().sample(rng)) for _ in range(400)])
    value, low, high = played(dark, 150, seed).probability()
    assert low - 0.03 <= true <= high + 0.03  # the sample is small, too
    assert low <= value <= high
    half = wilson(75 * value, 75)
    assert high - low < 1.1 * (half.high - half.low)


def test_before_the_budget_is_spent_the_interval_of_the_probability_is_wider():
    strategy = played(dark, 100)
    _, low, high = strategy.probability()
    strategy.ask(1)
    strategy._budget = 200
    _, earlier_low, earlier_high = strategy.probability()
    assert earlier_low < low < high < earlier_high


def test_failures_that_have_no_cause_take_at_most_half_of_the_rollouts():
    rng = np.random.default_rng(5)
    strategy = played(lambda scene: rng.random() < 0.5, 200, 1)
    _, low, high = strategy.probability()
    assert len(strategy.at_random) >= 95
    assert low < 0.5 < high


def test_random_scenes_are_drawn_with_replacement_where_there_are_few():
    light = space("pick-up", "light")
    true = np.mean([dark(light.sample(np.random.default_rng([8, number]))) for number in range(400)])
    _, low, high = played(dark, 150, where=light).probability()
    assert low - 0.03 <= true <= high + 0.03
    assert high - low < 0.3


@pytest.mark.parametrize("rate", [1.0, 0.5])
def test_a_share_is_that_of_random_scenes_in_the_range_of_the_cause_that_fail(rate: float):
    rng = np.random.default_rng(99)
    true = rate * np.mean([dark(space().sample(rng)) for _ in range(400)])
    (share,) = [cause.share for cause in played(dark, 300, rate=rate).causes() if cause.operators == ("light",)]
    assert share is not None
    assert share.low - 0.03 <= true <= share.high + 0.03
    assert share.high - share.low < 1.5 * share.value


def test_shares_add_up_to_what_all_causes_explain_together():
    rng = np.random.default_rng(99)

    def fails(scene: Scene) -> bool:
        return dark(scene) or scene.camera.yaw > 1

    true = np.mean([fails(space().sample(rng)) for _ in range(400)])
    shares = [cause.share for cause in played(fails, 300, 1).causes()]
    assert len(shares) >= 2
    assert sum(share.value for share in shares if share) == pytest.approx(true, rel=0.2)


@pytest.mark.parametrize("background", [0.1, 0.3, 0.6])
def test_a_policy_whose_failures_nothing_explains_has_no_causes(background: float):
    rng = np.random.default_rng(11)
    assert operators(played(lambda scene: rng.random() < background, 200, 2)) == set()


def test_a_cause_is_found_beside_failures_by_chance():
    rng = np.random.default_rng(4)
    assert operators(played(lambda scene: dark(scene) or rng.random() < 0.2, 300, 1)) == {("light",)}


def test_causes_of_one_operator_are_found_where_two_of_five_other_scenes_fail_by_chance():
    rng = np.random.default_rng(6)
    found = played(lambda scene: dark(scene) or scene.camera.yaw > 4 or rng.random() < 0.4, 300, 3)
    assert operators(found) == {("light",), ("camera-orientation",)}


def test_a_number_is_tried_alone_at_both_ends_of_its_range():
    tried: list[Scene] = []

    def passes(scene: Scene) -> bool:
        tried.append(scene)
        return False

    played(passes, 300)
    tried_alone = [scene.light.intensity for scene in tried if _off(scene) == {"light"}]
    assert min(tried_alone) < 0.06
    assert max(tried_alone) > 18


def _off(scene: Scene) -> set[str]:
    return {name for name, severity in space().severities(scene).items() if severity > 0.1}


# An earlier run gives hints, which are tested.
NOMINAL = space().nominal()
FAR_LEFT = replace(NOMINAL, camera=replace(NOMINAL.camera, yaw=4.0, distance=0.04))
DARKENED = replace(NOMINAL, light=replace(NOMINAL.light, intensity=0.06))


def earlier(scene: Scene, *operators: str) -> list[Cause]:
    return [Cause(space().nearest(scene), operators, 1)]


LEFT = earlier(FAR_LEFT, "camera-position", "camera-orientation")


def test_a_cause_that_is_left_is_found_anew_within_eighty_rollouts():
    found = operators(played(turned_left_and_far, 80, like=LEFT))
    assert found == {("camera-position", "camera-orientation")}
    assert not operators(played(turned_left_and_far, 80))


def test_a_cause_that_is_mended_is_not_listed_and_explains_no_failure():
    strategy = played(dark, 150, like=LEFT)
    assert operators(strategy) == {("light",)}
    assert all(dark(space().decode(genome)) for genome in strategy.unexplained)


def test_of_a_cause_only_the_operators_that_matter_are_listed():
    both = replace(DARKENED, camera=FAR_LEFT.camera)
    like = earlier(both, "light", "camera-position", "camera-orientation")
    assert operators(played(dark, 90, like=like)) == {("light",)}  # 60 are enough for 9 of 40 seeds, 90 for all
