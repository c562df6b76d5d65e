"""Test doubles: a space of three genes, an evaluator in closed form, a policy that does nothing."""

import math
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Self

import numpy as np

from vlafuzz.model import Light, Outcome, Placement, Rollout, Scene, Verdict
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, PolicySpec
from vlafuzz.rollouts.executor import Tagged
from vlafuzz.search.base import Genome, Proposal, Source, Strategy
from vlafuzz.search.proposals import Random
from vlafuzz.search.scoring import Score
from vlafuzz.store.records import Manifest, Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds.evaluator import Evaluation
from vlafuzz.worlds.manipulation.space import GROUPS

STAGES = ("grasp", "lift", "success")
LEVELS = 9  # of each gene


def scene(light: float = 1.0, x: float = -0.04, y: float = 0.0) -> Scene:
    placed = Placement("green_cube", "flat", float(round(x, 3)), float(round(y, 3)))
    return Scene("pick-up", (placed,), "pick up green cube", light=Light(float(light)))


class TinySpace:
    """Light from 1/16 to 16, and where the target stands; nominal in the middle of each."""

    dim = 3
    share = 1.0  # of the ranges

    def narrowed(self, severity: float) -> Self:
        space = copy(self)
        space.share = severity
        return space

    def decode(self, genome: Genome) -> Scene:
        light, x, y = (min(int(gene * LEVELS), LEVELS - 1) - LEVELS // 2 for gene in genome)
        return scene(2.0**light, -0.04 + 0.04 * x, 0.05 * y)

    def encode(self, scene: Scene) -> Genome:
        target = scene.targets[0]
        levels = (math.log2(scene.light.intensity), (target.x + 0.04) / 0.04, target.y / 0.05)
        return np.array([(round(level) + LEVELS // 2 + 0.5) / LEVELS for level in levels])

    def sample(self, rng: np.random.Generator) -> Scene:
        return self.decode(0.5 + (rng.random(self.dim) - 0.5) * self.share)

    def severities(self, scene: Scene) -> dict[str, float]:
        target = scene.targets[0]
        place = max(abs(target.x + 0.04) / 0.16, abs(target.y) / 0.2)
        return {"light": abs(math.log2(scene.light.intensity)) / 4, "target-position": place}

    def severity(self, scene: Scene) -> float:
        return sum(self.severities(scene).values())

    groups, quantities = GROUPS, {}

    def site(self, scene: Scene, severities: Mapping[str, float]) -> str:
        return "+".join(sorted(name for name, value in severities.items() if value > 0.5)) or "base"


def rollout(progress: float = 1.0, reached: tuple[str, ...] = STAGES, steps: int = 4) -> Rollout:
    success = reached == STAGES
    trace = np.linspace(0, progress, steps, dtype=np.float32)
    actions = np.full((steps, 7), 0.01, dtype=np.float32)
    made = {"trace": trace, "actions": actions, "states_hash": "5" * 32, "seconds": 0.5}
    return Rollout(success_once=success, success_at_end=success, reached=reached, progress=progress, **made)


def passed(repeats: int = 1) -> Outcome:
    return Outcome.of((rollout(),) * repeats, STAGES)


def failed(progress: float = 0.25, repeats: int = 1) -> Outcome:
    return Outcome.of((rollout(progress, ()),) * repeats, STAGES)


class ClosedForm:
    """In the dark (light below 1/2) the policy fails, and a target with x above 0.05 m is out of reach."""

    def __init__(self, repeats: int = 1) -> None:
        self.repeats = repeats
        self.evaluated: list[Scene] = []

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        self.evaluated += scenes
        return [self.outcome(scene) for scene in scenes]

    def evaluation(self, scene: Scene, seed: int | None = None) -> Evaluation:
        yield 0.0
        (outcome,) = self.evaluate([scene])
        return outcome

    def close(self) -> None:
        pass

    def outcome(self, scene: Scene) -> Outcome:
        if scene.targets[0].x > 0.05:
            return Outcome.invalid("geometry", "green_cube is out of reach")
        if scene.light.intensity < 0.5:
            return failed(scene.light.intensity, self.repeats)
        return passed(self.repeats)


class Always(ClosedForm):
    """The same outcome, whatever the scene."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__()
        self._outcome = outcome

    def outcome(self, scene: Scene) -> Outcome:
        return self._outcome


class Raising(ClosedForm):
    """Breaks its contract from the given call on."""

    def __init__(self, error: BaseException, after: int = 0) -> None:
        super().__init__()
        self._error, self._after = error, after

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        if len(self.evaluated) >= self._after:
            raise self._error
        return super().evaluate(scenes)


class Gone(ClosedForm):
    """Stops answering after ``after`` scenes; with ``every``, then only answers every n-th."""

    def __init__(self, after: int = 0, every: int = 0) -> None:
        super().__init__()
        self._after, self._every = after, every

    def outcome(self, scene: Scene) -> Outcome:
        outcome, number = super().outcome(scene), len(self.evaluated)
        answers = number <= self._after or (self._every and number % self._every == 0)
        if answers or outcome.verdict is Verdict.INVALID:
            return outcome
        return Outcome.error("policy: connect: refused", unanswered=True)


class Backwards:
    """An executor that takes all scenes that there are, and finishes the last one first."""

    def __init__(self, evaluator: ClosedForm) -> None:
        self._evaluator = evaluator

    def run(self, scenes: Tagged) -> Iterator[tuple[int, Outcome]]:
        todo = iter(scenes)
        while pulled := list(takewhile(bool, todo)):
            for tag, scene in reversed([one for one in pulled if one]):
                yield tag, self._evaluator.evaluate([scene])[0]

    def close(self) -> None:
        self._evaluator.close()


class Several:
    """An executor with several workers, a random one of which is done next.

    Attributes:
        evaluated: scenes.
        waited: share of the time in which a worker had none.
    """

    def __init__(self, evaluator: ClosedForm, workers: int = 8) -> None:
        self._evaluator, self._workers = evaluator, workers
        self.evaluated, self._idle = 0, 0

    @property
    def waited(self) -> float:
        return self._idle / self._workers / self.evaluated

    def run(self, scenes: Tagged) -> Iterator[tuple[int, Outcome]]:
        todo, busy, rng = iter(scenes), [], np.random.default_rng(0)
        while True:
            while len(busy) < self._workers and (one := next(todo, None)):
                busy.append(one)
            if not busy:
                return
            self._idle += self._workers - len(busy)
            tag, scene = busy.pop(rng.integers(len(busy)))
            self.evaluated += 1
            yield tag, self._evaluator.evaluate([scene])[0]

    def close(self) -> None:
        self._evaluator.close()


class Scripted:
    """A strategy that proposes given genomes, and records the scores."""

    def __init__(self, genomes: Sequence[Genome]) -> None:
        self._genomes, self._asked = genomes, 0
        self.told: list[tuple[int, Score]] = []

    def ask(self, n: int) -> list[Proposal]:
        first, self._asked = self._asked, min(self._asked + n, len(self._genomes))
        return [Proposal(index, self._genomes[index]) for index in range(first, self._asked)]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        self.told += [(proposal.id, score) for proposal, score in zip(proposals, scores, strict=True)]


class Idle:
    """A policy without memory; as it is, it is never called."""

    spec = PolicySpec("idle")

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        pass

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        raise AssertionError("the evaluator is a double")

    def close(self) -> None:
        pass


def make_idle(*_: object, **__: object) -> Idle:
    return Idle()


NOMINAL = Manifest(
    task="pick-up", policy="idle", spec="{}", strategy="random", budget=20, batch=8, seed=0, catalogue_digest="c"
)


def manifest(**changes: object) -> Manifest:
    return replace(NOMINAL, **changes)  # type: ignore[arg-type]


def trial(proposal: int, outcome: Outcome, *, duplicate: bool = False) -> Trial:
    made = ended(scene(x=proposal / 1000), outcome, proposal)
    return replace(made, severity=0.5, genome=np.array([0.1, 0.9]), duplicate=duplicate)


def ended(scene: Scene, outcome: Outcome | None = None, proposal: int = 0, cell: str = "grasp|light|x0y0") -> Trial:
    """A trial in a scene, by default a failure."""
    outcome = outcome or failed()
    where = cell if outcome.verdict is Verdict.FAILED else None
    return Trial(proposal=proposal, scene=scene, outcome=outcome, severity=1.0, cell=where)


def begun(store: Store, *trials: Trial, about: Manifest = NOMINAL) -> int:
    """One run more, with these trials; its number."""
    run = store.begin(about)
    for each in trials:
        store.add(run, each)
    return run


def stored(path: Path, *trials: Trial, about: Manifest = NOMINAL) -> Path:
    """A store with one run more, with these trials."""
    with Store.open(path, "write") as store:
        begun(store, *trials, about=about)
    return path


def make_random_again(space: Source, seed: int, budget: int | None) -> Strategy:
    """Random under another name: it proposes the same scenes."""
    return Random(space, seed, budget)
