"""Episode: one rollout of a policy in a scene, whatever the world; and what disturbs one: late commands, noise."""

import hashlib
from abc import ABC, abstractmethod
from collections import deque
from zlib import crc32

import numpy as np

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.model import Conditions, Latency, Monitor, Noise, Rollout, Scene
from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.worlds.events import STAY, recovery
from vlafuzz.worlds.sight import Sight

Command = tuple[Array, str]  # a metric action, and what it is relative to; see ``ActionSpec``
AFTER_SUCCESS = 10  # control steps, to tell success at the end from success once


class DelayedCommands:
    """A queue of commands on their way to the robot, which holds still until the first one arrives."""

    def __init__(self, latency: Latency) -> None:
        self._commands: deque[Command] = deque([(STAY, "target")] * latency.delay)

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
        import cv2  # here, as every command would wait for it

        if self.noise.blur:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), self.noise.blur), dtype=np.uint8)
        if self.noise.grain:
            rng = np.random.default_rng([self._seed, step, crc32(camera.encode())])
            noisy = image + rng.normal(0.0, self.noise.grain, image.shape)
            image = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
        if self.noise.jpeg < 100:
            _, encoded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, round(self.noise.jpeg)])
            decoded = np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR), dtype=np.uint8)
            image = np.ascontiguousarray(decoded[..., ::-1])  # torch takes no negative strides
        return image


class Episode(ABC):
    """A rollout that has begun. The conditions define when it is over and what counts as success.

    Args:
        hz: control steps per second.
        horizon: control steps after which a rollout without success ends.

    Attributes:
        actions: so far, ``(7,)`` each, metric. over: whether no other follows. monitor: of its stages.
        states_hash: of all states so far, bit by bit; a subclass makes and updates it.
        state: at present, in a world whose own policies act by it: see ``GymPolicy``.
    """

    states_hash: hashlib.blake2b
    state: object

    def __init__(
        self, scene: Scene, seed: int, conditions: Conditions, monitor: Monitor, *, hz: int, horizon: int
    ) -> None:
        self.scene, self.monitor, self.hz, self._last = scene, monitor, hz, horizon
        self._after = 0 if conditions.stop_early else AFTER_SUCCESS
        self.start = EpisodeStart(f"{scene.digest}-{seed}", scene.instruction, scene.task, seed, scene.robot)
        self.actions: list[Array] = []
        self.over = horizon <= 0

    @abstractmethod
    def observe(self) -> Observation:
        """The present observation, with the parts that the policy's spec asks for."""

    @abstractmethod
    def picture(self, camera: str) -> Picture:
        """``(height, width, 3)``: what a camera shows at present, without noise."""

    def sight(self) -> Sight | None:
        """Say what is where at present; None in a world that does not tell."""
        return None

    def shape(self, body: str) -> tuple[Array, Array]:
        """Triangles ``(n, 3, 3)`` of a body in sight, in its own frame, metres; and its colour, ``(3,)`` sRGB."""
        raise NotImplementedError

    def advance(self, action: Array) -> None:
        """Execute a metric action for one control step."""
        before = len(self.monitor.reached)
        self.actions.append(action)
        self._execute(action)
        if len(self.monitor.reached) > before and self.monitor.success_once:
            self._last = min(self._last, len(self.actions) + self._after)
        self.over = len(self.actions) >= self._last

    def rollout(self, seconds: float = 0.0) -> Rollout:
        """The result of a rollout that took so many seconds."""
        monitor = self.monitor
        return Rollout(
            success_once=monitor.success_once,
            success_at_end=monitor.success_now,
            reached=tuple(monitor.reached),
            progress=1.0 if monitor.success_once else min(monitor.progress, 0.99),
            trace=monitor.trace,
            actions=np.array(self.actions, dtype=np.float32),
            states_hash=self.states_hash.hexdigest(),
            seconds=seconds,
            recovery=recovery(self.scene, monitor.trace, [stage.name for stage in monitor.stages], self.hz),
        )

    @abstractmethod
    def _execute(self, action: Array) -> None:
        """Simulate a control step, and show its end to the monitor."""
