"""Actions and proprioception as the network encodes them: finer bins near zero, continuous angles."""

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from torch import Tensor

HORIZON = 4  # predicted steps
BINS = 61
SPAN = 2  # bins on either side of the most likely one that enter the mean
FARTHEST = (0.1, 0.1, 0.1, 0.6, 0.6, 0.6)  # metres and radians at the last bin
STATE = 10  # length of ``proprioception``
LONG = 10  # steps since the last change of the gripper's command are clipped here


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


def to_bins(actions: Tensor) -> Tensor:
    """``(..., 6)`` metric deltas to bin coordinates in [0, BINS - 1], not rounded."""
    share = actions / torch.tensor(FARTHEST, device=actions.device)
    bent = share.abs().clamp(max=1.0).sqrt() * share.sign()
    return (bent + 1) / 2 * (BINS - 1)


def from_bins(places: Tensor) -> Tensor:
    """The inverse of ``to_bins``."""
    bent = places / (BINS - 1) * 2 - 1
    return bent * bent.abs() * torch.tensor(FARTHEST, device=places.device)


def decode(logits: Tensor) -> Tensor:
    """``(..., 6, BINS)`` to ``(..., 6)``: the mean over the bins around the most likely one."""
    places = torch.arange(BINS, device=logits.device)
    near = (places - logits.argmax(-1, keepdim=True)).abs() <= SPAN
    weights = torch.where(near, logits, -torch.inf).softmax(-1)
    return from_bins((weights * places).sum(-1))
