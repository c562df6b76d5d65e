"""The network: a small convolutional net, conditioned on the instruction by FiLM, with soft keypoints; its encodings.

A miniature of RT-1 (Brohan et al. 2022, <https://arxiv.org/abs/2212.06817>: FiLM, binned actions) with the spatial soft
argmax of Levine et al. 2016 (<https://arxiv.org/abs/1504.00702>) in place of tokens, and with action chunks.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from torch import Tensor, nn
from torch.nn import functional

from vlafuzz.policies.mini import words

TEXT = 128
POINTS = 24  # soft keypoints; the first three are trained to lie on a, b and the hand
FEATURES = 64
DESCRIBED = 8  # keypoints whose features are read
HIDDEN = 512
DROPPED = 0.1
HORIZON = 4  # predicted steps
BINS = 61
SPAN = 2  # bins on either side of the most likely one that enter the mean
FARTHEST = (0.1, 0.1, 0.1, 0.6, 0.6, 0.6)  # metres and radians at the last bin
STATE = 10  # length of ``proprioception``
LONG = 10  # steps since the last change of the gripper's command are clipped here
Affine = tuple[Tensor, Tensor]  # a factor and an offset of each channel, ``(pictures, channels, 1, 1)``


@dataclass(frozen=True)
class Told:
    """All that the network makes of n instructions, the same in every step; ``films`` are of n * views pictures."""

    text: Tensor
    films: tuple[Affine, ...]
    queries: Tensor


class Film(nn.Module):
    """A layer that computes factor and offset of each channel from the text vector; at first the identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.line = nn.Linear(TEXT, 2 * channels)
        nn.init.zeros_(self.line.weight)
        nn.init.zeros_(self.line.bias)

    def forward(self, text: Tensor, views: int) -> Affine:
        scale, shift = self.line(text).repeat_interleave(views, 0)[:, :, None, None].chunk(2, dim=1)
        return 1 + scale, shift


