"""Policies that workers share. They keep state per rollout, like models with memory."""

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.doubles import Idle
from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, PolicySpec
from vlafuzz.worlds.tabletop.experts.pinhole import Pinhole


class Own(Pinhole):
    """Pinhole under another name; it has memory."""

    def __init__(self) -> None:
        super().__init__()
        self.spec = replace(self.spec, name="model", max_batch=8)


class Common(Own):
    """One policy for all workers; records in the current folder in which process it was created."""

    shared = True

    def __init__(self) -> None:
        super().__init__()
        with Path("made").open("a") as noted:
            noted.write(f"{os.getpid()}\n")


class Mortal(Common):
    """Kills its process at the first rollout, the first time only."""

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        super().reset(episodes)
        if len(Path("made").read_text().split()) == 1:
            os.abort()


class Counter(Idle):
    """Answers with the number of calls in a rollout; raises for some words."""

    shared = True

    def __init__(self, max_batch: int = 8) -> None:
        self.spec = PolicySpec("counter", max_batch=max_batch)
        self.batches: list[int] = []
        self.finished: list[str] = []
        self._calls: dict[str, int] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        for start in episodes:
            if start.instruction == "sit":
                raise ValueError("cannot sit")
            self._calls[start.episode] = 0

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        self.batches.append(len(observations))
        if any(seen.instruction == "jump" for seen in observations):
            raise ValueError("cannot jump")
        for seen in observations:
            self._calls[seen.episode] += 1
        counted = [[float(self._calls[seen.episode])] * 7 for seen in observations]
        return [ActionChunk(np.array([numbers])) for numbers in counted]

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        self.finished += [start.episode for start in episodes]


class Sleeper(Counter):
    """Never answers."""

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        time.sleep(600)
        raise AssertionError


def refused() -> Counter:
    raise UsageError("no weights", hint="download them")


def unmade() -> Counter:
    raise OSError("no device")


def deadly() -> Counter:
    os._exit(4)
