"""The tabletop in MuJoCo: the same scenes, solved by the same expert, and repeated bit by bit."""

import subprocess
import sys
from dataclasses import replace
from importlib import util

import numpy as np
import pytest

from tests.cli.typed import typed
from tests.worlds.tabletop.sim.scenes import CATALOGUE, CROWD, EVENTFUL, STILL, nominal, pick_up, put
from vlafuzz.model import Camera, Conditions, Scene
from vlafuzz.model.scene import GripSlip, Newcomer, TargetTopple
from vlafuzz.policies.base import CameraRequest, EpisodeStart
from vlafuzz.worlds import opengl, world_of
from vlafuzz.worlds.tabletop.experts.expert import Expert, Privileged, belief, controller
from vlafuzz.worlds.tabletop.tasks import TASKS

NAME = "tabletop-mujoco"
pytestmark = pytest.mark.skipif(util.find_spec("mujoco") is None, reason="MuJoCo is not installed")
HASH = "from tests.worlds.tabletop_mujoco import test_mujoco as t; print(*map(t.hash_of, (t.CROWD, t.EVENTFUL)))"


def room(task: str = "pick-up", *cameras: CameraRequest):
    from vlafuzz.worlds.tabletop_mujoco.env import MujocoRoom

    return MujocoRoom(task, CATALOGUE, cameras)


def evaluator_of(policy, task: str):
    conditions = Conditions(task=f"{NAME}/{task}", policy="expert", stop_early=True)
    return world_of(conditions.task).evaluator(conditions, policy, None, recording=None, checked=True)


def hash_of(scene: Scene) -> str:
    """Of the states in which the hand goes down among the objects and closes."""
    made = room()
    made.begin(scene)
    for action in [np.array([0, 0.01, -0.04, 0, 0, 0.1, grip]) for grip in (1, 1, 1, 1, -1, -1)]:
        made.advance(action)
    return made.world.states_hash.hexdigest()


@pytest.mark.parametrize("task", TASKS)
def test_the_expert_solves_the_scene_of_every_task(task: str):
    scene = replace(nominal(task), task=f"{NAME}/{task}")
    (outcome,) = evaluator_of(Expert(), task).evaluate([scene])
    assert outcome.rollouts[0].reached == TASKS[task].stage_names


def test_the_scenes_of_its_space_have_its_name_and_those_of_the_tabletop_otherwise():
    here, there = (world_of(task).space(task, "panda") for task in (f"{NAME}/put-in", "put-in"))
    drawn, same = (space.sample(np.random.default_rng(1)) for space in (here, there))
    assert drawn == replace(same, task=f"{NAME}/put-in")


def test_equal_scenes_have_equal_states_bit_by_bit_in_this_process_and_another():
    first, again = ([hash_of(scene) for scene in (CROWD, EVENTFUL)] for _ in range(2))
    other = subprocess.run([sys.executable, "-c", HASH], capture_output=True, text=True, check=True).stdout
    assert first == again == other.split()


def test_things_weigh_what_they_weigh_on_the_tabletop_and_stay_where_they_are():
    made = room()
    start = made.begin(CROWD)
    made.check(CROWD)
    masses = [made.world.model.body(str(number)).mass[0] for number in range(len(made.models))]
    assert masses == pytest.approx([model.mass for model in made.models], rel=1e-3)
    for _ in range(10):
        state = made.advance(STILL)
    assert np.abs(state.positions - start.positions).max() < 1e-3


@pytest.mark.parametrize("thing", ["coke_can", "green_cube"])
def test_what_is_held_does_not_creep_out_of_the_fingers(thing: str):
    made = room()
    state = made.begin(pick_up(put(thing, -0.05, 0.0)))
    expert, actions = controller(EpisodeStart("held", "", "pick-up", 0, "panda"), 0), 0
    while state.positions[0][2] < 0.12 and (actions := actions + 1) < 25:
        known = Privileged(CROWD, made.models, state, False)
        state = made.advance(expert.act(belief(known)), "current")
    states = [made.advance(np.append(np.zeros(6), -1.0)) for _ in range(28)]
    places = [one.tcp_rotation.T @ (one.positions[0] - one.tcp) for one in states[2:]]  # once the hand stands still
    assert states[-1].held == 0
    assert np.abs(places[-1] - places[0]).max() < 2e-4


def test_events_happen_here_too():
    fallen = replace(nominal(), target_topple=TargetTopple("start", "lying"), grip_slip=GripSlip("start", 2))
    made = room()
    made.begin(replace(fallen, targets=(put("coke_can", -0.05, 0.1),)))
    upright = [made.advance(STILL).rotations[0][2, 2] for _ in range(10)]
    assert (upright[0], upright[-1]) == (pytest.approx(1.0, abs=1e-3), pytest.approx(0.0, abs=0.05))
    usual = pick_up(put("coke_can", -0.05, 0.1), put("apple", 0.0, -0.2))
    made.begin(scene := replace(usual, newcomer=Newcomer("start", "first")))
    made.check(scene)
    states = [made.advance(STILL) for _ in range(10)]
    assert [1 in state.there for state in states] == [False] * 5 + [True] * 5
    assert states[-1].positions[1] == pytest.approx([0.0, -0.2, 0.035], abs=0.01)


@pytest.mark.skipif(not opengl.device(), reason="no OpenGL with EGL")
def test_pictures_follow_camera_and_light():
    made = room("pick-up", CameraRequest("front", 64, 64), CameraRequest("hand", 64, 64, "wrist"))
    target, pictures = put("apple", 0, 0), []
    for scene in (pick_up(target), pick_up(target, light=0.25), pick_up(target, camera=Camera(yaw=10.0))):
        made.begin(scene)
        made.check(scene)
        pictures.append(made.seen("front").astype(float))
    usual, dark, turned = pictures
    assert dark.mean() / usual.mean() == pytest.approx(0.25 ** (1 / 2.2), abs=0.02)
    assert np.abs(turned - usual).mean() > 3
    assert made.seen("hand").std() > 5
    made.close()


def test_without_mujoco_one_sentence_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr("vlafuzz.worlds.tabletop_mujoco.world.util.find_spec", lambda _: None)
    said = typed(capsys, f"run --world {NAME} --task pick-up --policy expert --budget 1", code=3).err
    assert "tabletop-mujoco needs MuJoCo, which is not installed" in said
    assert "vlafuzz[mujoco]" in said
