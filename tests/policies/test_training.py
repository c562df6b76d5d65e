"""From demonstrations to a policy: the scripts that reproduce `mini`."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.policies.mini.policy import CARD, WEIGHTS, Mini
from vlafuzz.worlds.tabletop.tasks import TASKS

SCRIPTS = Path(__file__).parents[2] / "scripts"
pytestmark = [pytest.mark.slow, pytest.mark.render]


def call(command: str) -> None:
    """Run a script with its arguments."""
    script, *arguments = command.split()
    subprocess.run([sys.executable, str(SCRIPTS / script), *arguments], capture_output=True, check=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("training")
    call(f"make_demos.py --episodes 3 3 3 3 --workers 1 1 1 1 --out {folder}/demos")
    call(f"train_mini.py {folder}/demos --out {folder}/mini --updates 3 --batch 8 --every 3")
    return folder


def test_demonstrations_pair_what_was_seen_with_what_was_right(folder):
    for task in TASKS:
        steps = np.load(folder / "demos" / f"{task}-00" / "steps.npz")
        frames = np.load(folder / "demos" / f"{task}-00" / "frames.npy")
        assert frames.shape == (len(steps["label"]), 128, 128, 3)
        assert frames.std() > 10
        assert set(np.unique(steps["label"][:, 6])) <= {-1.0, 1.0}
        assert len(set(steps["episode"])) >= 2


def test_what_was_trained_acts(folder):
    mini = Mini(folder / "mini")
    mini.reset([EpisodeStart("one", "pick up apple", "pick-up", 0)])
    state = np.array([0, 0, 0.17, np.pi, 0, 0, 1], dtype=np.float32)
    picture = np.zeros((128, 128, 3), np.uint8)
    (chunk,) = mini.act([Observation("one", 0, nominal().instruction, images={"front": picture}, state=state)])
    assert np.isfinite(chunk.actions).all()


def test_a_second_round_is_written_into_the_card(folder):
    again = folder / "again"
    call(f"train_mini.py {folder}/demos --init {folder}/mini --out {again} --updates 2 --batch 8")
    card = json.loads((again / CARD).read_text())
    assert [part["recipe"]["updates"] for part in card["rounds"]] == [3, 2]
    assert card["words"] == json.loads((folder / "mini" / CARD).read_text())["words"]


def test_quantization_notes_a_range_of_every_layer_and_the_weights_stay(folder):
    before = (folder / "mini" / WEIGHTS).read_bytes()
    call(f"quantize_mini.py --weights {folder}/mini --scenes 1")
    card = json.loads((folder / "mini" / CARD).read_text())
    assert len(card["ranges"]) == 11
    assert all(size > 0 for size in card["ranges"].values())
    assert (folder / "mini" / WEIGHTS).read_bytes() == before
