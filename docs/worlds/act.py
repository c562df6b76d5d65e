"""A policy that learns from a world's expert: LeRobot's ACT on the numbers of the observation, with lerobot 0.4.4.

``python act.py train fetch:Fetch push --vary block goal`` trains it; ``--policy python:act:Act`` tests it.
"""

import argparse
import hashlib
import os
import pkgutil
from pathlib import Path

import numpy as np
import torch
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.factory import make_pre_post_processors

from vlafuzz.model import Monitor
from vlafuzz.policies.base import ActionChunk, ActionSpec, PolicySpec

SEEN = {"observation.state": FeatureType.STATE, "observation.environment_state": FeatureType.ENV}  # ACT wants both
CHUNK, FOLDER = 10, os.environ.get("ACT_FOLDER", "act-policy")
SMALL = {"dim_model": 128, "n_heads": 4, "dim_feedforward": 256, "n_encoder_layers": 2, "use_vae": False, "dropout": 0}
SCALED = dict.fromkeys(("STATE", "ENV", "ACTION"), "MEAN_STD")


def demonstrations(world, task, episodes, vary=()):
    """Of random scenes that the expert solves: what it sees at each step, its next actions, and which of them pad."""
    space, world, rng = world.space(task, world.robots[0], vary=vary), world.opened(task), np.random.default_rng(0)
    for _ in range(episodes):
        now = world.reset(world.values_in(space.sample(rng)), int(rng.integers(2**31)))
        seen, done, success = [], [], Monitor(tuple(world.stages))
        while not success.success_now and len(done) < world.horizon and not world.ended(now):
            seen.append(world.observe(now).astype(np.float32))
            done.append(np.ravel(world.solve(now)).astype(np.float32))
            now = world.step(now, done[-1])
            success.observe(now)
        if success.success_now:
            ahead = np.add.outer(np.arange(len(done)), np.arange(CHUNK))
            yield np.array(seen), np.array(done)[ahead.clip(max=len(done) - 1)], ahead >= len(done)


def train(shown, folder, updates):
    """Train on demonstrations, and save the policy with the means and deviations that scale its numbers."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    seen, chunks, padding = (torch.tensor(np.concatenate(part)) for part in zip(*shown, strict=True))
    inputs = {key: PolicyFeature(kind, seen.shape[1:]) for key, kind in SEEN.items()}
    outputs = {"action": PolicyFeature(FeatureType.ACTION, chunks.shape[2:])}
    about = {"chunk_size": CHUNK, "n_action_steps": CHUNK, "device": "cpu", "normalization_mapping": SCALED}
    config = ACTConfig(input_features=inputs, output_features=outputs, **about, **SMALL)
    parts = dict.fromkeys(SEEN, seen) | {"action": chunks[:, 0]}
    stats = {key: {"mean": part.mean(0), "std": part.std(0).clamp(min=1e-3)} for key, part in parts.items()}
    policy, pipelines = ACTPolicy(config).train(), make_pre_post_processors(config, dataset_stats=stats)
    optimizer = torch.optim.AdamW(policy.parameters(), lr=1e-3)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, updates)
    for _ in range(updates):
        some = torch.randint(len(seen), (64,))
        batch = dict.fromkeys(SEEN, seen[some]) | {"action": chunks[some], "action_is_pad": padding[some]}
        loss = policy(pipelines[0](batch))[0]
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        slower.step()
    for part in (policy, *pipelines):
        part.save_pretrained(folder)


class Act:
    """The policy in the folder that ``ACT_FOLDER`` names; it acts in chunks."""

    def __init__(self):
        torch.set_num_threads(1)
        self.policy = ACTPolicy.from_pretrained(FOLDER).eval()
        self.before, self.after = make_pre_post_processors(self.policy.config, FOLDER)
        weights = hashlib.sha256(Path(FOLDER, "model.safetensors").read_bytes()).hexdigest()[:12]
        width = ActionSpec(width=self.policy.config.action_feature.shape[0])
        self.spec = PolicySpec("act", version=weights, action=width, state=True, execute=CHUNK)

    def reset(self, episodes): ...

    def act(self, observations):
        batches = (self.before(dict.fromkeys(SEEN, torch.tensor(seen.state))) for seen in observations)
        answers = (self.after(self.policy.predict_action_chunk(batch))[0] for batch in batches)
        return [ActionChunk(answer.numpy().astype(float).clip(-1, 1)) for answer in answers]

    def close(self): ...


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for name in ("train", "world", "task"):
        parser.add_argument(name)
    parser.add_argument("--vary", nargs="*", default=())
    for name, default in (("--episodes", 100), ("--updates", 1200), ("--out", FOLDER)):
        parser.add_argument(name, type=type(default), default=default)
    told = parser.parse_args()
    world = pkgutil.resolve_name(told.world)()
    train([*demonstrations(world, told.task, told.episodes, told.vary)], told.out, told.updates)