class Block(nn.Module):
    """A residual block with FiLM."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.second = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.norms = nn.ModuleList(nn.GroupNorm(8, channels) for _ in range(2))
        self.film = Film(channels)

    def forward(self, x: Tensor, film: Affine) -> Tensor:
        (scale, shift), (before, after) = film, self.norms
        y = _normed(before, self.first(x)).relu_()
        return (_normed(after, self.second(y)) * scale).add_(shift).add_(x).relu_()


class Down(nn.Module):
    """Halves the resolution and changes the number of channels."""

    def __init__(self, before: int, after: int, kernel: int = 3) -> None:
        super().__init__()
        self.conv = nn.Conv2d(before, after, kernel, stride=2, padding=kernel // 2, bias=False)
        self.norm = nn.GroupNorm(8, after)

    def forward(self, x: Tensor) -> Tensor:
        return _normed(self.norm, self.conv(x)).relu_()


def _normed(norm: Any, x: Tensor) -> Tensor:
    """Apply a ``GroupNorm`` without the checks of its call."""
    return torch.group_norm(x, norm.num_groups, norm.weight, norm.bias, norm.eps)


class Reader(nn.Module):
    """An encoder of words to a vector: token and position embeddings, one transformer layer, mean pooling."""

    def __init__(self) -> None:
        super().__init__()
        self.words = nn.Embedding(words.SIZE, TEXT)
        self.places = nn.Parameter(torch.randn(words.LENGTH, TEXT) * 0.1)
        self.mixed = nn.Linear(TEXT, 3 * TEXT)
        self.out = nn.Linear(TEXT, TEXT)
        self.norms = nn.ModuleList(nn.LayerNorm(TEXT) for _ in range(3))
        self.deep = nn.Sequential(nn.Linear(TEXT, 2 * TEXT), nn.ReLU(), nn.Linear(2 * TEXT, TEXT))

    def forward(self, tokens: Tensor) -> Tensor:
        there = tokens > 0
        x = self.words(tokens) + self.places
        q, k, v = self.mixed(self.norms[0](x)).unflatten(-1, (3, 4, TEXT // 4)).permute(2, 0, 3, 1, 4)
        seen = functional.scaled_dot_product_attention(q, k, v, attn_mask=there[:, None, None, :])
        x = x + self.out(seen.transpose(1, 2).flatten(2))
        x = self.norms[2](x + self.deep(self.norms[1](x)))
        weights = there[..., None].to(x.dtype)
        mean: Tensor = (x * weights).sum(1) / weights.sum(1).clamp(min=1.0)
        return mean


class Network(nn.Module):
    """The network from images, words and proprioception to a chunk of actions. ``views``: the number of cameras."""

    def __init__(self, views: int = 1) -> None:
        super().__init__()
        self.views = views
        self.reader = Reader()
        self.stem = Down(5, 32, kernel=5)  # 64 × 64
        self.to_middle, self.middle = Down(32, 64), nn.ModuleList(Block(64) for _ in range(2))  # 32 × 32
        self.to_far, self.far = Down(64, 128), nn.ModuleList(Block(128) for _ in range(2))  # 16 × 16
        self.lift = nn.Conv2d(128, FEATURES, 1)
        self.side = nn.Conv2d(64, FEATURES, 1)
        self.fused = nn.Conv2d(FEATURES, FEATURES, 3, padding=1)
        self.queries = nn.Linear(TEXT, views * POINTS * FEATURES)
        self.summary = nn.Conv2d(128, 16, 1)
        seen = views * (3 * POINTS + DESCRIBED * FEATURES + 16 * 64) + TEXT + STATE
        trunk = [nn.Linear(seen, HIDDEN), nn.LayerNorm(HIDDEN), nn.ReLU(), nn.Dropout(DROPPED)]
        trunk += [nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Dropout(DROPPED)]
        self.trunk = nn.Sequential(*trunk)
        self.moves = nn.Linear(HIDDEN, HORIZON * 6 * BINS)
        self.gripper = nn.Linear(HIDDEN, HORIZON)
        self.places = nn.Linear(HIDDEN, 6)

    def forward(self, pictures: Tensor, tokens: Tensor, state: Tensor) -> dict[str, Tensor]:
        """``act`` on the instructions ``tokens``."""
        return self.act(pictures, self.read(tokens), state)

    def read(self, tokens: Tensor) -> Told:
        """Encode instructions: ``(n, words.LENGTH)`` tokens."""
        text = self.reader(tokens)
        films = tuple(block.film(text, self.views) for block in (*self.middle, *self.far))
        return Told(text, films, self.queries(text).unflatten(1, (self.views, POINTS, FEATURES)))

    def act(self, pictures: Tensor, told: Told, state: Tensor) -> dict[str, Tensor]:
        """Predict actions and where the objects are.

        Args:
            pictures: ``(n, 3 * views, 128, 128)`` in [0, 1], one camera after the other.
            told: of n instructions.
            state: ``(n, STATE)``, see ``proprioception``.

        Returns:
            ``moves`` ``(n, HORIZON, 6, BINS)`` logits, ``gripper`` ``(n, HORIZON)`` logits of open, ``points`` ``(n,
            views * POINTS, 2)`` in [0, 1], ``places`` ``(n, 2, 3)`` of a and b in metres.
        """
        middle, far = self._see(pictures, told)
        fused = (self.side(middle) + functional.interpolate(self.lift(far), scale_factor=2.0)).relu_()
        points, spread, features = _look(self.fused(fused).relu_(), told.queries.flatten(0, 1))
        summary = functional.adaptive_avg_pool2d(self.summary(far).relu_(), 8)
        points = points.reshape(len(pictures), -1, 2)
        known = [part.reshape(len(pictures), -1) for part in (points * 2 - 1, spread, features, summary)]
        seen = torch.cat([*known, told.text, state], dim=1)
        hidden = self.trunk(seen)
        return {
            "moves": self.moves(hidden).unflatten(1, (HORIZON, 6, BINS)),
            "gripper": self.gripper(hidden),
            "points": points,
            "places": self.places(hidden).unflatten(1, (2, 3)),
        }

    def _see(self, pictures: Tensor, told: Told) -> tuple[Tensor, Tensor]:
        """Features of every picture on its own: ``(n * views, …)``, halved twice and three times."""
        grid = _grid(self.views, pictures.device, pictures.dtype).expand(len(pictures), -1, -1, -1, -1).flatten(0, 1)
        pictures = pictures.reshape(-1, 3, *pictures.shape[2:])
        x = self.to_middle(self.stem(torch.cat([(pictures * 2).sub_(1), grid], dim=1)))
        films = iter(told.films)
        for block in self.middle:
            x = block(x, next(films))
        middle, x = x, self.to_far(x)
        for block in self.far:
            x = block(x, next(films))
        return middle, x


@cache
def _grid(views: int, device: torch.device, dtype: torch.dtype) -> Tensor:
    """``(views, 2, 128, 128)``: row and column of each pixel in [-1, 1], shifted by 2 for each camera."""
    side = torch.linspace(-1, 1, 128, device=device, dtype=dtype)
    grid = torch.stack(torch.meshgrid(side, side, indexing="ij"))[None]
    return grid + 2 * torch.arange(views, device=device, dtype=dtype)[:, None, None, None]


def _look(fused: Tensor, queries: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Where each query finds its like, how surely, and the features that the first ones find there."""
    seen = fused.flatten(2)
    heat = (queries @ seen / 8.0).float().softmax(-1)
    cells = torch.arange(32, device=fused.device).float().add(0.5) / 32
    square = heat.view(-1, POINTS, 32, 32)
    across, down = square.sum(-2) @ cells, square.sum(-1) @ cells
    features = heat[:, :DESCRIBED].to(fused.dtype) @ seen.transpose(1, 2)
    return torch.stack([across, down], -1), heat.amax(-1), features.flatten(1)


