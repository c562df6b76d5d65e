"""Subjects of ours behind our own servers: what comes over the wire is what comes without it."""

import numpy as np
import pytest

from tests.sim.scenes import CATALOGUE, pick_up, put
from tests.subjects.served import Attentive
from vlafuzz.outcome import Verdict
from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator
from vlafuzz.subjects.base import ActionSpec, CameraRequest
from vlafuzz.subjects.controls import Frozen, Random
from vlafuzz.subjects.mini.subject import Mini
from vlafuzz.subjects.registry import make_subject
from vlafuzz.subjects.serving.serve import PROTOCOLS, serving

pytestmark = pytest.mark.usefixtures("opened", "no_pause")
SCENES = [pick_up(put("coke_can", -0.05, 0.1)), pick_up(put("green_cube", 0.05, -0.15, 30.0))]


@pytest.fixture(params=PROTOCOLS)
def protocol(request) -> str:
    return request.param


class TestRollouts:
    """Whole rollouts in the simulator, action for action."""

    def same_as_in_process(self, make, protocol: str, verdict: Verdict = Verdict.FAILED) -> None:
        with serving(make(), protocol) as name:
            there = ManiSkillEvaluator("pick-up", make_subject(name), CATALOGUE, min_distance=0.15)
            here = ManiSkillEvaluator("pick-up", make(), CATALOGUE, min_distance=0.15)
            for far, near in zip(there.evaluate(SCENES), here.evaluate(SCENES), strict=True):
                assert far.verdict is near.verdict is verdict, far.detail
                assert np.array_equal(far.rollouts[0].actions, near.rollouts[0].actions)
                assert far.rollouts[0].states_hash == near.rollouts[0].states_hash
            there.close()
            here.close()

    @pytest.mark.parametrize("make", [Random, Frozen])
    def test_controls(self, make, protocol):
        self.same_as_in_process(make, protocol)

    @pytest.mark.render
    def test_mini(self, protocol):
        self.same_as_in_process(Mini, protocol, Verdict.PASSED)

    def test_chunks_of_which_two_actions_are_executed(self, protocol):
        self.same_as_in_process(lambda: Attentive(execute=2), protocol)

    def test_conventions(self, protocol):
        spoken = ActionSpec("euler_xyz", "current", 0.5, 2.0, "open_01", sticky=2, hz=10)
        self.same_as_in_process(lambda: Attentive(action=spoken), protocol)

    @pytest.mark.render
    def test_pictures(self, protocol):
        cameras = (CameraRequest("front", 64, 48), CameraRequest("wrist", 64, 48, "wrist"))
        self.same_as_in_process(lambda: Attentive(*cameras), protocol)
