"""Causes that act through one quantity are one, and others are not."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.doubles import ended, failed, passed
from tests.failures.triage.planted import SPACE
from vlafuzz.failures.mechanisms import Merged, likelihood, mechanisms
from vlafuzz.model import Scene
from vlafuzz.search.base import Cause
from vlafuzz.store.records import Trial

NOMINAL = SPACE.nominal()
PITCHED = replace(NOMINAL, camera=replace(NOMINAL.camera, pitch=-5.0))  # the target appears 19 px lower
RAISED = replace(NOMINAL, camera=replace(NOMINAL.camera, distance=0.05, elevation=90.0))
NEARER = replace(NOMINAL, targets=(replace(NOMINAL.targets[0], x=0.06),))
DARK = replace(NOMINAL, light=replace(NOMINAL.light, intensity=0.05))
LOWER = 10.0  # px, from which on the policy fails
Fails = Callable[[Scene], bool]


def down(scene: Scene) -> float:
    return SPACE.measured(scene)["down"]


def lower(scene: Scene) -> bool:
    return down(scene) >= LOWER


def beside(scene: Scene, number: int) -> Scene:
    """The scene with its target a bit off, in another way for each number."""
    target = scene.targets[0]
    return replace(scene, targets=(replace(target, y=round(target.y + 0.001 * number, 3)),))


def run(fails: Fails, shown: Sequence[Scene], *, draws: int = 60, seed: int = 0) -> list[Trial]:
    """Random scenes, and four repeats of every cause's scene."""
    rng = np.random.default_rng(seed)
    scenes = [SPACE.sample(rng) for _ in range(draws)]
    scenes += [beside(scene, number) for scene in shown for number in range(4)]
    trials = (ended(scene, failed() if fails(scene) else passed(), number) for number, scene in enumerate(scenes))
    return [replace(trial, genome=SPACE.nearest(trial.scene)) for trial in trials]


def causes(**scenes: Scene) -> list[Cause]:
    """A cause for each operator, with ``_`` for ``-`` in its name."""
    return [Cause(SPACE.nearest(scene), (name.replace("_", "-"),), 3) for name, scene in scenes.items()]


LISTED = causes(camera_orientation=PITCHED, camera_position=RAISED, target_position=NEARER, light=DARK)


@pytest.fixture(scope="module")
def merged() -> Merged:
    trials = run(lambda scene: lower(scene) or scene.light.intensity < 0.2, [PITCHED, RAISED, NEARER, DARK])
    (one,) = mechanisms(SPACE, LISTED, trials, range(60))
    return one


def test_causes_by_which_the_target_appears_lower_are_one_row(merged: Merged):
    mechanism = merged.mechanism
    assert (mechanism.quantity, mechanism.above, merged.members) == ("down", True, (0, 1, 2))
    assert mechanism.threshold == pytest.approx(LOWER, abs=3)
    assert mechanism.ways == ("camera-orientation -pitch", "camera-position +z", "target-position +x")
    assert mechanism.swapped  # each of the operators alone makes the policy fail


def test_of_a_camera_that_is_off_along_several_axes_the_one_that_matters_is_named():
    """It is 4 cm off along y, which moves the target to the side, and 3.5 cm up."""
    aside = replace(NOMINAL, camera=replace(NOMINAL.camera, distance=0.05, azimuth=90.0, elevation=45.0))
    listed = causes(camera_position=aside, target_position=NEARER)
    fails = lambda scene: down(scene) >= 6  # noqa: E731
    (one,) = mechanisms(SPACE, listed, run(fails, [aside, NEARER]))
    assert one.mechanism.ways == ("camera-position +z", "target-position +x")


