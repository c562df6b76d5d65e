"""Mini with its shipped weights, in the real simulator."""

import hashlib
import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, strategies as st
from numpy.typing import NDArray
from torch import nn

from tests.worlds.tabletop.sim.scenes import CATALOGUE, evaluate, nominal, pick_up, put
from vlafuzz.errors import PolicyError, PrerequisiteError
from vlafuzz.model import Scene, Verdict
from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.policies.mini import words
from vlafuzz.policies.mini.integer import LEVELS, IntegerConv, exact, to_integers
from vlafuzz.policies.mini.model import BINS, FARTHEST, Network, decode, from_bins, proprioception
from vlafuzz.policies.mini.policy import CAMERA, CARD, SHIPPED, WEIGHTS, Mini, read_card
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.worlds import default_policy
from vlafuzz.worlds.tabletop.renderer import Renderer
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings, say

STATE = np.array([0, 0, 0.17, np.pi, 0, 0, 1], dtype=np.float32)
APPLE, CUBE = put("apple", -0.05, 0.1), put("green_cube", -0.05, -0.12)


class Blind(Mini):
    def act(self, observations):
        black = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
        return super().act([replace(seen, images={CAMERA.name: black}) for seen in observations])


def verdict(scene: Scene, policy: Mini | None = None) -> Verdict:
    return evaluate(policy or Mini(), scene, stop_early=True)[0].verdict


@pytest.mark.render
@pytest.mark.parametrize("task", TASKS)
def test_it_solves_the_nominal_scene_of_every_task(task):
    assert verdict(nominal(task)) is Verdict.PASSED


@pytest.mark.render
def test_it_takes_what_it_is_told_to_take():
    assert verdict(pick_up(APPLE, CUBE)) is Verdict.PASSED
    assert verdict(pick_up(CUBE, APPLE)) is Verdict.PASSED
    assert verdict(replace(pick_up(APPLE, CUBE), instruction="pick up green cube")) is Verdict.FAILED


@pytest.mark.render
def test_it_finds_nothing_in_the_dark():
    assert verdict(pick_up(APPLE), Blind()) is Verdict.FAILED


def test_the_card_says_how_it_was_trained_and_what_it_solves():
    card = json.loads((SHIPPED / CARD).read_text())
    assert [set(part) for part in card["rounds"]] == [{"data", "recipe", "curve"}] * len(card["rounds"])
    assert {(row["set"], row["task"]) for row in card["success"]} >= {("nominal", task) for task in TASKS}
    assert all(row["low"] <= row["passed"] / row["of"] <= row["high"] for row in card["success"])


@pytest.mark.parametrize("folder", [SHIPPED, SHIPPED / "libero"])
def test_the_card_says_what_the_weights_are(folder):
    card, content = json.loads((folder / CARD).read_text()), (folder / WEIGHTS).read_bytes()
    assert card["weights"] == hashlib.sha256(content).hexdigest()[:20]
    assert len(content) <= 9e6
    assert "not evidence about OpenVLA" in card["note"]


class TestMiniLibero:
    def test_it_looks_through_both_cameras_and_listens(self):
        black = answer(None)
        assert not any(np.array_equal(answer(changed), black) for changed in ("front", "wrist", "words"))

    def test_it_knows_the_words_of_its_suite(self):
        known = read_card(SHIPPED / "libero").words
        for text in ("pick up the alphabet soup and place it in the basket", "please pick up the milk"):
            assert (words.encode(text, known) <= len(known)).all()


def answer(changed: str | None) -> NDArray[np.float64]:
    """Its actions where a picture or the instruction is another one."""
    policy = make_policy("mini-libero")
    images = {camera.name: np.zeros((128, 128, 3), np.uint8) for camera in policy.spec.cameras}
    if changed in images:
        images[changed][40:80, 40:80] = 255
    text = f"pick up the {'milk' if changed == 'words' else 'ketchup'} and place it in the basket"
    policy.reset([EpisodeStart("one", text, "libero_object/0", 0)])
    return policy.act([Observation("one", 0, text, images=images, state=STATE)])[0].actions


def test_it_knows_all_words_of_nominal_instructions():
    known = read_card().words
    for task, wordings in load_wordings().items():
        for name in CATALOGUE.names():
            text = say(wordings[0], [CATALOGUE[name].spoken] * TASKS[task].targets)
            assert words.encode(text, known).max() <= len(known), text


def test_without_weights_it_says_what_is_missing(tmp_path):
    (tmp_path / CARD).write_text(json.dumps({}))
    with pytest.raises(PrerequisiteError, match=WEIGHTS):
        Mini(tmp_path)


def test_an_observation_without_a_picture_is_refused():
    mini = Mini()
    mini.reset([EpisodeStart("one", "pick up apple", "pick-up", 0)])
    with pytest.raises(PolicyError, match="needs a picture"):
        mini.act([Observation("one", 0, "pick up apple", state=STATE)])


