"""Sides of a comparison: a policy that is rolled out, or what is known of one, scene by scene."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from pydantic import ConfigDict

from vlafuzz.common.files import writing
from vlafuzz.common.reading import parse_json, read_text, validated
from vlafuzz.errors import UsageError
from vlafuzz.failures.corpus.controls import REGRESS, number_of
from vlafuzz.failures.corpus.pairs import Probe
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Manifest

_HINT = "give --answers the file of an earlier `vlafuzz bisect`, or a new one"


class Side(Protocol):
    """One of the two policies that are compared."""

    @property
    def name(self) -> str: ...

    def answer(self, probe: Probe, repeat: int) -> Outcome:
        """The result of the n-th rollout in a scene."""


@dataclass(frozen=True)
class Recorded:
    """A baseline without rollouts: the corpus's records of its own policy."""

    name: str

    def answer(self, probe: Probe, repeat: int) -> Outcome:
        """The recorded verdict."""
        return Outcome(verdict=Verdict.PASSED if probe.passed else Verdict.FAILED)


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

    def answer(self, probe: Probe, repeat: int) -> Outcome:
        """One rollout: in a control as it is, in another scene with a jitter and seed of no other use."""
        run, scene, number = self._runs[probe.run], probe.scene, number_of(probe.scene)
        runner = self._runners[run.key(seeded=False)]
        if probe.group != "control":
            number = number_of(scene, REGRESS, repeat)
            scene = runner.space.jittered(scene, number)
        return runner.evaluate([scene], [run.seed + number])[0]

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
    answers: Answers
    side: Side

    def answer(self, probe: Probe, repeat: int) -> Outcome:
        """The known result, or that of a rollout."""
        known = self.answers.known.get((self.name, probe.scene.digest, repeat))
        if known is None or not known.judged:
            known = self.side.answer(probe, repeat)
            self.answers.keep(self.name, probe, repeat, known)
        return known


def _whole_lines(path: Path) -> list[str]:
    """The lines of a file; one that an interruption left unfinished is cut off."""
    text = read_text(path, UsageError, _HINT)
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        with writing(path, _HINT), path.open("r+b") as file:
            file.truncate(len(whole.encode()))
    return whole.splitlines()
