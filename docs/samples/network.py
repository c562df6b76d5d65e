"""A policy of docs/servers.md: a network that sees pictures and answers several observations at once."""

import numpy as np
import torch

from vlafuzz.policies.base import ActionChunk, ActionSpec, CameraRequest, PolicySpec


class Network:
    spec = PolicySpec(
        "network",
        cameras=(CameraRequest("front", 128, 128),),
        state=True,  # hand: x, y, z in metres, and more
        action=ActionSpec(relative_to="current"),
        max_batch=16,
    )

    def __init__(self):  # your network and its weights here
        torch.manual_seed(0)
        self.eyes = torch.nn.Sequential(torch.nn.Conv2d(3, 8, 8, 8), torch.nn.ReLU(), torch.nn.Flatten())
        self.hand = torch.nn.Linear(8 * 16 * 16, 7)

    def reset(self, episodes):  # these rollouts begin: forget what was kept of them
        pass

    def act(self, observations):  # seen.instruction, seen.state and seen.step are there, too
        pictures = np.stack([seen.images["front"] for seen in observations])  # (n, 128, 128, 3) uint8
        with torch.inference_mode():
            seen = torch.from_numpy(pictures).permute(0, 3, 1, 2) / 255
            moves = 0.02 * torch.tanh(self.hand(self.eyes(seen)))  # metres, radians; the gripper last
        return [ActionChunk(move[None]) for move in moves.double().numpy()]

    def close(self):
        pass


make = Network