def test_tilts_in_either_direction_are_one_row_if_the_target_seems_nearer_or_farther_by_as_much():
    up = replace(NOMINAL, camera=replace(NOMINAL.camera, pitch=5.0))
    listed = [*causes(camera_orientation=PITCHED), *causes(camera_orientation=up)]
    trials = run(lambda scene: SPACE.measured(scene)["depth"] >= 5, [PITCHED, up], draws=120)
    (one,) = mechanisms(SPACE, listed, trials)
    assert (one.mechanism.quantity, one.members) == ("depth", (0, 1))
    assert one.mechanism.threshold == pytest.approx(5, abs=1)
    assert one.mechanism.ways == ("camera-orientation -pitch", "camera-orientation +pitch")


def test_the_share_is_that_of_random_scenes_beyond_the_threshold_that_fail(merged: Merged):
    rng = np.random.default_rng(0)
    drawn = [SPACE.sample(rng) for _ in range(60)]
    beyond = [scene for scene in drawn if down(scene) >= merged.mechanism.threshold]
    assert merged.share.value == pytest.approx(len(beyond) / 60, abs=0.05)
    assert merged.share.low < merged.share.value < merged.share.high


def test_nothing_is_shown_by_a_swap_where_one_operator_was_tried_once():
    trials = run(lower, [PITCHED, NEARER])
    trials = [trial for trial in trials[:60] if not lower(trial.scene)] + trials[60:65]
    (one,) = mechanisms(SPACE, causes(camera_orientation=PITCHED, target_position=NEARER), trials)
    assert not one.mechanism.swapped


def test_operators_that_do_not_act_through_one_quantity_stay_apart():
    trials = run(lambda scene: scene.camera.pitch < -3 or scene.targets[0].x > 0.04, [PITCHED, NEARER])
    assert mechanisms(SPACE, causes(camera_orientation=PITCHED, target_position=NEARER), trials) == []


def test_a_single_cause_is_named_by_the_quantity_if_the_other_scenes_show_that_it_is_about_that():
    listed, trials = causes(camera_orientation=PITCHED), run(lower, [PITCHED], draws=120)
    (one,) = mechanisms(SPACE, listed, trials)
    assert (one.mechanism.quantity, one.mechanism.ways) == ("down", ("camera-orientation -pitch",))
    assert mechanisms(SPACE, listed, run(lambda scene: scene.camera.pitch < -3, [PITCHED], draws=120)) == []


@pytest.mark.parametrize("seed", range(4))
def test_every_member_lies_beyond_the_threshold_and_not_without_one_of_its_operators(seed: int):
    """Whatever the policy fails by."""
    rng = np.random.default_rng(seed)
    name = str(rng.choice(["down", "right", "reach", "brightness", "size"]))
    scenes = [SPACE.sample(rng) for _ in range(40)]
    middle = float(np.median([SPACE.measured(scene)[name] for scene in scenes]))
    shown = [scene for scene in scenes if SPACE.measured(scene)[name] > middle][:6]
    operators = [name for name, value in SPACE.severities(NOMINAL).items() if name in SPACE.groups or value]
    listed = [Cause(SPACE.encode(scene), tuple(operators), 1) for scene in shown]
    for one in mechanisms(SPACE, listed, run(lambda scene: SPACE.measured(scene)[name] > middle, shown, draws=40)):
        sign = 1 if one.mechanism.above else -1
        for member in one.members:
            scene = SPACE.decode(listed[member].genome)
            others = [SPACE.measured(SPACE.reset(scene, SPACE.groups[each])) for each in operators]
            values = [measured[one.mechanism.quantity] for measured in others]
            assert sign * SPACE.measured(scene)[one.mechanism.quantity] >= sign * one.mechanism.threshold
            assert min(sign * value for value in values) < sign * one.mechanism.threshold


def test_a_range_that_tells_failures_from_passes_is_likelier_than_others():
    failures = np.array([True, True, False, False, False])
    ranges = np.array([failures, ~failures, np.ones(5, bool), np.zeros(5, bool)])
    assert int(np.argmax(likelihood(ranges, failures))) == 0