def test_the_default_is_mini_where_something_renders_and_pinhole_where_nothing_does(monkeypatch):
    for problem, name in ((None, "mini"), ("no device", "pinhole")):
        found = Renderer(None, None, problem)
        monkeypatch.setattr("vlafuzz.worlds.tabletop.renderer.probe_once", lambda found=found: found)
        assert default_policy() == name


class TestWords:
    def test_a_word_that_training_has_not_seen_has_a_bucket_of_its_own_kind(self):
        known = ("apple", "pick", "up")
        coded = words.encode("Pick up the apple!", known)
        assert coded[:4].tolist() == [2, 3, coded[2], 1]
        assert words.KNOWN < coded[2] < words.SIZE
        assert not coded[4:].any()

    @given(st.text(max_size=400))
    def test_any_text_has_numbers(self, text):
        coded = words.encode(text, ("apple",))
        assert coded.shape == (words.LENGTH,)
        assert 0 <= coded.min() <= coded.max() < words.SIZE


class TestActions:
    def test_the_last_bins_are_the_farthest_moves_and_the_middle_is_none(self):
        ends = from_bins(torch.tensor([[0.0], [(BINS - 1) / 2], [BINS - 1.0]]).expand(3, 6))
        assert torch.allclose(ends, torch.tensor([-1.0, 0.0, 1.0])[:, None] * torch.tensor(FARTHEST))

    @given(st.lists(st.integers(0, BINS - 1), min_size=6, max_size=6))
    def test_a_sure_bin_is_its_value(self, places):
        index = torch.tensor(places)
        logits = torch.nn.functional.one_hot(index, BINS).double() * 1e3
        assert torch.allclose(decode(logits), from_bins(index.double()), atol=1e-6)

    def test_of_two_likely_places_one_is_chosen_not_their_middle(self):
        logits = torch.full((6, BINS), -9.0)
        logits[:, 10], logits[:, 50] = 2.0, 1.9
        assert torch.allclose(decode(logits), from_bins(torch.full((6,), 10.0)), atol=1e-3)

    def test_half_a_turn_of_the_hand_is_the_same_hand(self):
        turned = np.stack([STATE, STATE])
        turned[:, 3:6] = [[np.pi, 0, 0], [0, np.pi, 0]]  # both point down
        first, other = proprioception(turned, turned[:, 6], np.array([3, 3]))
        assert first == pytest.approx(other, abs=1e-6)


LARGEST = 4.0


@pytest.fixture(scope="module")
def conv() -> nn.Conv2d:
    torch.manual_seed(0)
    return nn.Conv2d(32, 48, 3, stride=2, padding=1)


@torch.inference_mode()
def error(conv: nn.Conv2d, x: torch.Tensor) -> float:
    """Mean difference from floating point, as a share of the mean answer."""
    wanted = conv(x)
    return float((IntegerConv(conv, LARGEST)(x) - wanted).abs().mean() / wanted.abs().mean())


def test_the_answer_is_that_of_floating_point_to_about_a_percent(conv):
    assert error(conv, torch.rand(2, 32, 16, 16) * LARGEST) < 0.02


def test_inputs_beyond_the_range_are_clipped(conv):
    x = torch.rand(1, 32, 16, 16) * 3 * LARGEST
    integer = IntegerConv(conv, LARGEST)
    assert torch.equal(integer(x), integer(x.clamp(max=LARGEST)))
    assert error(conv, x) > 0.1


def test_processors_without_integers_compute_the_same(conv):
    if not exact():
        pytest.skip("this processor has none")
    integer, whole = IntegerConv(conv, LARGEST), torch.randint(LEVELS, (1, 32, 16, 16), dtype=torch.uint8)
    assert torch.allclose(integer.fast(whole), integer.slow(whole), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(("code", "answer"), [(0, True), (1, False), (-11, False)])
def test_integers_are_used_where_a_process_survived_their_trial_with_right_sums(monkeypatch, tmp_path, code, answer):
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path))
    monkeypatch.setattr(subprocess, "run", lambda command, **_: subprocess.CompletedProcess(command, code, "", ""))
    assert exact.__wrapped__() is answer
    monkeypatch.setattr(subprocess, "run", lambda command, **_: pytest.fail("it is tried once"))
    assert exact.__wrapped__() is answer


def test_the_card_has_a_range_of_every_large_convolution_but_the_one_that_sees_the_picture():
    network = Network()
    convolutions = {name: layer for name, layer in network.named_modules() if isinstance(layer, nn.Conv2d)}
    large = {name for name, layer in convolutions.items() if layer.kernel_size == (3, 3)}
    to_integers(network, read_card().ranges)
    assert read_card().ranges.keys() == large
    assert not large & {name for name, _ in network.named_modules()}
