"""Policies of lerobot: messages without it; with it, tiny policies against lerobot's own evaluation.

lerobot 0.4.4 wants another torch than ours, so it is not among our packages; name the Python of an environment in which
it is. python -m venv there; there/bin/pip install torch==2.13.0 pydantic scipy trimesh pyyaml
einops draccus==0.10.0 'huggingface-hub<0.36' 'datasets<5' 'diffusers<0.36' accelerate gymnasium 'transformers<5'
'av<16' jsonlines 'deepdiff<9' 'opencv-python-headless<4.13' termcolor imageio num2words 'packaging<26' pyserial;
there/bin/pip install --no-deps lerobot==0.4.4 torchvision==0.28.0; VLAFUZZ_LEROBOT=there/bin/python scripts/test -m
slow
"""

import json
import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.policies.clients.lerobot import LeRobot, LeRobotOptions, fitted
from vlafuzz.policies.clients.servers import parse
from vlafuzz.rollouts.policies import make_policy

THERE = os.environ.get("VLAFUZZ_LEROBOT")
ROOT = Path(__file__).parents[3]
FRONT, WRIST = "observation.images.image", "observation.images.image2"
DEAF = {"other words"}


def config(pictures: dict, state: int = 8, actions: int = 7, **more: Any) -> SimpleNamespace:
    """What is read of a ``PreTrainedConfig``; ``pictures``: width and height by key."""

    def feature(*shape: int) -> SimpleNamespace | None:
        return SimpleNamespace(shape=shape) if all(shape) else None

    features = {
        "image_features": {key: feature(3, height, width) for key, (width, height) in pictures.items()},
        "robot_state_feature": feature(state),
        "action_feature": feature(actions),
        "env_state_feature": None,
    }
    usual = {"type": "act", "n_obs_steps": 1, "n_action_steps": 5, "device": "cpu"}
    return SimpleNamespace(**features | usual | more)


BOTH = {FRONT: (96, 64), WRIST: (32, 32)}
ACT, STEPWISE = config(BOTH), config(BOTH, type="diffusion", n_action_steps=8, n_obs_steps=2)


def options(query: str) -> LeRobotOptions:
    return parse(f"lerobot:/policies/mine?{query}", LeRobot).options


def fit(query: str, of: SimpleNamespace = ACT) -> LeRobotOptions:
    return fitted("it", options(query), of)


class TestNames:
    def test_a_folder_and_options(self):
        address = parse("lerobot:~/a b/policy?device=cuda:1&hz=20", LeRobot)
        assert (address.name, address.url) == ("lerobot:~/a b/policy", "~/a b/policy")
        assert (address.options.device, address.options.hz) == ("cuda:1", 20)

    @pytest.mark.parametrize("inner", [None, "pretrained_model", "checkpoints/last/pretrained_model"])
    def test_a_folder_without_a_policy_or_of_lerobots_trainer(self, tmp_path, inner):
        if inner:
            (tmp_path / inner).mkdir(parents=True)
            (tmp_path / inner / "config.json").write_text("{}")
        with pytest.raises(UsageError, match=r"no config\.json there") as caught:
            make_policy(f"lerobot:{tmp_path}?state=1")
        there = f"lerobot:{tmp_path / inner}" if inner else "name the folder that lerobot saved"
        assert caught.value.hint == there

    def test_a_folder_that_is_not_there(self, tmp_path):
        with pytest.raises(UsageError, match="no such folder"):
            make_policy(f"lerobot:{tmp_path / 'missing'}")

    def test_without_lerobot_it_says_what_to_install(self, tmp_path, monkeypatch):
        (tmp_path / "config.json").write_text("{}")
        monkeypatch.setitem(sys.modules, "lerobot", None)
        with pytest.raises(PrerequisiteError, match="needs the package 'lerobot") as caught:
            make_policy(f"lerobot:{tmp_path}")
        assert caught.value.hint == "pip install lerobot, into the environment of vlafuzz"


