"""Convolutions in 8-bit integers, after training: on a CPU about three times as fast as in floating point.

Weights have one scale per output channel, inputs one per layer, from the ranges that scripts/quantize_mini.py measures
(Jacob et al. 2018, <https://arxiv.org/abs/1712.05877>).
"""

import os
from collections.abc import Mapping
from functools import cache
from itertools import product
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from vlafuzz.common.assets import kept
from vlafuzz.common.child import tried

# The largest integers of inputs and of weights: older processors add two products in 16 bits.
LEVELS, SIGNED = 255, 64
SHAPES = ((32, 64, 64, 2), (64, 64, 32, 1), (64, 128, 32, 2), (128, 128, 16, 1))  # channels, size, stride


class IntegerConv:
    """A convolution of inputs in [0, ``largest``]; larger ones are clipped. For inference on a CPU."""

    def __init__(self, conv: nn.Conv2d, largest: float) -> None:
        weight = conv.weight.detach()
        self._step = largest / LEVELS
        self._steps = weight.abs().amax((1, 2, 3)).clamp(min=1e-12) / SIGNED
        self._weight = (weight / self._steps[:, None, None, None]).round().to(torch.int8)
        self._bias = None if conv.bias is None else conv.bias.detach()
        self._stride, self._padding = list(conv.stride), [int(side) for side in conv.padding]
        self._zeros = torch.zeros(len(weight), dtype=torch.int64)
        self._packed: dict[tuple[int, ...], Any] = {}  # weights as oneDNN wants them, by shape of the input

    def __call__(self, x: Tensor) -> Tensor:
        rounded = (x * (1 / self._step)).add_(0.5).clamp_(max=LEVELS)
        whole = rounded.to(torch.int16).to(torch.uint8)  # straight to bytes takes half as long again
        return self.fast(whole) if exact() else self.slow(whole)

    def fast(self, whole: Tensor) -> Tensor:
        shape = tuple(whole.shape)
        geometry = self._stride, self._padding, [1, 1], 1
        if shape not in self._packed:
            self._packed[shape] = torch.ops.onednn.qconv_prepack(
                self._weight, self._steps, self._step, 0, *geometry, list(shape)
            )
        inputs = whole, self._step, 0, self._packed[shape], self._steps, self._zeros, self._bias
        answer: Tensor = torch.ops.onednn.qconv2d_pointwise(*inputs, *geometry, 1.0, 0, torch.float32, "none", [], "")
        return answer

    def slow(self, whole: Tensor) -> Tensor:
        """The same in floating point, which holds such integers."""
        weight = self._weight.to(torch.float32, memory_format=torch.channels_last)
        sums = functional.conv2d(whole.float(), weight, stride=self._stride, padding=self._padding)
        answer = sums * (self._steps * self._step)[:, None, None]
        return answer if self._bias is None else answer + self._bias[:, None, None]


@cache
def exact() -> bool:
    """Whether torch convolves 8-bit integers on this processor, and sums them without overflow.

    That is tried in a process of its own, as a kernel may crash, and once for a processor and torch.
    """
    code = f"from {__name__} import trial; raise SystemExit(not trial())"
    return bool(kept("integers", lambda: not tried(code)[1], os.environ.get("ONEDNN_MAX_CPU_ISA")))


@torch.inference_mode()
def trial() -> bool:
    """Whether sums of the largest integers are right in convolutions of mini's shapes."""
    torch.set_num_threads(1)
    for (before, after, size, stride), bias in product(SHAPES, (False, True)):
        conv = nn.Conv2d(before, after, 3, stride=stride, padding=1, bias=bias)
        for parameter in conv.parameters():
            nn.init.constant_(parameter, SIGNED if parameter is conv.weight else 0.0)
        whole = torch.full((1, before, size, size), LEVELS, dtype=torch.uint8)
        inner = IntegerConv(conv, LEVELS).fast(whole.to(memory_format=torch.channels_last))[..., 1:-1, 1:-1]
        if not bool((inner == 9 * before * LEVELS * SIGNED).all()):
            return False
    return True


def to_integers(network: nn.Module, largest: Mapping[str, float]) -> None:
    """Replace the convolutions of these names, whose inputs are at most so large."""
    for name, size in largest.items():
        parent, _, own = name.rpartition(".")
        conv = network.get_submodule(name)
        assert isinstance(conv, nn.Conv2d)
        delattr(network.get_submodule(parent), own)
        setattr(network.get_submodule(parent), own, IntegerConv(conv, size))
