"""What extra operators do: noise in pictures, other tables and walls, bent arms, late actions."""

from dataclasses import replace
from itertools import combinations
from typing import get_args

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import FRONT, STILL, nominal
from vlafuzz.model import Backdrop, Conditions, InitialPose, Latency, Light, Noise, Scene, Verdict
from vlafuzz.model.scene import Exposure, LightSwitch, Pattern, TablePaint, WallPaint
from vlafuzz.policies.base import PolicySpec
from vlafuzz.worlds.episode import DelayedCommands, SensorNoise
from vlafuzz.worlds.manipulation.camera import exposed
from vlafuzz.worlds.tabletop.evaluator import TabletopEpisode, outlines
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv
from vlafuzz.worlds.tabletop.sim.rendering import PAINTS, shade

EDGE = np.repeat([[40], [200]], 32, axis=0).repeat(64, axis=1)[..., None].repeat(3, axis=2).astype(np.uint8)
ALL = Noise(blur=1.0, grain=8.0, jpeg=50)


def degraded(noise: Noise, seed: int = 0, step: int = 0, camera: str = "front") -> np.ndarray:
    return SensorNoise(noise, seed).degraded(EDGE, step, camera)


def test_blur_softens_an_edge_and_nothing_else():
    blurred = degraded(Noise(blur=1.5))
    assert 40 < blurred[31, 32, 0] < blurred[32, 32, 0] < 200
    assert (blurred[0, 0, 0], blurred[-1, 0, 0]) == (40, 200)


def test_grain_has_the_standard_deviation_that_was_asked_for_and_no_bias():
    difference = degraded(Noise(grain=6.0)).astype(float) - EDGE
    assert difference.std() == pytest.approx(6.0, rel=0.05)
    assert abs(difference.mean()) < 0.3


def test_compression_loses_more_at_lower_quality_and_keeps_the_colours_in_their_order():
    coloured = np.tile(np.array([200, 60, 20], dtype=np.uint8), (64, 64, 1))
    coloured[:, 27:] = (20, 180, 60)
    low, high = (SensorNoise(Noise(jpeg=quality), 0).degraded(coloured, 0, "c") for quality in (10, 95))
    losses = [float(np.abs(image.astype(float) - coloured).mean()) for image in (low, high)]
    assert low.flags.c_contiguous  # torch takes no negative strides
    assert losses[0] > 2 * losses[1] > 0
    assert high.mean(axis=(0, 1)) == pytest.approx(coloured.mean(axis=(0, 1)), abs=6)


def test_one_seed_step_and_camera_give_one_image_and_others_another():
    assert np.array_equal(degraded(ALL, 3, 2), degraded(ALL, 3, 2))
    for other in (degraded(ALL, 4, 2), degraded(ALL, 3, 1), degraded(ALL, 3, 2, "wrist")):
        assert not np.array_equal(degraded(ALL, 3, 2), other)


def observed(env: TabletopEnv, noise: Noise, seed: int = 0) -> np.ndarray:
    spec = PolicySpec("looks", cameras=(FRONT,))
    episode = TabletopEpisode(env, spec, replace(nominal(), noise=noise), seed, Conditions(task="pick-up"))
    return episode.observe().images["front"]


@pytest.mark.render
def test_the_policy_sees_the_noise_and_a_recording_does_not(seeing):
    clean, noisy = observed(seeing, Noise()), observed(seeing, ALL, seed=5)
    assert np.array_equal(seeing.picture("front"), clean)
    assert np.array_equal(SensorNoise(ALL, 5).degraded(clean, 0, "front"), noisy)
    assert not np.array_equal(clean, noisy)


@pytest.mark.render
def test_an_exposure_that_follows_the_light_makes_up_for_three_stops_of_it_and_none_if_it_is_fixed(seeing):
    def picture(light: float, auto: float) -> np.ndarray:
        return shown(seeing, replace(nominal(), light=Light(light), exposure=Exposure(auto)))

    usual = picture(1.0, 0.0)
    assert (picture(6.0, 0.0) == 255).mean() > 0.5
    for light in (6.0, 1.0, 0.2):
        assert np.abs(picture(light, 1.0) - usual).max() <= 1
    for light, auto, as_by in ((16.0, 1.0, 2.0), (1 / 16, 1.0, 0.5), (4.0, 0.5, 2.0)):
        assert np.array_equal(picture(light, auto), picture(as_by, 0.0))


@pytest.mark.render
def test_an_exposure_follows_a_light_that_is_switched_in_mid_episode(seeing):
    switched = replace(nominal(), light_switch=LightSwitch("start", 4.0), exposure=Exposure(1.0))
    usual = shown(seeing, switched)
    for _ in range(2 * seeing.control_hz):
        seeing.advance(STILL)
    assert np.abs(seeing.picture("front").astype(float) - usual).mean() < 1