class TestFitting:
    """A policy's config is combined with the options."""

    def test_pictures_have_the_sizes_that_the_policy_takes(self):
        options = fit("profile=libero")
        assert (options.camera, options.wrist_camera) == ((96, 64), (32, 32))
        assert (options.image_key, options.wrist_key, options.execute) == (FRONT, WRIST, 5)

    def test_names_may_be_short(self):
        options = fit("state=eef_pos3_axisangle3_gripper2&image_key=image2&wrist=1&wrist_key=image")
        assert (options.image_key, options.wrist_key) == (WRIST, FRONT)

    @pytest.mark.parametrize("key", ["observation.image", FRONT])
    def test_an_only_picture_needs_no_name_and_empty_cameras_are_not_asked_for(self, key):
        pictures = {key: (96, 96), "observation.images.empty_camera_0": (9, 9)}
        assert fit("hz=10", config(pictures, state=0, type="smolvla")).image_key == key

    def test_a_policy_that_remembers_sees_every_step(self):
        assert fit("profile=libero", STEPWISE).execute == 1

    @pytest.mark.parametrize(("device", "same"), [("cpu", True), ("cuda", False)])
    def test_on_a_cpu_it_repeats_itself(self, device, same):
        assert fit("profile=libero", config(BOTH, device=device)).deterministic is same

    @pytest.mark.parametrize(
        ("query", "of", "says"),
        [
            ("state=0", ACT, "takes the pictures image, image2, the options name image"),
            ("profile=libero&state=1", ACT, "8 numbers of state, state=eef_pos3_axisangle3_gripper1 has 7"),
            ("profile=libero&state=0", ACT, "takes 8 numbers of state, state=0 has 0"),
            ("profile=libero", config(BOTH, actions=14), "its actions have 14 numbers"),
            ("profile=libero&execute=4", STEPWISE, "remembers past"),
        ],
    )
    def test_what_does_not_go_together_is_refused(self, query, of, says):
        with pytest.raises(UsageError, match=says) as caught:
            fit(query, of)
        assert caught.value.hint


COMPARE = """
import contextlib, json, sys
from tiny_policies import SIDE, torch
import numpy as np
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors
from lerobot.policies.utils import prepare_observation_for_inference
from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.policies.clients.conventions import LAYOUTS
from vlafuzz.policies.harness import PartlyAnsweredError
from vlafuzz.rollouts.policies import make_policy

folder, stepwise = sys.argv[1], sys.argv[2] == "diffusion"
policy = make_policy(f"lerobot:{folder}?profile=libero&device=cpu")
rng = np.random.default_rng(0)
images = {name: rng.integers(0, 256, (SIDE, SIDE, 3), dtype=np.uint8) for name in ("front", "wrist")}
state = np.array([0.1, -0.2, 0.3, 3.0, 0.5, 0.0, 0.5], dtype=np.float32)

def seen(episode, step, words="pick up apple", pictures=images):
    return Observation(episode, step, words, images=pictures, state=state + np.float32(step / 10))

def ours(episode, seed, *steps, **more):
    policy.reset([EpisodeStart(episode, "pick up apple", "pick-up", seed)])
    return [policy.act([seen(episode, step, **more)])[0].actions.tolist() for step in steps]

def theirs(seed, *steps):
    config = PreTrainedConfig.from_pretrained(folder)
    with contextlib.redirect_stdout(sys.stderr):
        policy = get_policy_class(config.type).from_pretrained(folder, config=config).eval()
    before, after = make_pre_post_processors(config, folder)
    policy.reset()
    found = []
    for step in steps:
        now = seen("it", step)
        told = {f"observation.images.{key}": now.images[name].copy()
                for key, name in (("image", "front"), ("image2", "wrist"))}
        told["observation.state"] = LAYOUTS["eef_pos3_axisangle3_gripper2"](now.state)
        torch.manual_seed(int(np.random.SeedSequence([seed, step]).generate_state(1)[0]))
        batch = before(prepare_observation_for_inference(told, torch.device("cpu"), task=now.instruction))
        with torch.inference_mode():
            chosen = after((policy.select_action if stepwise else policy.predict_action_chunk)(batch))
        found.append(chosen.reshape(-1, 7).numpy().astype(float).tolist())
    return found

def interleaved():
    policy.reset([EpisodeStart(name, "pick up apple", "pick-up", ord(name)) for name in "abc"])
    found = []
    for step in range(6):
        pair = [seen("a", step), seen("b", step, pictures={name: 255 - one for name, one in images.items()})]
        found.append(policy.act(pair if step % 2 else pair[::-1])[step % 2 == 0].actions.tolist())
        try:  # the error of one costs the other nothing
            policy.act([seen("c", step), seen("b", step, pictures={})])
        except PartlyAnsweredError as partly:
            assert [type(answer).__name__ for answer in partly.answers] == ["ActionChunk", "PolicyError"]
    return found

black = {name: np.zeros_like(picture) for name, picture in images.items()}
print(json.dumps({
    "spec": [policy.spec.execute, policy.spec.deterministic, [c.width for c in policy.spec.cameras]],
    "ours": ours("it", 97, *range(6)), "theirs": theirs(97, *range(6)), "interleaved": interleaved(),
    "other seed": ours("it", 98, *range(6)), "black": ours("it", 97, *range(6), pictures=black),
    "other words": ours("it", 97, *range(6), words="put it on the plate"),
}))
"""


