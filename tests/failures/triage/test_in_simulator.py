"""Planted causes in the real simulator, physics only: an expert that does not move where they hold."""

import os
from pathlib import Path
from statistics import median

import numpy as np
import pytest

from tests.failures.triage.planted import CATALOGUE, CONDITIONS, EDGES, SPACE, STAGES, Planted
from tests.failures.triage.test_shrink import CASES
from vlafuzz.cli import main
from vlafuzz.failures.triage.attribute import attribute
from vlafuzz.failures.triage.certify import certify
from vlafuzz.failures.triage.oracle import Oracle
from vlafuzz.failures.triage.reference import Reference
from vlafuzz.failures.triage.shrink import shrink
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.phrasing import describe
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.policies.base import ActionChunk
from vlafuzz.policies.controls import Player
from vlafuzz.store.records import Judged
from vlafuzz.store.store import Store
from vlafuzz.worlds.manipulation.jitter import jittered
from vlafuzz.worlds.tabletop.experts.expert import Expert
from vlafuzz.worlds.tabletop.sim.evaluator import ManiSkillEvaluator

STAY = ActionChunk(np.array([[0.0, 0, 0, 0, 0, 0, 1]]))


class Afraid(Expert):
    """Stays where it is when all conditions hold, else does the task."""

    conditions = ()

    def act(self, observations):
        return [STAY if self._afraid(each) else super(Afraid, self).act([each])[0] for each in observations]

    def _afraid(self, observation):
        return all(condition(observation.privileged.scene) for condition in self.conditions)


def make_tilted(**_):
    policy = Afraid()
    policy.conditions = CONDITIONS["camera-orientation"][:1]
    return policy


@pytest.fixture(scope="module")
def evaluator():
    made = ManiSkillEvaluator(
        Conditions(task="pick-up", world={"min_distance": SPACE.operators.min_distance}, stop_early=True),
        Afraid(),
        CATALOGUE,
    )
    yield made
    made.close()


def triaged(evaluator, conditions, seed):
    """(operators, necessary, thresholds, rollouts) of a random scene in which the conditions hold."""
    evaluator._policy.conditions = conditions
    rng = np.random.default_rng(seed)
    holds = Planted(conditions).fails
    while True:
        found = next(scene for scene in iter(lambda: SPACE.sample(rng), None) if holds(scene))
        judged = Judged.of(evaluator.evaluate([found])[0])
        if judged.verdict is Verdict.FAILED:
            break

    def roll(scenes, numbers):
        return [Judged.of(outcome) for outcome in evaluator.evaluate(scenes)]

    oracle = Oracle(roll, STAGES, jittered, budget=200, lead=1)
    oracle.count_up_to(judged.lost)
    shrunk = certify(shrink(found, oracle, SPACE), oracle, SPACE, Reference(None, STAGES))
    causes = attribute(shrunk, oracle, SPACE)
    return set(shrunk.operators), set(causes.necessary), causes.thresholds, oracle.spent


QUICK = [("camera-orientation",), ("confounders",), ("light", "camera-position")]


@pytest.mark.parametrize("operators", QUICK, ids=lambda operators: "+".join(operators))
def test_planted_operators_are_found_by_rollouts(evaluator, operators):
    conditions = [CONDITIONS[name][0] for name in operators]
    left, necessary, _, rollouts = triaged(evaluator, conditions, seed=1)
    assert left == necessary == set(operators)
    assert rollouts <= 100


def test_a_threshold_is_where_it_was_planted(evaluator):
    _, _, (threshold,), _ = triaged(evaluator, CONDITIONS["camera-orientation"][:1], seed=2)
    ((path, value),) = threshold.at
    assert path == "camera.yaw"
    assert abs(value - 2.55) < 0.1


def test_the_command_triages_what_a_run_found(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    policy = "python:tests.failures.triage.test_in_simulator:make_tilted"
    write_scenes(tmp_path / "scenes.jsonl", [Planted(CONDITIONS["camera-orientation"][:1]).finding(4)])
    assert main(["run", "--scenes", "scenes.jsonl", "--policy", policy, "--store", "a.db", "--json"]) == 0
    assert main(["triage", "a.db", "--trust"]) == 0
    with Store.open(tmp_path / "a.db") as store:
        (found,) = store.triaged()
    assert (found.bucket, found.signature) == ("minimal", "pick-up|grasp|camera-orientation:+yaw")
    (threshold,) = found.causes.thresholds
    assert describe(threshold).startswith("camera-orientation: fails from yaw 2.")
    player = Player(Expert().spec)
    player.actions = found.witness.actions
    fresh = ManiSkillEvaluator(
        Conditions(task="pick-up", world={"min_distance": SPACE.operators.min_distance}), player, CATALOGUE
    )
    again = fresh.evaluate([found.shrunk])[0]
    fresh.close()
    assert again.verdict is Verdict.PASSED
    assert again.rollouts[0].states_hash == found.witness.states_hash


@pytest.mark.slow
def test_of_35_planted_cases_at_least_95_per_cent_are_found_in_70_rollouts(evaluator):
    found = [triaged(evaluator, conditions, seed) for seed, (_, conditions) in enumerate(CASES)]
    right = [left == necessary == set(case[0]) for case, (left, necessary, *_) in zip(CASES, found, strict=True)]
    assert np.mean(right) >= 0.95
    assert median(rollouts for *_, rollouts in found) <= 70


@pytest.mark.slow
def test_thresholds_are_within_a_grid_step_in_90_per_cent(evaluator):
    right = []
    for seed, (_, path, first, step, condition) in enumerate(EDGES * 2):
        _, _, thresholds, _ = triaged(evaluator, [condition], seed)
        values = {where: value for each in thresholds for where, value in each.at}
        right.append(path in values and abs(values[path] - first) < 1.01 * step)
    assert sum(right) >= 0.9 * len(right)


class TiltedModel(Afraid):
    """One for all workers; notes in the current folder in which process it was made."""

    shared = True
    conditions = tuple(CONDITIONS["camera-orientation"][:1])

    def __init__(self):
        super().__init__()
        with Path("made").open("a") as noted:
            noted.write(f"{os.getpid()}\n")


@pytest.mark.xdist_group("ray")
@pytest.mark.parametrize("executor", ["processes", "ray"])
def test_workers_share_one_model_in_triage_wherever_they_are(tmp_path, monkeypatch, executor):
    if executor == "ray":
        pytest.importorskip("ray")
    monkeypatch.chdir(tmp_path)
    policy = "python:tests.failures.triage.test_in_simulator:TiltedModel"
    write_scenes(tmp_path / "scenes.jsonl", [Planted(CONDITIONS["camera-orientation"][:1]).finding(4)])
    assert main(["run", "--scenes", "scenes.jsonl", "--policy", policy, "--store", "a.db", "--json"]) == 0
    Path("made").unlink()
    assert main(["triage", "a.db", "--trust", "--workers", "2", "--executor", executor]) == 0
    assert len(Path("made").read_text().split()) == 1
    with Store.open(tmp_path / "a.db") as store:
        (found,) = store.triaged()
    assert (found.bucket, found.signature) == ("minimal", "pick-up|grasp|camera-orientation:+yaw")
