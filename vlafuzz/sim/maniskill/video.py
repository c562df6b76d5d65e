"""Recording: pictures of a rollout from a camera beside the policy's, and what the policy itself saw."""

from __future__ import annotations

from pathlib import Path

import cv2
import imageio.v3 as imageio
import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import UsageError
from vlafuzz.policies.base import CameraRequest, Observation, Outlines
from vlafuzz.sim.maniskill.env import TabletopEnv

Picture = NDArray[np.uint8]
_CAPTION = 44  # pixels of the strip under a frame
_INK = (235, 235, 235)
HELD_FRAMES = 8  # of the last picture, so that a player does not cut to black at the very end


class Recording:
    """Collects frames and observations of one rollout.

    Args:
        size: of a frame, pixels; 0 for no frames, which needs no renderer.
    """

    def __init__(self, size: int = 480) -> None:
        self.camera = CameraRequest("recording", size, size) if size else None
        self.frames: list[Picture] = []
        self.observations: list[Observation] = []

    def clear(self) -> None:
        """Another rollout begins."""
        self.frames, self.observations = [], []

    def note(self, env: TabletopEnv, instruction: str) -> None:
        """Keep a frame of this moment, with a caption that says how far the rollout has come."""
        if self.camera is None:
            return
        monitor = env.monitor
        stages = " > ".join(monitor.reached) or "-"
        seconds = len(monitor.trace) / env.control_hz
        says = f"{seconds:4.1f} s   reached: {stages}   progress {monitor.progress:.2f}"
        self.frames.append(_captioned(env.picture(self.camera.name), instruction, says))

    def write_video(self, path: Path, hz: int) -> None:
        """MP4 in real time.

        Raises:
            UsageError: the file cannot be written.
        """
        frames = np.stack(self.frames + [self.frames[-1]] * HELD_FRAMES)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            imageio.imwrite(path, frames, extension=".mp4", fps=hz, codec="libx264", macro_block_size=4)
        except OSError as error:
            raise UsageError(
                f"{path}: cannot be written: {error}", hint="name a file in a folder of yours"
            ) from None

    def contact_strip(self, columns: int = 4) -> Picture:
        """The rollout in one picture: ``columns`` frames, evenly spread from the first to the last."""
        chosen = np.linspace(0, len(self.frames) - 1, columns).round().astype(int)
        return np.concatenate([self.frames[index] for index in chosen], axis=1)

    def seen(self) -> Picture:
        """What the policy got to see at first: its cameras' pictures, or outlines in their colours."""
        first = self.observations[0]
        pictures = list(first.images.values())
        if first.outlines is not None:
            pictures.append(draw_outlines(first.outlines))
        if not pictures:
            raise UsageError("this policy asks for no pictures", hint="leave --seen out")
        height = max(picture.shape[0] for picture in pictures)
        return np.concatenate([_padded(picture, height) for picture in pictures], axis=1)


def draw_outlines(outlines: Outlines, size: int = 256) -> Picture:
    """Outlines in their apparent colours on the table's, the hand as a cross."""
    picture = np.full((size, size, 3), np.round(outlines.table * 255), dtype=np.uint8)
    for thing in outlines.things:
        u, v = np.minimum((thing.pixels * size).astype(int), size - 1).T
        picture[v, u] = np.round(thing.colour * 255)
    if outlines.hand is not None:
        u, v = (outlines.hand * size).astype(int).tolist()
        cv2.drawMarker(picture, (u, v), (255, 0, 255), cv2.MARKER_CROSS, 12, 2)
    return picture


def write_picture(path: Path, picture: Picture) -> None:
    """PNG.

    Raises:
        UsageError: the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        imageio.imwrite(path, picture, extension=".png")
    except OSError as error:
        raise UsageError(
            f"{path}: cannot be written: {error}", hint="name a file in a folder of yours"
        ) from None


def _captioned(picture: Picture, *lines: str) -> Picture:
    strip = np.zeros((_CAPTION, picture.shape[1], 3), dtype=np.uint8)
    for row, line in enumerate(lines):
        cv2.putText(strip, line, (6, 17 + 19 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.42, _INK, 1, cv2.LINE_AA)
    return np.concatenate([picture, strip])


def _padded(picture: Picture, height: int) -> Picture:
    return np.pad(picture, ((0, height - picture.shape[0]), (0, 0), (0, 0)))
