"""Images that are blurred, noisy and compressed, for the policy only."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, nominal
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.scene import Noise
from vlafuzz.policies.base import CameraRequest, PolicySpec
from vlafuzz.worlds.noise import SensorNoise
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv, make_env
from vlafuzz.worlds.tabletop.sim.evaluator import TabletopEpisode

EDGE = np.repeat([[40], [200]], 32, axis=0).repeat(64, axis=1)[..., None].repeat(3, axis=2).astype(np.uint8)
CAMERA = CameraRequest("third_person", 64, 64)
ALL = Noise(blur=1.0, grain=8.0, jpeg=50)


def degraded(noise: Noise, seed: int = 0, step: int = 0, camera: str = "third_person") -> np.ndarray:
    return SensorNoise(noise, seed).degraded(EDGE, step, camera)


def test_no_noise_leaves_the_image_alone():
    assert degraded(Noise()) is EDGE


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


@pytest.fixture(scope="module")
def env() -> Iterator[TabletopEnv]:
    env = make_env("pick-up", CATALOGUE, (CAMERA,))
    yield env
    env.close()


def observed(env: TabletopEnv, noise: Noise, seed: int = 0) -> np.ndarray:
    spec = PolicySpec("looks", cameras=(CAMERA,))
    episode = TabletopEpisode(env, spec, replace(nominal(), noise=noise), seed, Conditions(task="pick-up"))
    return episode.observe().images["third_person"]


@pytest.mark.render
def test_the_policy_sees_the_noise_and_a_recording_does_not(env):
    clean, noisy = observed(env, Noise()), observed(env, ALL, seed=5)
    assert np.array_equal(env.picture("third_person"), clean)
    assert np.array_equal(SensorNoise(ALL, 5).degraded(clean, 0, "third_person"), noisy)
    assert not np.array_equal(clean, noisy)


@pytest.mark.render
def test_noise_changes_from_step_to_step(env):
    first = observed(env, Noise(grain=10.0))
    env.advance(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
    assert float(np.abs(env.seen("third_person").astype(float) - first).mean()) > 5


def test_reset_echoes_the_noise():
    env = make_env("pick-up", CATALOGUE)
    _, info = env.reset(options={"scene": replace(nominal(), noise=ALL)})
    env.close()
    assert info["applied"]["noise"] == {"blur": 1.0, "grain": 8.0, "jpeg": 50}
