"""Mini as a policy: weights and model card from a folder, images and words in, metric actions out.

Torch, which takes a second to import, is loaded when the network is first asked: a process that leaves the rollouts to
workers needs the spec only.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from vlafuzz.common.reading import MIB, read_bytes, read_json, validated
from vlafuzz.errors import PolicyError, PrerequisiteError, UsageError
from vlafuzz.policies.base import ActionChunk, ActionSpec, CameraRequest, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.mini.words import KNOWN, encode

if TYPE_CHECKING:
    from vlafuzz.policies.mini.model import Network, Told

SHIPPED = Path(__file__).parent
WEIGHTS, CARD = "weights.safetensors", "policy.json"
CAMERA = CameraRequest("front", 128, 128)
WRIST = CameraRequest("wrist", 128, 128, role="wrist")
REMEMBERED = 1000  # instructions
MOST_WEIGHTS = 64 * MIB  # bytes; ours have 6.5 MB
_HINT = "scripts/train_mini.py makes a card and weights; a complete wheel has ours"


class Card(BaseModel):
    """What is read of a model card.

    Attributes:
        weights: digest of their file.
        words: the vocabulary.
        views: number of cameras.
        action: what its numbers mean, as in ``ActionSpec``; without it, moves from the hand's current pose in metres.
        ranges: the largest inputs of convolutions that are done in integers.
    """

    name: Annotated[str, Field(min_length=1, max_length=200)]
    version: Annotated[str, Field(min_length=1, max_length=200)]
    weights: str
    words: Annotated[tuple[str, ...], Field(max_length=KNOWN)]
    views: Annotated[int, Field(ge=1, le=2)] = 1
    action: Mapping[str, str | int | float] = {}
    ranges: Mapping[str, Annotated[float, Field(gt=0, allow_inf_nan=False)]] = {}

    def spec(self, where: Path) -> ActionSpec:
        """What the numbers of an action mean; a UsageError if the card in ``where`` says what is unknown."""
        try:
            return ActionSpec(**{"relative_to": "current", **self.action})  # type: ignore[arg-type]
        except TypeError as error:
            raise UsageError(f"{where}: action: {error}", _HINT) from None


@dataclass
class Memory:
    """State of a rollout: the last opening, the gripper's command, and the steps since it changed."""

    opening: NDArray[np.float32]
    since: int
    command: float = 1.0


class Mini:
    """A small learned vision-language-action model that runs on a CPU; mini:FOLDER has other weights.

    It was trained in these very simulators: something to try a fuzzer on, no evidence about other models. Observations
    go through the network one at a time, since batching would change the last bits.
    """

    def __init__(self, folder: Path = SHIPPED) -> None:
        self._folder = folder
        self._card = read_card(folder)
        self.spec = PolicySpec(
            self._card.name,
            version=self._card.version,
            action=self._card.spec(folder / CARD),
            cameras=(CAMERA, WRIST)[: self._card.views],
            state=True,
            max_batch=64,
            provenance={"weights": self._card.weights},
        )
        self._told: dict[str, Told] = {}
        self._memory: dict[str, Memory] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        for episode in episodes:
            self._memory.pop(episode.episode, None)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """One chunk per observation, of which the first action is to be executed."""
        return [self._act(observation) for observation in observations]

    def close(self) -> None:
        self._memory.clear()

    @cached_property
    def _network(self) -> Network:
        import torch
        from safetensors.torch import load

        from vlafuzz.policies.mini.integer import to_integers
        from vlafuzz.policies.mini.model import Network

        path = self._folder / WEIGHTS
        data = read_bytes(path, UsageError, most=MOST_WEIGHTS, inside=self._folder)
        network = Network(len(self.spec.cameras)).eval()
        try:
            network.load_state_dict({name: value.float() for name, value in load(data).items()})
            to_integers(network, self._card.ranges)
        except Exception as error:  # safetensors and torch raise many types
            raise UsageError(f"{path}: not the weights that {CARD} describes: {error}", _HINT) from None
        torch.set_num_threads(1)  # more would change the last bits, and there are many workers
        return network

    def _act(self, seen: Observation) -> ActionChunk:
        import torch

        from vlafuzz.policies.mini.model import HORIZON, LONG, decode, proprioception

        names = [camera.name for camera in self.spec.cameras]
        if not seen.images.keys() >= set(names) or seen.state is None:
            raise PolicyError("mini needs a picture and proprioception, and got none", cause="protocol")
        known = self._memory.setdefault(seen.episode, Memory(seen.state[6:], LONG))
        state = proprioception(seen.state[None], known.opening, np.array([known.since]))
        joined = np.concatenate([seen.images[name] for name in names], axis=2)
        picture = torch.from_numpy(joined)[None].permute(0, 3, 1, 2)
        with torch.inference_mode():
            told = self._read(seen.instruction)
            output = self._network.act(picture.float().div_(255), told, torch.from_numpy(state))
            moves = decode(output["moves"])[0].numpy()
        actions = np.ones((HORIZON, 7))
        actions[:, :6] = moves
        actions[:, 6] = np.where(output["gripper"][0].numpy() > 0, 1.0, -1.0)
        command = float(actions[0, 6])
        since = known.since + 1 if command == known.command else 1
        self._memory[seen.episode] = Memory(seen.state[6:], since, command)
        return ActionChunk(actions)

    def _read(self, instruction: str) -> Told:
        import torch

        if instruction not in self._told:
            if len(self._told) == REMEMBERED:
                self._told.clear()
            tokens = torch.from_numpy(encode(instruction, self._card.words))[None]
            self._told[instruction] = self._network.read(tokens)
        return self._told[instruction]


def read_card(folder: Path = SHIPPED) -> Card:
    """The model card beside the weights; PrerequisiteError if one is missing, UsageError if the card is damaged."""
    for name in (CARD, WEIGHTS):
        if not os.path.lexists(folder / name):
            raise PrerequisiteError(f"{folder / name}: not there", _HINT)
    path = folder / CARD
    return validated(Card, read_json(path, UsageError, _HINT, inside=folder), path, UsageError, _HINT)
