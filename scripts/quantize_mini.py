#!/usr/bin/env python
"""Let `mini` compute in 8-bit integers: measures what goes into its convolutions, and notes it in the card.

Rolls out nominal and random scenes in floating point. The range of a layer is half as large again as the
99.99th percentile of its inputs, and what is beyond is clipped; the weights' file stays as it is.
"""

from __future__ import annotations

import argparse
import json
import os
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from eval_mini import draw
from torch import nn
from train_mini import VERSION

from vlafuzz.model import Conditions, Verdict
from vlafuzz.policies.mini.policy import CARD, SHIPPED, Mini
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator
from vlafuzz.worlds.tabletop.tasks import TASKS

SEEDS = 3 * 10**6  # neither of demonstrations nor of evaluations
DRAWN = 500  # inputs of a layer in each step
PERCENTILE, REACH = 99.99, 1.5


class Watched(Mini):
    """Keeps a few inputs of every 3 × 3 convolution in ``inputs``."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.inputs: dict[str, list[Any]] = defaultdict(list)
        for name, layer in self._network.named_modules():
            if isinstance(layer, nn.Conv2d) and layer.kernel_size == (3, 3):
                layer.register_forward_pre_hook(lambda _, known, name=name: self._keep(name, known[0]))

    def _keep(self, name: str, known: torch.Tensor) -> None:
        index = torch.randint(known.numel(), (DRAWN,))
        self.inputs[name].append(known.flatten()[index].numpy())

    def ranges(self) -> dict[str, float]:
        tops = {name: np.percentile(np.concatenate(drawn), PERCENTILE) for name, drawn in self.inputs.items()}
        return {name: round(REACH * float(top), 2) for name, top in tops.items()}


def roll(policy: Mini, task: str, kind: str, scenes: int) -> None:
    conditions = Conditions(task=task, world={"min_distance": 0.15}, stop_early=True)
    evaluator = ManiSkillEvaluator(conditions, policy, load_catalogue())
    seed, rolled = SEEDS, 0
    while rolled < scenes:
        (outcome,) = evaluator.evaluate([draw(task, kind, seed)])
        seed, rolled = seed + 1, rolled + (outcome.verdict >= Verdict.PASSED)
    evaluator.renew()


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--weights", type=Path, default=SHIPPED, help="folder of weights and card")
    parser.add_argument("--scenes", type=int, default=10, help="per task and set")
    options = parser.parse_args()
    os.environ.update({"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"})
    torch.manual_seed(0)
    card = json.loads((options.weights / CARD).read_text())
    card.pop("ranges", None)
    path = options.weights / CARD
    path.write_text(json.dumps(card, indent=1) + "\n")  # without ranges it computes in floating point
    policy = Watched(options.weights)
    for task in TASKS:
        for kind in ("nominal", "random"):
            roll(policy, task, kind, options.scenes)
    card |= {"version": VERSION, "ranges": policy.ranges()}
    path.write_text(json.dumps(card, indent=1) + "\n")
    print(json.dumps(card["ranges"]))


if __name__ == "__main__":
    main()
