"""Pictures: light, camera and objects are seen as the scene says; those for people have shadows."""

from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, FRONT, SIZE, evaluate, make_env, nominal, pick_up, put
from vlafuzz.model import Camera, Conditions, Light, Scene
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.recording import Recording
from vlafuzz.worlds.tabletop.evaluator import outlines
from vlafuzz.worlds.tabletop.experts.expert import Expert
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator, TabletopEnv

pytestmark = pytest.mark.render
PIXEL = 1 / SIZE
SPOT = (0.02, -0.15)
ORANGE = pick_up(put("orange", *SPOT))
CAMERAS = {
    "nominal": Camera(),
    "yaw": Camera(yaw=5),
    "pitch": Camera(pitch=-5),
    "roll": Camera(roll=5),
    "to the right": Camera(distance=0.05, azimuth=90),
    "farther": Camera(distance=0.05, azimuth=0),
    "higher": Camera(distance=0.05, elevation=90),
    "all at once": Camera(0.05, 135, -30, roll=-4, pitch=3, yaw=-5),
}


def picture(env: TabletopEnv, scene: Scene) -> np.ndarray:
    env.begin(scene)
    env.check(scene)
    return env.picture("front")


def centroid(picture: np.ndarray) -> np.ndarray:
    """(u, v) of what is orange: nothing else in the nominal picture has so much more red than blue."""
    v, u = np.nonzero(picture[..., 0].astype(int) - picture[..., 2] > 90)
    assert len(u) > 30, "no orange in the picture"
    return np.array([u.mean() + 0.5, v.mean() + 0.5]) / SIZE


def projected(x: float, y: float, camera: Camera = CAMERAS["nominal"]) -> np.ndarray:
    middle = np.array([[x, y, CATALOGUE["orange"].stable_poses[0].height]])
    return camera_pose(PANDA.view, camera).project(middle)[0][0]


def test_brightness_grows_with_the_light(seeing):
    alphas = [0.05, 0.2, 1.0, 4.0, 20.0]
    means = [float(picture(seeing, replace(ORANGE, light=Light(alpha))).mean()) for alpha in alphas]
    assert means == sorted(set(means))
    assert (means[0] < 60, 90 < means[2] < 200, means[-1] > 230) == (True, True, True)


def test_the_same_scene_is_the_same_picture_after_others(seeing):
    first = picture(seeing, ORANGE)
    picture(seeing, replace(ORANGE, light=Light(0.3), camera=CAMERAS["all at once"]))
    picture(seeing, pick_up(put("coke_can", 0.0, 0.1), put("sponge", 0.02, -0.15)))
    assert np.array_equal(picture(seeing, ORANGE), first)


@pytest.mark.parametrize("name", CAMERAS)
def test_picture_and_outlines_have_the_object_where_the_rig_projects_it(seeing, name):
    scene = replace(ORANGE, camera=CAMERAS[name])
    seen = centroid(picture(seeing, scene))
    assert seen == pytest.approx(projected(*SPOT, scene.camera), abs=1.5 * PIXEL)
    (thing,) = outlines(seeing.models, seeing.begin(scene), seeing.view, seeing.light).things
    assert thing.pixels.mean(axis=0) == pytest.approx(seen, abs=1.5 * PIXEL)
    if name != "nominal":  # every deviation of the camera can be seen
        assert np.abs(projected(*SPOT, scene.camera) - projected(*SPOT)).max() > 2 * PIXEL


class Watching(Expert):
    """An expert that asks for a picture, and keeps it."""

    def __init__(self) -> None:
        super().__init__()
        self.spec = replace(self.spec, cameras=(FRONT,))
        self.seen: list[np.ndarray] = []

    def act(self, observations):
        self.seen += [observation.images["front"] for observation in observations]
        return super().act(observations)


def test_the_policy_sees_the_scene_and_a_recording_every_step():
    policy, recording = Watching(), Recording(64)
    (rollout,) = evaluate(policy, ORANGE, recording=recording, stop_early=True)[0].rollouts
    assert centroid(policy.seen[0]) == pytest.approx(projected(*SPOT), abs=1.5 * PIXEL)
    assert len(policy.seen) == len(recording.observations) == rollout.steps
    assert len(recording.frames) == rollout.steps + 1


def test_a_wrist_camera_looks_at_what_is_between_the_fingers():
    cameras = (CameraRequest("wrist", 64, 64, "wrist"),)
    env = make_env(cameras=cameras)
    env.begin(pick_up(put("green_cube", 0.0, 0.0)))
    near = env.picture("wrist").astype(int)
    env.begin(pick_up(put("green_cube", -0.2, 0.3)))
    far = env.picture("wrist").astype(int)
    env.close()
    greener = [(picture[..., 1] - picture[..., 0] > 40).sum() for picture in (near, far)]
    assert greener[0] > 10
    assert greener[1] == 0


BASKET = nominal("put-in")
BOTH = (CameraRequest("policy", 64, 64), CameraRequest("film", 96, 96))


def pictures(light: float, *full: str) -> list[np.ndarray]:
    env = TabletopEnv("put-in", CATALOGUE, BOTH, full=full)
    env.begin(replace(BASKET, light=Light(light)))
    seen = [env.picture("film").copy(), env.picture("policy").copy()]
    env.close()
    return seen


def test_a_film_changes_nothing_that_the_policy_sees():
    (film, seen), (_, alone) = pictures(1.0, "film"), pictures(1.0)
    assert np.array_equal(seen, alone)
    assert film.shape == (96, 96, 3)


def test_bright_light_is_no_white_sheet_in_a_film():
    shares = [(pictures(6.0, *full)[0].min(axis=2) > 250).mean() for full in (["film"], [])]
    assert shares[0] < 0.02
    assert shares[1] > 0.3


def test_a_policy_sees_pictures_as_good_as_a_film_s_where_its_run_asks_for_them():
    scene = replace(BASKET, light=Light(6.0))
    for world, seen in (({"quality": "full"}, pictures(6.0, "policy")[1]), ({}, pictures(6.0)[1])):
        policy = Watching()
        policy.spec = replace(policy.spec, cameras=BOTH[:1])
        evaluator = ManiSkillEvaluator(Conditions(task="put-in", world=world), policy, CATALOGUE, checked=False)
        episode = evaluator.begin(scene, 0)
        assert np.array_equal(episode.observe().images["policy"], seen)
        evaluator.renew()
