#!/usr/bin/env python
"""Train `mini` on the demonstrations of make_demos.py; writes weights and the model card.

Behaviour cloning: cross entropy over softened bins, the gripper as one bit, and the positions of a, b and the hand as
auxiliary tasks. A GPU takes minutes; the schedule ends at --updates or --seconds, whichever comes first. --init
continues from the weights of an earlier round, --replay with some of what those learned from.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from mini_data import Data, load
from safetensors.torch import load_file, save_file
from torch import Tensor
from torch.nn import functional

from vlafuzz.policies.mini.model import BINS, FARTHEST, Network, decode
from vlafuzz.policies.mini.policy import CARD, WEIGHTS

SOFT = 1.0  # bins, standard deviation of a label
RATE, DECAY, WARM_UP, AVERAGED = 1e-3, 0.05, 300, 0.999
VERSION = "2"
WATCHED = 3  # keypoints that lie on a, b and the hand


def jitter(pictures: Tensor) -> Tensor:
    """Slightly vary brightness, contrast and saturation of each image."""
    count, device = len(pictures), pictures.device
    gain, contrast, colour = (1 + 0.2 * (torch.rand(3, count, 1, 1, 1, device=device) * 2 - 1)).unbind()
    views = pictures.reshape(count, -1, 3, *pictures.shape[2:])
    grey = views.mean(2, keepdim=True)
    views = grey + (views - grey) * colour[..., None]
    mean = views.mean((1, 2, 3, 4), keepdim=True)
    varied = (mean + (views - mean) * contrast[..., None]) * gain[..., None]
    return varied.clamp(0, 1).reshape(pictures.shape)


def to_bins(actions: Tensor) -> Tensor:
    """``(..., 6)`` metric deltas to bin coordinates in [0, BINS - 1], not rounded: the inverse of ``from_bins``."""
    share = actions / torch.tensor(FARTHEST, device=actions.device)
    bent = share.abs().clamp(max=1.0).sqrt() * share.sign()
    return (bent + 1) / 2 * (BINS - 1)


def loss_of(predicted: dict[str, Tensor], data: Data, index: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
    weights = data.weights[index]
    wanted = to_bins(data.moves[index])[..., None]
    soft = (-0.5 * ((torch.arange(BINS, device=wanted.device) - wanted) / SOFT) ** 2).softmax(-1)
    moves = -(soft * predicted["moves"].float().log_softmax(-1)).sum(-1).mean(-1)
    grip = functional.binary_cross_entropy_with_logits(
        predicted["gripper"].float(), data.gripper[index], reduction="none"
    )
    shown = data.shown[index]
    points = (predicted["points"][:, :WATCHED].float() - data.pixels[index]).abs().sum(-1)
    there = torch.stack([torch.ones_like(shown[:, 1]), shown[:, 1]], dim=1)
    places = (predicted["places"].float() - data.places[index]).abs().sum(-1)
    parts = {
        "moves": (moves * weights).sum() / weights.sum(),
        "grip": (grip * weights).sum() / weights.sum(),
        "points": (points * shown).sum() / shown.sum(),
        "places": (places * there).sum() / there.sum(),
    }
    return parts["moves"] + parts["grip"] + 2 * parts["points"] + 2 * parts["places"], parts


def validate(network: torch.nn.Module, data: Data) -> dict[str, float]:
    """Mean losses over the held-out steps, and the error of the first action in millimetres."""
    index = data.rest["held_out"][:8192]
    sums: dict[str, float] = {}
    with torch.inference_mode():
        for part in index.split(1024):
            pictures = data.frames[part].permute(0, 3, 1, 2).float() / 255
            predicted = network(pictures, data.tokens[part], data.state[part])
            _, parts = loss_of(predicted, data, part)
            off = (decode(predicted["moves"].float())[:, 0, :3] - data.moves[part][:, 0, :3]).norm(dim=-1)
            right = ((predicted["gripper"][:, 0] > 0) == (data.gripper[part][:, 0] > 0)).float()
            for name, value in {**parts, "off_mm": 1e3 * off.mean(), "gripper_right": right.mean()}.items():
                sums[name] = sums.get(name, 0.0) + float(value) * len(part) / len(index)
    return {name: round(value, 4) for name, value in sums.items()}


class Learner:
    """A network, the moving average of its weights, and the optimiser."""

    def __init__(self, options: argparse.Namespace, device: str, views: int) -> None:
        self.options, self.device = options, device
        self.network = Network(views).to(device)
        if options.init:
            known = load_file(options.init / WEIGHTS).items()
            self.network.load_state_dict({name: value.float() for name, value in known})
        self.average = {name: value.clone() for name, value in self.network.state_dict().items()}
        self._fast = torch.compile(self.network) if device == "cuda" else self.network
        self._optimizer = torch.optim.AdamW(self.network.parameters(), lr=options.rate, weight_decay=DECAY)
        self.updates = 0

    def learn(self, data: Data, index: Tensor, done: float) -> None:
        """One update on these steps; ``done`` in [0, 1] is the progress of the schedule."""
        warm = min(1.0, (self.updates + 1) / WARM_UP)
        for group in self._optimizer.param_groups:
            group["lr"] = self.options.rate * warm * 0.5 * (1 + math.cos(math.pi * done))
        pictures = jitter(data.frames[index].permute(0, 3, 1, 2).float() / 255)
        with torch.autocast(self.device, dtype=torch.bfloat16, enabled=self.device == "cuda"):
            predicted = self._fast(pictures, data.tokens[index], data.state[index])
        loss, _ = loss_of(predicted, data, index)
        self._optimizer.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self._optimizer.step()
        kept = min(AVERAGED, (1 + self.updates) / (10 + self.updates))
        with torch.no_grad():
            torch._foreach_lerp_(list(self.average.values()), list(self.network.state_dict().values()), 1 - kept)
        self.updates += 1

    @contextmanager
    def averaged(self) -> Iterator[Network]:
        """The network with its averaged weights, within the block."""
        own = {name: value.clone() for name, value in self.network.state_dict().items()}
        self.network.load_state_dict(self.average)
        yield self.network.eval()
        self.network.load_state_dict(own)
        self.network.train()


def train(data: Data, options: argparse.Namespace, device: str) -> None:
    """Train until the budget is spent; writes at every validation, so that a stop loses little."""
    torch.manual_seed(options.seed)
    torch.set_float32_matmul_precision("high")
    learner = Learner(options, device, data.views)
    began = time.monotonic()
    curve: list[dict[str, float]] = []
    done = 0.0
    while done < 1:
        learner.learn(data, data.drawn(options.batch, options.share), done)
        seconds = time.monotonic() - began
        done = max(learner.updates / options.updates, seconds / options.seconds)
        if learner.updates % options.every == 0 or done >= 1:
            with learner.averaged() as network:
                figures = validate(network, data)
                curve.append({"update": learner.updates, "seconds": round(seconds), **figures})
                write(network, data, curve, options)
            print(json.dumps(curve[-1]), flush=True)


def write(network: Network, data: Data, curve: list[dict[str, float]], options: argparse.Namespace) -> None:
    options.out.mkdir(parents=True, exist_ok=True)
    half = {name: value.detach().half().cpu().contiguous() for name, value in network.state_dict().items()}
    save_file(half, options.out / WEIGHTS)
    content = hashlib.sha256((options.out / WEIGHTS).read_bytes()).hexdigest()[:20]
    before = json.loads((options.init / CARD).read_text())["rounds"] if options.init else []
    card = {
        "name": "mini",
        "version": VERSION,
        "note": "A demonstration policy, trained by us in this simulator with little randomisation. "
        "It is not evidence about OpenVLA, pi0 or any other model.",
        "weights": content,
        "parameters": sum(value.numel() for value in half.values()),
        "rounds": [*before, _round(data, curve, options)],
        "words": list(data.rest["words"]),
        **data.rest["card"],
    }
    (options.out / CARD).write_text(json.dumps(card, indent=1) + "\n")


def _round(data: Data, curve: list[dict[str, float]], options: argparse.Namespace) -> dict[str, Any]:
    """The record of one training: data, recipe, learning curve."""
    return {
        "data": {key: data.rest[key] for key in ("hash", "episodes", "frames")},
        "recipe": {
            "updates": curve[-1]["update"],
            "batch": options.batch,
            "rate": options.rate,
            "weight_decay": DECAY,
            "averaged": AVERAGED,
            "seed": options.seed,
            "replayed": options.share if options.replay else 0.0,
        },
        "curve": curve,
    }


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("demos", type=Path, help="folder that make_demos.py wrote")
    parser.add_argument("--out", type=Path, required=True, help="folder for weights and card")
    parser.add_argument("--init", type=Path, help="folder of weights and card to continue from")
    parser.add_argument("--replay", type=Path, help="folder of earlier demonstrations, not to be forgotten")
    parser.add_argument("--share", type=float, default=0.5, help="share of each batch that is replayed")
    parser.add_argument("--rate", type=float, default=RATE, help="learning rate")
    parser.add_argument("--updates", type=int, default=7500)
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument("--batch", type=int, default=1024)
    parser.add_argument("--every", type=int, default=1000, help="updates between validations")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    device = "cuda" if torch.cuda.is_available() else "cpu"
    began = time.monotonic()
    known = tuple(json.loads((options.init / CARD).read_text())["words"]) if options.init else ()
    data = load(options.demos, device, known, options.replay)
    print(
        json.dumps(
            {
                "frames": data.rest["frames"],
                "episodes": data.rest["episodes"],
                "loaded": round(time.monotonic() - began),
            }
        ),
        flush=True,
    )
    train(data, options, device)


if __name__ == "__main__":
    main()
