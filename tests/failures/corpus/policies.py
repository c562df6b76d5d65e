"""Policies with a known weakness, for `python:tests.failures.corpus.policies:NAME`."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from shutil import copy
from tempfile import mkdtemp

import numpy as np
import torch
from safetensors.torch import load_file, save_file

from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.mini.policy import CARD, SHIPPED, WEIGHTS, Mini
from vlafuzz.worlds.tabletop.experts.expert import Expert

STAY = np.array([[0.0] * 6 + [1.0]])


class Flaky(Expert):
    """An expert that does nothing in 30 % of its episodes, whatever the seed."""

    def __init__(self) -> None:
        super().__init__()
        self.spec = replace(self.spec, name="flaky", deterministic=False)
        self._rng, self._idle = np.random.default_rng(), False

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._idle = bool(self._rng.random() < 0.3)
        super().reset(episodes)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(STAY)] if self._idle else super().act(observations)


def zeroed() -> Mini:
    """`mini` with a tenth of its weights set to zero."""
    folder, generator = Path(mkdtemp()), torch.Generator().manual_seed(0)
    copy(SHIPPED / CARD, folder)
    weights = load_file(SHIPPED / WEIGHTS)
    for values in weights.values():
        values[torch.rand(values.shape, generator=generator) < 0.1] = 0.0
    save_file(weights, folder / WEIGHTS)
    return Mini(folder)
