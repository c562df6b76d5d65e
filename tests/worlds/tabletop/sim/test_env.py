"""The environment builds what is requested and reports it; what does not stay there is not fair."""

from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, CROWD, nominal, pick_up, put, states_hash
from vlafuzz.errors import CatalogueError, SimulatorError
from vlafuzz.model import Backdrop, Camera, InitialPose, Latency, Light, Noise, Placement, Scene
from vlafuzz.worlds.tabletop.sim.world import settled
from vlafuzz.worlds.tabletop.tasks import TASKS

MOVED = Camera(0.04, 30.0, 20.0, roll=2.0, pitch=-3.0, yaw=4.0)
ORANGE, CAN = put("orange", -0.10, 0.15, 30.0), put("coke_can", 0.05, -0.2, -70.0, "lying")
SHOWN = pick_up(ORANGE, CAN, light=0.4, camera=MOVED)


@pytest.mark.parametrize(
    ("requested", "says"),
    [
        (replace(SHOWN, light=Light(0.41)), "light"),
        (replace(SHOWN, camera=replace(SHOWN.camera, distance=0.041)), "pose of camera"),
        (replace(SHOWN, camera=replace(SHOWN.camera, roll=2.1)), "pose of camera"),
        (replace(SHOWN, targets=(put("orange", -0.099, 0.15, 30.0),)), "pose of orange"),
        (replace(SHOWN, confounders=(put("coke_can", 0.05, -0.2, -69.0, "lying"),)), "pose of coke_can"),
        (replace(SHOWN, confounders=(put("coke_can", 0.05, -0.2, -70.0),)), "pose of coke_can"),
        (replace(SHOWN, confounders=(put("pepsi_can", 0.05, -0.2, -70.0, "lying"),)), "objects"),
        (replace(SHOWN, confounders=()), "objects"),
        (replace(SHOWN, backdrop=Backdrop(wall="red")), "backdrop"),
        (replace(SHOWN, initial_pose=InitialPose(j1=3.0)), "initial pose"),
        (replace(SHOWN, latency=Latency(2)), "latency"),
        (replace(SHOWN, noise=Noise(blur=1.0)), "noise"),
    ],
)
def test_whatever_was_not_applied_is_an_error_that_names_it(env, requested, says):
    env.begin(SHOWN)
    env.check(SHOWN)
    with pytest.raises(SimulatorError, match=f"^{says}: asked for "):
        env.check(requested)


def test_an_objects_own_quaternion_and_scale_are_applied(env):
    tilted = (0.9, 0.0, 0.43589, 0.0)
    scene = pick_up(put("coke_can", -0.1, 0.1, quaternion=tilted), put("sponge", 0.05, -0.1, scale=0.5))
    env.begin(scene)
    can, sponge = env.world.poses
    assert can.q == pytest.approx(tilted, abs=1e-4)
    assert sponge.p[2] == pytest.approx(0.009, abs=1e-5)


@pytest.mark.parametrize("broken", [Placement("orange", "standing", 0.0, 0.1), Placement("banana", "lying", 0.0, 0.1)])
def test_after_a_scene_that_cannot_be_built_the_next_one_is_as_ever(env, broken):
    known = states_hash(env)
    with pytest.raises(CatalogueError):
        env.begin(replace(CROWD, confounders=(*CROWD.confounders[:2], broken)))
    assert states_hash(env) == known


def rejected(*placements: Placement, task: str = "pick-up"):
    return settled(Scene(task, placements[:1], "do it", confounders=placements[1:]), CATALOGUE)


def tilted(degrees: float) -> tuple[float, float, float, float]:
    half = np.radians(degrees) / 2
    return float(np.cos(half)), float(np.sin(half)), 0.0, 0.0


@pytest.mark.parametrize("name", TASKS)
def test_nominal_scenes_are_fair(name):
    assert settled(nominal(name), CATALOGUE) is None


@pytest.mark.parametrize(
    "placements",
    [
        CROWD.placements,
        (put("green_cube", 0.0, 0.1, quaternion=tilted(90)),),  # as imported
        (put("coke_can", 0.0, 0.1, scale=0.4),),
        (put("coke_can", 0.0, 0.1, scale=2.5),),
    ],
)
def test_what_stays_where_it_is_put_is_fair(placements):
    assert rejected(*placements) is None


@pytest.mark.parametrize(
    ("placements", "starts", "says"),
    [
        ([put("coke_can", 0.36, 0.1)], "coke_can at (0.360, 0.100) ", ""),  # the table ends at x = 0.35
        ([put("orange", 0.5, 0.0)], "orange", "fell to z = -"),
        ([put("coke_can", 0.0, 0.1, quaternion=tilted(35))], "coke_can", "cm while settling, more than 1 cm"),
        ([put("green_cube", 0.0, 0.1, quaternion=tilted(20))], "green_cube", "tipped by 20 degrees"),
        ([put("coke_can", 0.0, 0.1), put("apple", 0.02, 0.1)], "", ""),  # one inside the other
        ([put("sponge", 0.0, 0.0), put("orange", 0.37, 0.2)], "orange", ""),
    ],
)
def test_what_does_not_stay_is_named_with_what_it_does(placements, starts, says):
    rejection = rejected(*placements)
    assert rejection.check == "settling"
    assert rejection.reason.startswith(starts)
    assert says in rejection.reason


@pytest.mark.parametrize(("distance", "check"), [(0.06, "solved"), (0.09, None)])
def test_two_that_are_near_already_are_solved_before_anybody_acts(distance, check):
    rejection = rejected(put("green_cube", 0.0, 0.0), put("yellow_cube", 0.0, distance), task="move-near")
    assert (rejection and rejection.check) == check
    assert not rejection or rejection.reason == "move-near is solved at the start, before the policy acts"
