"""Demonstrations: the expert solves scenes as the policy of a run would have to, and is shown as that would see it."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.arrays import Picture
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import UsageError
from vlafuzz.exports.selection import WantedScene
from vlafuzz.model import Actions, Latency, Outcome, Scene, Verdict
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.clients.model import Interface, Written, interface_of
from vlafuzz.policies.controls import Player
from vlafuzz.rollouts.executor import Executor, evaluate_safely
from vlafuzz.rollouts.registry import Place, workers_at
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.store.records import Manifest
from vlafuzz.worlds import world_of
from vlafuzz.worlds.recording import to_png

Numbers = NDArray[np.float32]
Levels = NDArray[np.int64]

UNFAIR = "its scene is not fair"
BROKEN = "the simulator broke"
UNSOLVED = "the expert does not solve it"
UNPLAYED = "a replay of the expert's actions does not solve it"


@dataclass(frozen=True, eq=False)
class Packed:
    """A demonstration, a solution from the start to success with one item per control step, its pictures as PNG.

    Attributes:
        pictures: by name, before the action; ``sizes``: their height, width and channels; ``levels``: see ``levels``.
        states: float32 ``(steps, m)``, in the policy's layout; ``actions``: ``(steps, n)``, as it writes them.
        finding: digest of the failing scene that it is for; empty for a random scene.
    """

    scene: Scene
    pictures: Mapping[str, list[bytes]]
    sizes: Mapping[str, tuple[int, ...]]
    levels: Mapping[str, Levels]
    states: Numbers
    actions: Numbers
    finding: str = ""

    @classmethod
    def of(
        cls, scene: Scene, images: Mapping[str, Picture], states: Numbers, actions: Numbers, finding: str = ""
    ) -> Self:
        """A demonstration with its ``images``, ``(steps, height, width, 3)`` by name, compressed."""
        pictures = {name: list(map(to_png, frames)) for name, frames in images.items()}
        sizes = {name: frames.shape[1:] for name, frames in images.items()}
        counts = {name: levels(frames) for name, frames in images.items()}
        return cls(scene, pictures, sizes, counts, states, actions, finding)


def levels(pictures: Picture) -> Levels:
    """How often each level from 0 to 255 occurs, by channel, in images ``(n, height, width, 3)``: ``(3, 256)``."""
    return np.array([np.bincount(pictures[..., channel].reshape(-1), minlength=256) for channel in range(3)])


class ExpertRunner:
    """Solves scenes as the policy of a run would have to, and records what it would see meanwhile."""

    def __init__(self, run: Manifest) -> None:
        self._run = replace(run, repeats=1, stop_early=True)
        self.interface: Interface = interface_of(run.policy, run.spec)
        self._demonstrator = world_of(run.task).demonstrator(self.interface)
        self._player = _Player(self.interface)
        self._solving = make_evaluator(self._run, self._demonstrator)
        self._playing = make_evaluator(self._run, self._player, checked=False)

    def show(self, scene: Scene, first: int = 0, finding: str = "") -> Packed | str:
        """Show the expert's solution as the policy would see it, or say why there is none.

        The expert acts without latency, as it corrects itself at every step; a replay then has the scene's.

        Args:
            first: attempt of the expert.
            finding: see ``Packed``.

        Raises:
            PrerequisiteError: rendering does not work here.
        """
        prompt, why = replace(scene, latency=Latency()), UNSOLVED
        tries = self._demonstrator.tries
        for attempt in ((first + number) % tries for number in range(tries)):
            self._demonstrator.attempt = attempt
            outcome = evaluate_safely(self._solving, prompt)
            if not outcome.judged:
                return UNFAIR if outcome.verdict is Verdict.INVALID else BROKEN
            if outcome.verdict is Verdict.PASSED:
                if shown := self.record(scene, np.stack(self._demonstrator.written), finding):
                    return shown
                why = UNPLAYED
        return why

    def record(self, scene: Scene, actions: Actions, finding: str = "") -> Packed | None:
        """Replay actions, and record what the policy would see and do; None if they do not solve the scene."""
        self._player.actions, self._playing.seed = actions, int(scene.digest[:6], 16)
        outcome = evaluate_safely(self._playing, scene)
        steps = self._player.steps
        if outcome.verdict is not Verdict.PASSED or len(steps) > len(actions) + scene.latency.delay:
            return None
        names = self.interface.pictures.items()
        images = {name: np.stack([seen.images[camera] for seen, _ in steps]) for camera, name in names}
        states = np.stack([self.interface.state(seen) for seen, _ in steps])
        return Packed.of(scene, images, states, np.stack([written for _, written in steps]), finding)

    def close(self) -> None:
        self._solving.close()
        self._playing.close()


class _Player(Player):
    """Executes actions as they are written, waits for late ones, and keeps what it sees.

    Attributes:
        steps: observations with the actions that followed.
    """

    def __init__(self, interface: Interface) -> None:
        super().__init__(interface.spec)
        self.spec = replace(interface.spec, state=True, silhouettes=False, calibrated=False)
        self.steps: list[tuple[Observation, Written]] = []

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self.steps = []

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        chunks = super().act(observations)
        written = (chunk.actions[0].astype(np.float32) for chunk in chunks)
        self.steps += zip(observations, written, strict=True)
        return chunks


@dataclass
class Demonstrations:
    """Solves scenes and shows the solutions, in several processes.

    Attributes:
        left_out: number of scenes that were tried in vain, by reason.
    """

    workers: int = 1
    watch: Watch = SILENT
    left_out: Counter[str] = field(default_factory=Counter)

    def shown(self, wanted: Iterator[WantedScene], number: int, most: int) -> Iterator[Packed]:
        """Yield what policies would see and do in the first ``number`` scenes that are solved, of ``most``, in order.

        Raises:
            PrerequisiteError: rendering does not work here.
        """
        tried, made = islice(wanted, most), 0
        with closing(workers_at(Place(self.workers), _Teacher)) as executor:
            while missing := list(islice(tried, number - made)):
                for one, answer in zip(missing, self._answers(executor, missing), strict=True):
                    if isinstance(answer, Packed):
                        made += 1
                        yield answer
                    elif answer != UNFAIR or one.finding:  # random scenes are drawn until they are fair
                        self.left_out[answer] += 1

    def _answers(self, executor: Executor, items: Sequence[WantedScene]) -> Iterator[Packed | str]:
        """The demonstration in each scene, or why there is none, in order."""
        early: dict[int, Any] = {}
        following = 0
        rolled = executor.run(enumerate(items))
        for done, (number, result) in enumerate(rolled, start=1):
            if isinstance(result, UsageError):
                raise result
            self.watch.progress("scenes tried by the expert", done, len(items))
            early[number] = BROKEN if isinstance(result, Outcome) else result  # a worker was lost twice
            while following in early:
                yield early.pop(following)
                following += 1


class _Teacher:
    """The evaluator of scenes that are wanted, for runs of any conditions."""

    def __init__(self) -> None:
        self._runners: dict[str, ExpertRunner] = {}  # by the task and conditions of their runs

    def evaluate(self, items: Sequence[WantedScene]) -> list[Any]:
        """The solution of each scene as a policy would see it, or why there is none."""
        try:
            return list(map(self._answer, items))
        except UsageError as error:
            return [error] * len(items)

    def close(self) -> None:
        for runner in self._runners.values():
            runner.close()

    def _answer(self, item: WantedScene) -> Packed | str:
        key = f"{item.run.task}:{item.run.key(seeded=False)}"
        if key not in self._runners:
            self._runners[key] = ExpertRunner(item.run)
        return self._runners[key].show(item.scene, item.attempt, item.finding)
