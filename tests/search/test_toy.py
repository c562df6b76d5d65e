from dataclasses import replace

import numpy as np
import pytest

from tests.search.toy import Region, Signal, Toy, band, near, read
from tests.search.worlds import CATALOGUE, EASY, sampled, space
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Camera, Light, Scene
from vlafuzz.search.scoring import score
from vlafuzz.worlds.evaluation import Evaluator

NOMINAL = space().nominal()
DARK = Region((near("light.intensity", -4.0, 8.0),), width=0.25)  # fails below a quarter of the light


def lit(intensity: float) -> Scene:
    return replace(NOMINAL, light=Light(intensity))


def judge(scene: Scene, region: Region = DARK, signal: Signal = "smooth") -> Outcome:
    evaluator: Evaluator = Toy(region, CATALOGUE, min_distance=0.15, signal=signal)
    return evaluator.evaluate([scene])[0]


def test_values_of_a_scene_are_read_by_path():
    assert read(NOMINAL, "targets.0.x") == -0.05
    assert read(lit(0.25), "light.intensity") == -2.0
    assert read(NOMINAL, "confounders") == 0
    assert read(NOMINAL, "targets.0.object") == "pepsi_can"


@pytest.mark.parametrize(("yaw", "away"), [(170.0, 0.0), (180.0, 0.1), (-180.0, 0.1), (-10.0, 1.8)])
def test_angles_are_near_across_the_seam(yaw: float, away: float):
    turned = replace(NOMINAL, targets=(replace(NOMINAL.targets[0], yaw=yaw),))
    assert near("targets.0.yaw", 170.0, 100.0, period=360.0)(turned) == pytest.approx(away)


def test_a_band_is_about_a_sum():
    moved = replace(lit(4.0), camera=Camera(yaw=3.0))
    assert band({"light.intensity": 0.5, "camera.yaw": 1.0}, 3.5)(moved) == pytest.approx(0.5)


def test_a_region_is_where_all_conditions_hold():
    region = Region((*DARK.conditions, near("camera.yaw", 5.0, 10.0)), width=0.25)
    assert judge(lit(1 / 8), region).verdict is Verdict.PASSED
    assert judge(replace(lit(1 / 8), camera=Camera(yaw=4.0)), region).verdict is Verdict.FAILED


def test_a_calibrated_region_holds_that_share_of_other_scenes_too():
    scenes, share = sampled(1000), 0.1
    region = EASY.calibrated(scenes[:500], share)
    failing = [region.distance(scene) <= region.width for scene in scenes[500:]]
    assert np.mean(failing) == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / 250))


def test_smooth_success_comes_the_later_the_nearer_the_region_is():
    steps = [judge(lit(intensity)).rollouts[0].steps for intensity in (16.0, 1.0, 0.5, 0.3)]
    assert steps == sorted(steps)
    assert len(set(steps)) == 4
    slacks = [score(lit(x), judge(lit(x)), space()).slack for x in (16.0, 0.3)]
    assert slacks[0] > 2 * slacks[1]


def test_smooth_failures_come_the_earlier_the_deeper_a_scene_is_inside():
    shallow, deep = judge(lit(0.24)), judge(lit(1 / 16))
    assert shallow.progress == pytest.approx(0.9, abs=0.05)
    assert deep.progress == pytest.approx(0.0)
    assert (shallow.lost_stage, deep.lost_stage) == ("success", "grasp")


def test_scenes_that_are_not_fair_are_invalid():
    outcome = judge(replace(NOMINAL, targets=(replace(NOMINAL.targets[0], x=1.0),)))
    assert (outcome.verdict, outcome.check) == (Verdict.INVALID, "geometry")
