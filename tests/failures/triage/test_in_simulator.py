"""Planted causes in the real simulator, physics only: an expert that does not move where they hold."""

import os
from pathlib import Path

import numpy as np
import pytest

from tests.failures.triage.planted import TILTED, Planted
from tests.worlds.tabletop.sim.scenes import evaluate
from vlafuzz.cli import main
from vlafuzz.model import Verdict
from vlafuzz.model.phrasing import describe
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.policies.base import ActionChunk
from vlafuzz.policies.controls import Player
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.experts.expert import Expert

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
    policy.conditions = (TILTED,)
    return policy


def test_the_command_triages_what_a_run_found(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = "python:tests.failures.triage.test_in_simulator:make_tilted"
    write_scenes(tmp_path / "scenes.jsonl", [Planted([TILTED]).finding(4)])
    assert main(["run", "--scenes", "scenes.jsonl", "--policy", name, "--store", "a.db", "--unchecked", "--json"]) == 0
    assert main(["triage", "a.db", "--trust"]) == 0
    with Store.open(tmp_path / "a.db") as store:
        (found,) = store.triaged()
    assert (found.bucket, found.operators) == ("minimal", ("camera-orientation",))
    assert "".join(map(describe, found.causes.thresholds)).startswith("camera-orientation: fails from yaw 2.")
    player = Player(Expert().spec)
    player.actions = found.witness.actions
    (again,) = evaluate(player, found.shrunk)
    assert again.verdict is Verdict.PASSED
    assert again.rollouts[0].states_hash == found.witness.states_hash


class TiltedModel(Afraid):
    """One for all workers; notes in the current folder in which process it was made."""

    shared = True
    conditions = (TILTED,)

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
    write_scenes(tmp_path / "scenes.jsonl", [Planted([TILTED]).finding(4)])
    assert main(["run", "--scenes", "scenes.jsonl", "--policy", policy, "--store", "a.db", "--json"]) == 0
    Path("made").unlink()
    assert main(["triage", "a.db", "--trust", "--workers", "2", "--executor", executor]) == 0
    assert len(Path("made").read_text().split()) == 1
    with Store.open(tmp_path / "a.db") as store:
        (found,) = store.triaged()
    assert (found.bucket, found.signature) == ("minimal", "pick-up|grasp|camera-orientation:+yaw")
