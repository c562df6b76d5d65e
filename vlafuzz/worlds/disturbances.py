"""What disturbs a rollout in any world: commands that reach the robot late, and noise in pictures."""

from collections import deque
from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from vlafuzz.model.scene import Latency, Noise

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Command = tuple[Array, str]  # a metric action, and what it is relative to; see ``ActionSpec``
_HOLD: Command = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), "target"  # stay, with the gripper open


class DelayedCommands:
    """Commands on their way to the robot, which holds still until the first one arrives."""

    def __init__(self, latency: Latency) -> None:
        self._commands: deque[Command] = deque([_HOLD] * latency.delay)

    @property
    def latency(self) -> Latency:
        """The delay of the next command."""
        return Latency(len(self._commands))

    def exchange(self, action: Array, relative_to: str) -> Command:
        """Send a command; return the one that arrives in its place."""
        self._commands.append((action, relative_to))
        return self._commands.popleft()


class SensorNoise:
    """Degrades the images of one rollout. Seed, step and camera determine the noise."""

    def __init__(self, noise: Noise, seed: int) -> None:
        self.noise, self._seed = noise, seed

    def degraded(self, image: Picture, step: int, camera: str) -> Picture:
        """A ``(height, width, 3)`` image as the policy sees it; the same image without noise."""
        if self.noise.blur:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), self.noise.blur), dtype=np.uint8)
        if self.noise.grain:
            rng = np.random.default_rng([self._seed, step, crc32(camera.encode())])
            noisy = image + rng.normal(0.0, self.noise.grain, image.shape)
            image = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
        if self.noise.jpeg < 100:
            quality = [cv2.IMWRITE_JPEG_QUALITY, round(self.noise.jpeg)]
            _, encoded = cv2.imencode(".jpg", image[..., ::-1], quality)
            decoded = np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR), dtype=np.uint8)
            image = np.ascontiguousarray(decoded[..., ::-1])  # torch takes no negative strides
        return image
