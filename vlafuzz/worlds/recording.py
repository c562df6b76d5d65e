"""Images of rollouts, and their encoding."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.arrays import Picture
from vlafuzz.common.files import write_whole, writing
from vlafuzz.policies.base import CameraRequest, Observation
from vlafuzz.worlds.episode import Episode
from vlafuzz.worlds.sight import Sight

GREYS = 16  # levels that are told apart
Paths = tuple[tuple[int, tuple[tuple[int, int], ...]], ...]  # from which frame on, and its points
_HELD_FRAMES = 8  # repeats of the last frame, so that players do not cut to black too early


class Recording:
    """Collects frames and observations of one rollout.

    Args:
        size: height of a frame in pixels; 0 for no frames, so that no renderer is needed.
        stride: control steps from one frame to the next; the last state always has one.
    """

    def __init__(self, size: int = 480, *, stride: int = 1) -> None:
        self.camera = CameraRequest("recording", size, size) if size else None
        self._stride = stride
        self.frames: list[Picture] = []
        self.observations: list[Observation] = []
        self.sights: list[Sight] = []  # one a frame, in a world that tells

    def clear(self) -> None:
        self.frames, self.observations, self.sights = [], [], []

    def note(self, episode: Episode) -> None:
        """Keep a frame of the present state, if it is time for one."""
        if self.camera is None or (len(episode.actions) % self._stride and not episode.over):
            return
        self.frames.append(episode.picture(self.camera.name).copy())
        if (sight := episode.sight()) is not None:
            self.sights.append(sight)

    def paths(self) -> Paths:
        """The hand's whole path in pixels, as the camera of the first frame shows it, and each time that one turns."""
        axes, hands = [sight.camera.axes for sight in self.sights], np.array([sight.hand for sight in self.sights])
        firsts = [frame for frame in range(len(axes)) if frame == 0 or np.any(axes[frame] != axes[frame - 1])]
        shown = [self.sights[first].camera.project(hands)[0] * self.frames[0].shape[1::-1] for first in firsts]
        places = (tuple((round(x), round(y)) for x, y in path.tolist()) for path in shown)
        return tuple(zip(firsts, places, strict=True))

    def stuck(self, trace: NDArray[np.float32]) -> int:
        """The frame after which a rollout makes no progress any more; ``trace``: its progress after each step."""
        return self.frame_after(int(np.argmax(trace)) + 1) if len(trace) else 0

    def frame_after(self, steps: int) -> int:
        """The first frame that shows what so many control steps have led to."""
        return max(0, min(-(-steps // self._stride), len(self.frames) - 1))

    def write_video(self, path: Path, hz: int) -> None:
        """Write an MP4 in real time; a UsageError if that does not work."""
        with writing(path):
            write_whole(path, to_mp4(self.frames, hz))

    def greys(self) -> tuple[float, ...]:
        """The shares of pixels by grey level, black first, in what the policy saw first; empty if it sees nothing."""
        pictures = list(self.observations[0].images.values()) if self.observations else []
        if not pictures:
            return ()
        levels = np.concatenate([picture.mean(axis=2).ravel() for picture in pictures])
        counts, _ = np.histogram(levels, GREYS, (0, 256))
        return tuple((counts / counts.sum()).tolist())

    def seen(self) -> Picture:
        """The pictures in the policy's first observation, side by side."""
        pictures = list(self.observations[0].images.values())
        height = max(picture.shape[0] for picture in pictures)
        padded = [np.pad(one, ((0, height - one.shape[0]), (0, 0), (0, 0))) for one in pictures]
        return np.concatenate(padded, axis=1)


def write_picture(path: Path, picture: Picture) -> None:
    """Write a PNG; a UsageError if that does not work."""
    with writing(path):
        write_whole(path, to_png(picture))


def to_mp4(frames: list[Picture], fps: float) -> bytes:
    """Encode H.264 video, small enough for dozens of them in a page."""
    return _encoded(
        np.stack(frames + [frames[-1]] * _HELD_FRAMES),
        extension=".mp4",
        fps=fps,
        codec="libx264",
        quality=None,
        macro_block_size=4,  # frames are 300 pixels wide where a robot's camera is 4:3 or 5:4
        output_params=["-crf", "24", "-preset", "slow", "-movflags", "+faststart"],
    )


def _encoded(picture: Picture, **options: Any) -> bytes:
    import imageio.v3 as imageio  # here, since most of what records writes no file

    return bytes(imageio.imwrite("<bytes>", picture, **options))


def to_png(picture: Picture) -> bytes:
    return _encoded(picture, extension=".png")


def to_jpeg(picture: Picture) -> bytes:
    """Encode a JPEG of a few kilobytes."""
    return _encoded(picture, extension=".jpg", quality=85)
