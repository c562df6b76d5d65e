"""Judged: whether policies pass in scenes that none of them was trained with, the same ones for all."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

from eval_mini import draw

from vlafuzz.model import Conditions, Scene, Verdict
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.mini.policy import Mini
from vlafuzz.worlds.recording import Recording
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator

JOB = 20  # scenes


class Exchanged:
    """The `mini` whose turn it is, so that all of them share one simulator."""

    def __init__(self) -> None:
        self.spec = Mini().spec

    def use(self, weights: Path) -> None:
        self._mini = _mini(weights)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._mini.reset(episodes)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return self._mini.act(observations)

    def close(self) -> None:
        self._mini.close()


@lru_cache(maxsize=2)
def _mini(weights: Path) -> Mini:
    return Mini(weights)


@cache
def _simulator(task: str) -> tuple[Exchanged, ManiSkillEvaluator]:
    policy = Exchanged()
    return policy, ManiSkillEvaluator(_conditions(task), policy, load_catalogue())


def _conditions(task: str) -> Conditions:
    return Conditions(task=task, world={"min_distance": 0.15}, stop_early=True)


def roll(weights: Path, task: str, scene: Scene, recording: Recording) -> bool:
    """Roll a policy out in a scene, as it was judged, and record it; whether it fails."""
    evaluator = ManiSkillEvaluator(_conditions(task), Mini(weights), load_catalogue(), recording=recording)
    (outcome,) = evaluator.evaluate([scene])
    evaluator.close()
    return outcome.verdict is Verdict.FAILED


@dataclass(frozen=True)
class Job:
    """Scenes of one task and kind (``nominal`` or ``random``), for one policy."""

    weights: Path
    task: str
    kind: str
    first: int
    count: int
    out: Path

    def run(self) -> None:
        """Write one row per rollout; scenes that are not fair have none."""
        policy, evaluator = _simulator(self.task)
        policy.use(self.weights)
        lines = []
        for number in range(self.first, self.first + self.count):
            (outcome,) = evaluator.evaluate([draw(self.task, self.kind, number)])
            if outcome.verdict >= Verdict.PASSED:
                row = {"task": self.task, "kind": self.kind, "scene": number}
                lines.append(json.dumps(row | {"failed": outcome.verdict is Verdict.FAILED}) + "\n")
        self.out.parent.mkdir(parents=True, exist_ok=True)
        self.out.write_text("".join(lines))


def jobs(weights: Path, task: str, kind: str, first: int, scenes: int, out: Path) -> list[Job]:
    """Jobs for about that many rollouts, each with a file in ``out``; without those whose file is there."""
    numbers = range(first, first + scenes, JOB)
    made = [Job(weights, task, kind, n, JOB, out / f"{kind}-{task}-{n}.jsonl") for n in numbers]
    return [job for job in made if not job.out.exists()]
