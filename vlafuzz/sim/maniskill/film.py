"""Reel: small pictures of rollouts without words on them, and MP4 from them."""

from __future__ import annotations

import imageio.v3 as imageio
import numpy as np

from vlafuzz.sim.maniskill.env import TabletopEnv
from vlafuzz.sim.maniskill.video import HELD_FRAMES, Picture, Recording


class Reel(Recording):
    """A recording without captions, for one rollout after the other.

    Args:
        size: of a frame, pixels.
    """

    def __init__(self, size: int = 224) -> None:
        super().__init__(size)

    def note(self, env: TabletopEnv, instruction: str) -> None:
        """Keep a frame of this moment."""
        assert self.camera is not None
        self.frames.append(np.array(env.picture(self.camera.name)))

    def cut(self) -> list[Picture]:
        """The frames since the last cut."""
        frames = self.frames
        self.frames, self.observations = [], []
        return frames


def to_mp4(frames: list[Picture], fps: int) -> bytes:
    """H.264, small enough for dozens of them in a page."""
    made = imageio.imwrite(
        "<bytes>",
        np.stack(frames + [frames[-1]] * HELD_FRAMES),
        extension=".mp4",
        fps=fps,
        codec="libx264",
        quality=None,
        macro_block_size=4,  # pictures are 300 pixels wide where a robot's camera is 4:3 or 5:4
        output_params=["-crf", "24", "-preset", "slow", "-movflags", "+faststart"],
    )
    return bytes(made)


def to_jpeg(picture: Picture) -> bytes:
    """A picture of a few kilobytes."""
    return bytes(imageio.imwrite("<bytes>", picture, extension=".jpg", quality=85))
