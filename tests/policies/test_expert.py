"""The expert shows that a scene can be solved, so it must solve fair ones."""

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, evaluate, nominal, pick_up, put
from vlafuzz.errors import PolicyError
from vlafuzz.model import Placement, Scene, Verdict
from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.worlds.tabletop.experts.expert import ATTEMPTS, GRASPS, Expert

AROUND = (put("sprite_can", 0.02, 0.24), put("apple", -0.16, -0.22), put("sponge", 0.06, -0.20, 30.0))
ON = [("plate", "sponge"), ("table_cloth", "coke_can"), ("large_plate", "apple"), ("plate", "carrot")]
IN = [("basket", "orange"), ("basket", "green_cube"), ("basket", "eggplant")]
NEAR = [("coke_can", "apple"), ("green_cube", "blue_plastic_bottle"), ("sponge", "orange")]


def placed(task: str, place: str, name: str) -> Scene:
    targets = (put(name, -0.1, -0.1, 20.0), put(place, -0.02, 0.12, 10.0))
    return Scene(task, targets, f"{name} to {place}")


def moved_near(*names: str) -> Scene:
    targets = tuple(put(name, -0.05, y) for name, y in zip(names, (-0.12, 0.14), strict=True))
    return Scene("move-near", targets, "move it near", confounders=(put("pepsi_can", 0.09, -0.22),))


SCENES = {
    f"{name} {pose.name}": pick_up(put(name, -0.02, 0.06, 35.0, pose.name))
    for name in CATALOGUE.names("graspable")
    for pose in CATALOGUE[name].stable_poses
    if pose.grasps
}
SCENES |= {f"corner {x} {y}": pick_up(put("coke_can", x, y)) for x in (-0.18, 0.11) for y in (-0.24, 0.24)}
SCENES["among others"] = pick_up(put("orange", -0.05, 0.0), *AROUND)
SCENES |= {f"{name} on {place}": placed("put-on", place, name) for place, name in ON}
SCENES |= {f"{name} in {place}": placed("put-in", place, name) for place, name in IN}
SCENES |= {f"{one} near {other}, past a can": moved_near(one, other) for one, other in NEAR}


@pytest.mark.parametrize("name", SCENES)
def test_it_solves_every_object_in_every_pose_corner_and_place(expert_on, name):
    (outcome,) = expert_on(SCENES[name].task).evaluate([SCENES[name]])
    assert outcome.verdict is Verdict.PASSED, outcome.detail


class Slippery(Expert):
    """An expert whose gripper opens for three steps when it first lifts the object."""

    def __init__(self) -> None:
        super().__init__()
        self._open = 0

    def act(self, observations):
        (chunk,) = super().act(observations)
        lifted = observations[0].privileged.state.positions[0, 2] > 0.03
        if lifted or self._open:
            self._open += 1
        if 1 <= self._open <= 3:
            chunk.actions[0, 6] = 1.0
        return [chunk]


def test_it_tries_again_when_the_object_slips():
    (outcome,) = evaluate(Slippery(), pick_up(put("sponge", -0.05, 0.05)))
    trace = outcome.rollouts[0].actions[:, 6]
    assert (np.diff(trace) < 0).sum() >= 2, "it closed only once"
    assert outcome.verdict is Verdict.PASSED


def test_without_the_simulators_state_it_refuses():
    expert = Expert()
    expert.reset([EpisodeStart("one", "pick up apple", "pick-up", 0)])
    with pytest.raises(PolicyError, match="needs the simulator's state") as caught:
        expert.act([Observation("one", 0, "pick up apple")])
    assert caught.value.cause == "protocol"


@pytest.mark.slow
def test_it_solves_nearly_all_fair_random_scenes(expert_on):
    rng, verdicts = np.random.default_rng(0), []
    for _ in range(100):
        name = str(rng.choice(CATALOGUE.names("graspable")))
        rest = CATALOGUE[name].stable_poses[rng.integers(len(CATALOGUE[name].stable_poses))].name
        spot = rng.uniform(-0.2, 0.12), rng.uniform(-0.25, 0.25), rng.uniform(-180, 180)
        scene = pick_up(Placement(name, rest, *map(float, spot)))
        verdicts.append(expert_on("pick-up").evaluate([scene])[0].verdict)
    assert set(verdicts) <= {Verdict.PASSED, Verdict.FAILED, Verdict.INVALID}
    assert verdicts.count(Verdict.PASSED) >= 85
    assert verdicts.count(Verdict.FAILED) <= 2


@pytest.mark.parametrize("attempt", range(0, ATTEMPTS, GRASPS))
def test_it_comes_from_above_and_leaning_either_way(attempt: int):
    expert = Expert()
    expert.attempt = attempt
    (outcome,) = evaluate(expert, nominal(), world={"min_distance": 0.0})
    assert outcome.verdict is Verdict.PASSED
    (rollout,) = outcome.rollouts
    turned = np.abs(rollout.actions[:, 3:5]).max()
    assert (turned > 0.2) == (attempt > 0)
