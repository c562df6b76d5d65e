from dataclasses import replace

import numpy as np
import pytest

from tests.doubles import STAGES, failed, passed, rollout, scene
from tests.worlds.tabletop.sim.scenes import evaluate, pick_up, put
from vlafuzz.failures.triage.witness import SEEING_TRIES, TRIES, find_witness, prove
from vlafuzz.model import Latency, Outcome
from vlafuzz.policies.base import Observation
from vlafuzz.policies.controls import Player
from vlafuzz.worlds.tabletop.experts.expert import Expert


def test_the_first_solution_that_can_be_played_again_is_the_witness():
    solved = Outcome.of((replace(rollout(), states_hash="a" * 32),), STAGES)
    search = find_witness(scene(), lambda *_: solved, lambda *_: passed())
    assert search.witness is not None
    assert (search.rollouts, search.witness.attempt, search.witness.states_hash) == (2, 0, "5" * 32)


def test_where_the_expert_fails_it_begins_with_other_grasps():
    search = find_witness(scene(), lambda _, grasp, solver: passed() if grasp == 2 else failed(), lambda *_: passed())
    assert search.witness is not None
    assert (search.witness.attempt, search.rollouts) == (2, 4)


@pytest.mark.parametrize(("solved", "rollouts"), [(failed(), 3), (passed(), 6)])
def test_without_a_solution_or_where_it_fails_when_played_again_there_is_no_witness(solved, rollouts):
    search = find_witness(scene(), lambda *_: solved, lambda *_: failed(), tries=3)
    assert (search.witness, search.rollouts) == (None, rollouts)


def test_the_expert_acts_without_latency_and_its_actions_are_played_with_it():
    late, seen = replace(scene(), latency=Latency(2)), []

    def passes(shown, *_):
        seen.append(shown)
        return passed()

    assert find_witness(late, passes, passes).witness is not None
    assert seen == [scene(), late]


def test_a_simulator_that_breaks_says_nothing_about_the_scene():
    broken = Outcome.error("simulator: it broke")
    assert find_witness(scene(), lambda *_: broken, lambda *_: passed(), tries=3).broken
    assert find_witness(scene(), lambda *_: passed(), lambda *_: broken, tries=3).broken
    assert not find_witness(scene(), lambda *_: failed(), lambda *_: passed(), tries=3).broken
    search = find_witness(scene(), lambda scene, grasp, solver: passed() if grasp else broken, lambda *_: passed())
    assert (search.witness is not None, search.broken) == (True, False)


@pytest.mark.parametrize(("sees", "solver", "replays"), [(True, "seeing", 2), (False, "expert", SEEING_TRIES)])
def test_what_the_seeing_expert_solves_too_it_witnesses(sees, solver, replays):
    search = prove(scene(), lambda *asked: passed() if sees or asked[-1] == "expert" else failed(), lambda *_: passed())
    assert search.witness is not None
    assert (search.witness.solver, search.rollouts) == (solver, 2 + replays)


def test_where_the_expert_fails_the_seeing_expert_is_not_asked():
    asked = []

    def fails(*of):
        asked.append(of[-1])
        return failed()

    assert prove(scene(), fails, lambda *_: passed()).witness is None
    assert asked == ["expert"] * TRIES


def test_a_player_executes_its_actions_and_then_stays():
    player = Player(Expert().spec)
    player.actions = np.arange(14, dtype=np.float32).reshape(2, 7)
    acted = [chunk.actions[0] for step in range(3) for chunk in player.act([Observation("e", step, "")])]
    still = [0, 0, 0, 0, 0, 0, 13]
    assert [list(action) for action in acted] == [[0, 1, 2, 3, 4, 5, 6], [7, 8, 9, 10, 11, 12, 13], still]
    assert player.spec.action == Expert().spec.action


def test_an_expert_that_begins_with_another_grasp_turns_its_hand_otherwise():
    expert, ways = Expert(), []
    for expert.attempt in range(2):
        (outcome,) = evaluate(expert, pick_up(put("sponge", -0.05, 0.0, 30.0)))
        ways.append(outcome.rollouts[0].actions[:4])
    assert not np.allclose(*ways)