def there(script: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a script in lerobot's environment."""
    path = f"{ROOT}{os.pathsep}{Path(__file__).parent}"
    environment = os.environ | {"PYTHONPATH": path, "HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"}
    command = [THERE, "-c", script, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, env=environment)


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    """``policy(kind)``: the folder of a tiny policy."""

    @cache
    def make(kind: str) -> Path:
        folder = tmp_path_factory.mktemp("policies") / kind
        creation = there("from tiny_policies import make; import pathlib, sys;"
                     "make(sys.argv[1], pathlib.Path(sys.argv[2]))", kind, folder)  # fmt: skip
        assert creation.returncode == 0, creation.stderr
        return folder

    return make


@pytest.mark.slow
@pytest.mark.skipif(THERE is None, reason="VLAFUZZ_LEROBOT names no Python with lerobot")
class TestReal:
    """Policies of 0.2 to 12 million random weights, loaded and run by lerobot 0.4.4."""

    @pytest.mark.parametrize(
        ("kind", "execute", "length", "ignores"),
        [("act", 5, 10, DEAF | {"other seed"}), ("diffusion", 1, 1, DEAF), ("smolvla", 5, 10, set())],
    )
    def test_answers_as_lerobot_itself_does(self, policy, kind, execute, length, ignores):
        done = there(COMPARE, policy(kind), kind)
        assert done.returncode == 0, done.stderr
        answers = json.loads(done.stdout)  # nothing else is printed there
        assert answers["spec"] == [execute, True, [96, 96]]
        assert [len(chunk) for chunk in answers["ours"]] == [length] * 6
        assert answers["ours"] == answers["theirs"] == answers["interleaved"]
        for other in ("other seed", "black", "other words"):
            assert (answers[other] == answers["ours"]) is (other in ignores), other

    def test_weights_that_are_none_are_told_in_a_sentence(self, policy, tmp_path):
        folder = shutil.copytree(policy("smolvla"), tmp_path / "broken")
        (folder / "model.safetensors").write_bytes(b"none")
        script = "from tiny_policies import torch; import sys;"
        script += "from vlafuzz.rollouts.policies import make_policy; make_policy(sys.argv[1])"
        done = there(script, f"lerobot:{folder}?profile=libero")
        assert "UsageError: lerobot:" in done.stderr
        assert "lerobot cannot load it: SafetensorError" in done.stderr
