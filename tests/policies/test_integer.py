"""Mini's convolutions in 8-bit integers, against those in floating point."""

import subprocess

import pytest
import torch
from torch import nn

from vlafuzz.policies.mini.integer import LEVELS, IntegerConv, exact, to_integers
from vlafuzz.policies.mini.model import Network
from vlafuzz.policies.mini.policy import read_card

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
def test_integers_are_used_where_a_process_has_survived_their_trial_with_right_sums(
    monkeypatch: pytest.MonkeyPatch, tmp_path, code: int, answer: bool
):
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path))
    monkeypatch.setattr(subprocess, "run", lambda command, **_: subprocess.CompletedProcess(command, code))
    assert exact.__wrapped__() is answer
    monkeypatch.setattr(subprocess, "run", lambda command, **_: pytest.fail("it is tried once"))
    assert exact.__wrapped__() is answer


def test_the_card_has_a_range_of_every_large_convolution_but_the_one_that_sees_the_picture():
    network = Network()
    large = {
        name for name, layer in network.named_modules() if isinstance(layer, nn.Conv2d) and layer.kernel_size == (3, 3)
    }
    to_integers(network, read_card().ranges)
    whole = {name for name, layer in network.named_modules() if isinstance(layer, IntegerConv)}
    assert whole == large
