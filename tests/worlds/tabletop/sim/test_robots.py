"""The WidowX and the Google robot: they stand, see, reach and grasp. Their files are the user's."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, evaluate, make_env, play
from vlafuzz.common import assets
from vlafuzz.errors import PrerequisiteError
from vlafuzz.model import Conditions, Outcome, Placement, Scene, Verdict
from vlafuzz.policies.base import CameraRequest
from vlafuzz.policies.controls import Frozen
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import GOOGLE, PANDA, RIGS, WIDOWX, rig
from vlafuzz.worlds.recording import Recording
from vlafuzz.worlds.tabletop.experts.expert import Expert
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator, TabletopEnv
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

ASSETS = Path(__file__).resolve().parents[4].parent / "shared" / "vlatest" / "assets"
EXTERNAL = [WIDOWX.robot, GOOGLE.robot]
needs_files = pytest.mark.skipif(not (ASSETS / "robots").is_dir(), reason="no robots' files")


@pytest.fixture(autouse=True)
def folders(monkeypatch):
    monkeypatch.setenv(assets.FOLDERS, str(ASSETS))


def nominal(robot: str, task: str = "pick-up"):
    return SearchSpace(load_operators(rig(robot).operators), CATALOGUE, task, robot).nominal()


def solved(*scenes: Scene) -> list[Outcome]:
    """What comes of the expert's rollouts, which succeed."""
    outcomes = evaluate(Expert(), *scenes, world={"min_distance": 0.1}, stop_early=True)
    assert [outcome.verdict for outcome in outcomes] == [Verdict.PASSED] * len(scenes), outcomes[0].detail
    return outcomes


@pytest.mark.parametrize("robot", RIGS)
@pytest.mark.parametrize("task", ["pick-up", "move-near", "put-on"])
def test_the_nominal_scene_of_every_rig_is_fair(robot, task):
    scene = nominal(robot, task)
    assert scene.robot == robot
    assert check_static(scene, CATALOGUE, load_operators(rig(robot).operators).min_distance) is None


def test_a_stored_scene_with_a_photo_is_read_and_not_rolled_out_any_more():
    scene = replace(nominal("widowx"), robot="widowx-photo")
    assert rig(scene.robot).reach == WIDOWX.reach
    assert check_static(scene, CATALOGUE, 0.1).reason == "unknown robot 'widowx-photo'"


def test_the_google_robot_leans_the_more_the_farther_and_the_higher_its_hand_is():
    leans = [GOOGLE.hand.lean(*at) for at in ((0.5, 0.02), (0.7, 0.02), (0.7, 0.12), (0.8, 0.2))]
    assert leans == sorted(leans)
    assert leans[0] == 0.0
    assert leans[-1] == pytest.approx(0.55)
    assert PANDA.hand.lean(0.8, 0.2) == 0.0


@pytest.mark.parametrize("robot", EXTERNAL)
def test_a_missing_file_is_named_with_the_folders_that_were_searched(robot, monkeypatch, tmp_path):
    monkeypatch.setenv(assets.FOLDERS, str(tmp_path))
    with pytest.raises(PrerequisiteError, match=f"robots/{rig(robot).urdf}") as missing:
        make_env(robot=robot)
    assert str(tmp_path) in missing.value.message
    assert assets.FOLDERS in missing.value.hint


@needs_files
@pytest.mark.parametrize("robot", EXTERNAL)
class TestExternalRobots:
    def test_it_stands_with_its_hand_over_the_table_which_goes_where_it_is_told_and_closes(self, robot):
        env = make_env(robot=robot)
        start = env.begin(nominal(robot))
        assert env.agent.robot.pose.sp.p == pytest.approx(rig(robot).base, abs=1e-5)
        assert 0.1 < start.tcp[2] < 0.25
        assert start.opening == pytest.approx(rig(robot).opening, abs=1e-3)
        assert start.tcp_rotation[2, 2] < -0.9  # the fingers point down
        end = play(env, [np.array([-0.02, 0.03, 0.02, 0, 0, 0, -1.0])], still=14)
        assert end.tcp - start.tcp == pytest.approx([-0.02, 0.03, 0.02], abs=0.004)
        assert end.opening < 0.02
        env.close()

    @pytest.mark.parametrize("task", ["pick-up", "put-on"])
    def test_the_expert_solves_the_nominal_scene_again_and_again_with_the_same_trajectory(self, robot, task):
        first, again = solved(*[nominal(robot, task)] * 2)
        assert first.rollouts[0].states_hash == again.rollouts[0].states_hash

    def test_the_expert_gets_nearly_to_the_far_end_of_its_reach(self, robot):
        setup = rig(robot)
        # The last 2 cm depend on the processor: the Google robot's grasp there is marginal.
        far = Placement("green_cube", "flat", setup.base[0] + setup.reach - 0.05, 0.03)
        scene = Scene("pick-up", (far,), "pick up green cube", robot=robot)
        solved(scene)

    def test_the_camera_sees_the_targets(self, robot):
        places = np.array([[target.x, target.y, 0.0] for target in nominal(robot, "move-near").targets])
        uv, depth = camera_pose(rig(robot).view).project(places)
        assert ((uv > 0.05) & (uv < 0.95)).all()
        assert (depth > 0.2).all()

    @pytest.mark.render
    def test_a_picture_shows_the_whole_view_and_the_targets(self, robot):
        evaluator = ManiSkillEvaluator(Conditions(task="pick-up"), Frozen(), CATALOGUE, recording=Recording(64))
        seen = evaluator.begin(nominal(robot), 0).picture("recording")
        evaluator.close()
        assert seen.shape == (64, rig(robot).view.width(64), 3)
        assert seen.std() > 10

    @pytest.mark.render
    def test_a_film_is_as_bright_as_what_a_policy_sees_and_neither_shows_a_void_behind_the_table(self, robot):
        cameras = [CameraRequest(name, 100, 100) for name in ("seen", "film")]
        env = TabletopEnv("pick-up", CATALOGUE, cameras, robot=robot, full=["film"])
        env.begin(nominal(robot))
        seen, film = (env.picture(name).copy() for name in ("seen", "film"))
        env.close()
        assert film.mean() == pytest.approx(seen.mean(), rel=0.1)
        assert [np.mean(picture.max(axis=2) == 0) for picture in (seen, film)] == [0, 0]
