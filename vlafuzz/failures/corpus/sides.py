"""Sides of a comparison: a policy that is rolled out, or what is known of one, scene by scene."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Protocol

from pydantic import ConfigDict

from vlafuzz.common.files import writing
from vlafuzz.common.reading import parse_json, read_text, validated
from vlafuzz.errors import UsageError
from vlafuzz.failures.corpus.controls import REGRESS, number_of
from vlafuzz.failures.corpus.pairs import Probe
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Manifest

_HINT = "give --answers the file of an earlier `vlafuzz bisect`, or a new one"


Asked = tuple[Probe, int]  # a scene, and the number of a rollout in it


class Side(Protocol):
    """One of the two policies that are compared."""

    @property
    def name(self) -> str: ...

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        """The outcome of each rollout, as it is taken."""


@dataclass(frozen=True)
class Recorded:
    """A baseline without rollouts: the corpus's records of its own policy."""

    name: str

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        """The recorded verdicts."""
        return (Outcome(verdict=Verdict.PASSED if probe.passed else Verdict.FAILED) for probe, _ in asked)


class Rerun:
    """A policy that is rolled out now, with one runner for all runs under the same conditions.

    Args:
        runs: of the corpus.
        make: makes the runner for the conditions of a run; called with the run's manifest at seed 0.
    """

    def __init__(self, name: str, runs: Sequence[Manifest], make: Callable[[Manifest], SceneRunner]) -> None:
        self.name, self._runs = name, runs
        distinct = {run.key(seeded=False): replace(run, seed=0) for run in runs}
        self._runners = {key: make(run) for key, run in distinct.items()}

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        """Rollouts, as many at a time as the runner has lanes."""
        for key, group in groupby(asked, lambda one: self._runs[one[0].run].key(seeded=False)):
            runner, some = self._runners[key], list(group)
            size = getattr(runner, "lanes", 1)
            for first in range(0, len(some), size):
                scenes, numbers = zip(*(self._rollout(runner, *one) for one in some[first : first + size]), strict=True)
                yield from runner.evaluate(scenes, numbers)

    def _rollout(self, runner: SceneRunner, probe: Probe, repeat: int) -> tuple[Scene, int]:
        """A control as it is, another scene with a jitter and seed of no other use."""
        scene, number = probe.scene, number_of(probe.scene)
        if probe.group != "control":
            number = number_of(scene, REGRESS, repeat)
            scene = runner.space.jittered(scene, number)
        return scene, self._runs[probe.run].seed + number

    def close(self) -> None:
        for runner in self._runners.values():
            runner.close()


@dataclass(frozen=True)
class _Row:
    """A line of a file of answers: the name of a policy, the digest of a scene, and whether it passed there.

    ``passed`` is None where the rollout broke. ``repeat`` tells several rollouts in one scene apart.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")
    policy: str
    scene: str
    passed: bool | None
    repeat: int = 0


class Answers:
    """What is known already, so that what was interrupted can go on. Rollouts that broke are tried again.

    Args:
        path: a file of JSON lines, which grows with every outcome; None to keep them in memory only.

    Raises:
        UsageError: the file cannot be read or written, or is none of these.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self.known: dict[tuple[str, str, int], Outcome] = {}
        if path is not None:
            with writing(path, _HINT), path.open("a"):
                pass  # it can be written
            for number, line in enumerate(_whole_lines(path), start=1):
                self._read(line, f"{path}, line {number}")

    def __len__(self) -> int:
        return sum(answer.judged for answer in self.known.values())

    def of(self, side: Side) -> Side:
        """A side that is asked only for what is not known of it."""
        return _Remembering(side.name, self, side)

    def keep(self, policy: str, probe: Probe, repeat: int, answer: Outcome) -> None:
        self.known[policy, probe.scene.digest, repeat] = answer
        if self._path is not None:
            passed = answer.passed if answer.judged else None
            row = {"policy": policy, "scene": probe.scene.digest, "passed": passed, "repeat": repeat}
            with writing(self._path, _HINT), self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")

    def _read(self, line: str, where: str) -> None:
        try:
            value = parse_json(line)
        except ValueError as error:
            raise UsageError(f"{where}: not JSON: {error}", _HINT) from None
        row = validated(_Row, value, where, UsageError, _HINT)
        verdict = {True: Verdict.PASSED, False: Verdict.FAILED, None: Verdict.ERROR}[row.passed]
        self.known[row.policy, row.scene, row.repeat] = Outcome(verdict=verdict)


@dataclass(frozen=True)
class _Remembering:
    name: str
    kept: Answers
    side: Side

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        """The known results, or those of rollouts."""
        known = [self.kept.known.get((self.name, probe.scene.digest, repeat)) for probe, repeat in asked]
        lacking = [one for one, outcome in zip(asked, known, strict=True) if not (outcome and outcome.judged)]
        rolled = self.side.answers(lacking)
        for (probe, repeat), outcome in zip(asked, known, strict=True):
            if not (outcome and outcome.judged):
                outcome = next(rolled)
                self.kept.keep(self.name, probe, repeat, outcome)
            yield outcome


def _whole_lines(path: Path) -> list[str]:
    """The lines of a file; one that an interruption left unfinished is cut off."""
    text = read_text(path, UsageError, _HINT)
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        with writing(path, _HINT), path.open("r+b") as file:
            file.truncate(len(whole.encode()))
    return whole.splitlines()