def test_what_is_brightened_has_more_noise_and_what_is_darkened_has_not():
    grains = [
        exposed(replace(nominal(), light=Light(light), noise=Noise(grain=3.0), exposure=Exposure(1.0))).noise.grain
        for light in (0.2, 1.0, 5.0)
    ]
    assert grains == pytest.approx([np.hypot(15.0, 4.0), 3.0, 3.0])


TABLE, WALL = (slice(90, 120), slice(40, 90)), (slice(0, 4), slice(None))  # pixels that show nothing else


def before(**backdrop: str) -> Scene:
    return replace(nominal(), backdrop=Backdrop(**backdrop))


def shown(seeing: TabletopEnv, scene: Scene) -> np.ndarray:
    seeing.begin(scene)
    seeing.check(scene)
    return seeing.picture("front").astype(float)


def test_every_paint_and_pattern_of_a_scene_is_known():
    assert {*get_args(TablePaint), *get_args(WallPaint)} == set(PAINTS)
    shades = [shade(pattern) for pattern in get_args(Pattern)]
    assert all(one.shape == (256, 256) and one.min() > 0 for one in shades)
    assert not any(np.allclose(one, other) for one, other in combinations(shades, 2))


@pytest.mark.render
def test_pattern_and_colour_show_on_the_table(seeing):
    usual, blue = shown(seeing, nominal()), shown(seeing, before(colour="blue"))
    assert usual[TABLE][..., 0].mean() > usual[TABLE][..., 2].mean() + 10
    assert blue[TABLE][..., 2].mean() > blue[TABLE][..., 0].mean() + 30
    plain, checker = (shown(seeing, before(table=pattern))[TABLE] for pattern in ("plain", "checker"))
    assert checker.std(axis=(0, 1)).mean() > plain.std(axis=(0, 1)).mean() + 10


@pytest.mark.render
def test_the_walls_colour_shows_behind_the_robot_and_not_on_the_table(seeing):
    usual, red = shown(seeing, nominal()), shown(seeing, before(wall="red"))
    assert np.array_equal(usual[TABLE], red[TABLE])
    assert red[WALL][..., 1].mean() < usual[WALL][..., 1].mean() - 5


def test_without_a_renderer_outlines_have_the_tables_colour_and_physics_is_the_same(env):
    hashes, tables = [], []
    for scene in (nominal(), before(table="checker", colour="blue", wall="red")):
        state = env.begin(scene)
        env.check(scene)
        tables.append(outlines(env.models, state, env.view, env.light, env.table_colour).table)
        env.advance(STILL)
        hashes.append(env.world.states_hash.hexdigest())
    assert tables[1] == pytest.approx(PAINTS["blue"])
    assert tables[0] == pytest.approx(PAINTS["oak"])
    assert hashes[0] == hashes[1]


BENT = InitialPose(j1=3.0, j2=-2.0, j4=1.5, j7=-1.0)


def bent(pose: InitialPose) -> Scene:
    return replace(nominal(), initial_pose=pose)


def test_the_first_joint_turns_the_hand_about_the_base(env):
    base = np.array(env.rig.base)
    straight = env.begin(nominal()).tcp - base
    turned = env.begin(bent(InitialPose(j1=3.0))).tcp - base
    angle = np.degrees(np.arctan2(turned[1], turned[0]) - np.arctan2(straight[1], straight[0]))
    assert angle == pytest.approx(3.0, abs=0.01)
    assert turned[2] == pytest.approx(straight[2], abs=1e-4)


def test_the_expert_solves_the_task_from_a_bent_start(expert_on):
    (outcome,) = expert_on("pick-up").evaluate([bent(BENT)])
    assert outcome.verdict is Verdict.PASSED


FORWARD = np.array([0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def reached(env: TabletopEnv, delay: int, steps: int = 6) -> list[float]:
    """How far the hand has come along x after each of some equal steps, metres."""
    scene = replace(nominal(), latency=Latency(delay))
    start = env.begin(scene).tcp[0]
    env.check(scene)
    return [float(env.advance(FORWARD).tcp[0] - start) for _ in range(steps)]


@pytest.mark.parametrize("delay", [1, 3])
def test_the_robot_holds_still_until_the_first_action_arrives_and_then_does_the_same(env, delay):
    prompt, late = reached(env, 0), reached(env, delay)
    assert late[:delay] == pytest.approx([0.0] * delay, abs=1e-4)
    assert late[delay:] == pytest.approx(prompt[:-delay], abs=1e-3)


def test_a_command_is_exchanged_for_the_one_that_arrives():
    commands = DelayedCommands(Latency(1))
    first, second = FORWARD, 2 * FORWARD
    assert commands.exchange(first, "current")[1] == "target"
    assert commands.exchange(second, "current")[0] is first