def proprioception(
    state: NDArray[np.float32], before: NDArray[np.float32], since: NDArray[np.int64]
) -> NDArray[np.float32]:
    """``(n, STATE)``: TCP, closing axis as cosine and sine of twice its angle, tilt, opening, change, time.

    ``state``: ``(n, 7)``, see ``PolicySpec.state``. ``before``: ``(n,)`` the opening at the previous observation.
    ``since``: ``(n,)`` steps since the gripper's command last changed.
    """
    matrix = Rotation.from_rotvec(state[:, 3:6].astype(np.float64)).as_matrix()
    yaw = np.arctan2(matrix[:, 1, 1], matrix[:, 0, 1])[:, None]
    opening, change = state[:, 6:], state[:, 6:] - before[:, None]
    waited = np.minimum(since, LONG)[:, None] / LONG
    axis = np.cos(2 * yaw), np.sin(2 * yaw)
    known = [state[:, :3] * 4, *axis, matrix[:, :2, 2] * 4, opening, change, waited]
    return np.concatenate(known, axis=1).astype(np.float32)


def from_bins(places: Tensor) -> Tensor:
    """``(..., 6)`` bin coordinates in [0, BINS - 1] to metric deltas, finer near zero."""
    bent = places / (BINS - 1) * 2 - 1
    return bent * bent.abs() * torch.tensor(FARTHEST, device=places.device)


def decode(logits: Tensor) -> Tensor:
    """``(..., 6, BINS)`` to ``(..., 6)``: the mean over the bins around the most likely one."""
    places = torch.arange(BINS, device=logits.device)
    near = (places - logits.argmax(-1, keepdim=True)).abs() <= SPAN
    weights = torch.where(near, logits, -torch.inf).softmax(-1)
    return from_bins((weights * places).sum(-1))
