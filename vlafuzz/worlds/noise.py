"""Sensor noise: what a policy sees of a picture."""

from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from vlafuzz.model.scene import Noise

Picture = NDArray[np.uint8]


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
            image = _compressed(image, round(self.noise.jpeg))
        return image


def _compressed(image: Picture, quality: int) -> Picture:
    _, encoded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR), dtype=np.uint8)
    return np.ascontiguousarray(decoded[..., ::-1])  # torch takes no negative strides
