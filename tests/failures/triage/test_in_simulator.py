"""Planted causes in the real simulator, physics only: an expert that does not move where they hold."""

import os
from pathlib import Path

import numpy as np
import pytest

from tests.failures.triage.planted import CATALOGUE, CONDITIONS, SPACE, Planted
from vlafuzz.cli import main
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.phrasing import describe
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.policies.base import ActionChunk
from vlafuzz.policies.controls import Player
from vlafuzz.store.store import Store
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


def make_crowded(**_):
    policy = Afraid()
    policy.conditions = CONDITIONS["confounders"][:1]
    return policy


@pytest.mark.parametrize(
    ("policy", "operator", "threshold"),
    [("tilted", "camera-orientation", "camera-orientation: fails from yaw 2."), ("crowded", "confounders", "")],
)
def test_the_command_triages_what_a_run_found(tmp_path, monkeypatch, policy, operator, threshold):
    monkeypatch.chdir(tmp_path)
    name = f"python:tests.failures.triage.test_in_simulator:make_{policy}"
    write_scenes(tmp_path / "scenes.jsonl", [Planted(CONDITIONS[operator][:1]).finding(4)])
    assert main(["run", "--scenes", "scenes.jsonl", "--policy", name, "--store", "a.db", "--unchecked", "--json"]) == 0
    assert main(["triage", "a.db", "--trust"]) == 0
    with Store.open(tmp_path / "a.db") as store:
        (found,) = store.triaged()
    assert (found.bucket, found.operators, found.causes.necessary) == ("minimal", (operator,), (operator,))
    told = "".join(map(describe, found.causes.thresholds))
    assert told.startswith(threshold)
    assert bool(told) == bool(threshold)
    player = Player(Expert().spec)
    player.actions = found.witness.actions
    fresh = ManiSkillEvaluator(
        Conditions(task="pick-up", world={"min_distance": SPACE.operators.min_distance}), player, CATALOGUE
    )
    again = fresh.evaluate([found.shrunk])[0]
    fresh.close()
    assert again.verdict is Verdict.PASSED
    assert again.rollouts[0].states_hash == found.witness.states_hash


class TiltedModel(Afraid):
    """One for all workers; notes in the current folder in which process it was made."""

    shared = True
    conditions = tuple(CONDITIONS["camera-orientation"][:1])

    def __init__(self):
        super().__init__()
        with Path("made").open("a") as noted:
            noted.write(f"{os.getpid()}\n")


@pytest.mark.parametrize("executor", ["processes", pytest.param("ray", marks=pytest.mark.slow)])
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
