"""ExpertRunner: expert and simulator under the conditions of a run, which show how its policy should act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vlafuzz.exports.packed import Packed, packed
from vlafuzz.model.evidence import Actions
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Latency, Scene
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.clients.model import Interface, Written, interface_of
from vlafuzz.policies.controls import Player
from vlafuzz.rollouts.executor import evaluate_safely
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.store.records import Manifest
from vlafuzz.worlds import world_of

if TYPE_CHECKING:
    from vlafuzz.worlds.evaluator import SceneEvaluator

UNFAIR = "its scene is not fair"
BROKEN = "the simulator broke"
UNSOLVED = "the expert does not solve it"


class Solution(NamedTuple):
    """The attempt of this number solved the scene with these actions: ``(steps, n)`` as the policy writes them."""

    attempt: int
    actions: Actions


class ExpertRunner:
    """Solves scenes as the policy of a run would have to, and records what it would see meanwhile."""

    def __init__(self, run: Manifest) -> None:
        self._run = replace(run, repeats=1, stop_early=True)
        self.interface: Interface = interface_of(run.policy, run.spec)
        self._demonstrator = world_of(run.task).demonstrator(self.interface)
        self._solving: SceneEvaluator | None = None
        self._playing: dict[bool, tuple[SceneEvaluator, _Player]] = {}  # by whether there are pictures

    def solve(self, scene: Scene, first: int = 0) -> Solution | str:
        """The expert's solution, beginning with its ``first`` attempt; or why there is none.

        It acts without latency, as it corrects itself at every step; a replay then has the scene's.
        """
        if self._solving is None:
            self._solving = make_evaluator(self._run, self._demonstrator)
        prompt = replace(scene, latency=Latency())
        tries = self._demonstrator.tries
        for attempt in ((first + number) % tries for number in range(tries)):
            self._demonstrator.attempt = attempt
            (outcome,) = evaluate_safely(self._solving, [prompt])
            if outcome.verdict < Verdict.PASSED:
                return UNFAIR if outcome.verdict is Verdict.INVALID else BROKEN
            if outcome.verdict is Verdict.PASSED:
                actions = np.stack(self._demonstrator.written)
                if prompt == scene or self._played(scene, actions, pictures=False) is not None:
                    return Solution(attempt, actions)
        return UNSOLVED

    def record(self, scene: Scene, actions: Actions, finding: str = "") -> Packed | None:
        """Record what the policy would see and do; None if the actions do not solve the scene.

        Args:
            finding: see ``Packed``.

        Raises:
            PrerequisiteError: rendering does not work here.
        """
        steps = self._played(scene, actions, pictures=True)
        if steps is None:
            return None
        names = self.interface.pictures.items()
        images = {name: np.stack([seen.images[camera] for seen, _ in steps]) for camera, name in names}
        states = np.stack([self.interface.state(seen) for seen, _ in steps])
        return packed(scene, images, states, np.stack([written for _, written in steps]), finding)

    def close(self) -> None:
        for evaluator in (self._solving, *(evaluator for evaluator, _ in self._playing.values())):
            if evaluator is not None:
                evaluator.close()
        self._solving, self._playing = None, {}

    def _played(self, scene: Scene, actions: Actions, *, pictures: bool) -> list[tuple[Observation, Written]] | None:
        """Replay actions; the observations with the actions that follow them, up to success, or None without it."""
        if pictures not in self._playing:
            player = _Player(self.interface, pictures=pictures)
            self._playing[pictures] = make_evaluator(self._run, player, checked=False), player
        evaluator, player = self._playing[pictures]
        player.actions, evaluator.seed = actions, int(scene.digest[:6], 16)
        (outcome,) = evaluate_safely(evaluator, [scene])
        in_time = len(player.steps) <= len(actions) + scene.latency.delay
        return player.steps if outcome.verdict is Verdict.PASSED and in_time else None


class _Player(Player):
    """Executes actions as they are written, waits for late ones, and keeps what it sees.

    Attributes:
        steps: observations with the actions that followed.
    """

    def __init__(self, interface: Interface, *, pictures: bool) -> None:
        super().__init__(interface.spec)
        cameras = interface.spec.cameras if pictures else ()
        self.spec = replace(interface.spec, cameras=cameras, state=True, silhouettes=False, calibrated=False)
        self.steps: list[tuple[Observation, Written]] = []

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self.steps = []

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        chunks = super().act(observations)
        written = (chunk.actions[0].astype(np.float32) for chunk in chunks)
        self.steps += zip(observations, written, strict=True)
        return chunks
