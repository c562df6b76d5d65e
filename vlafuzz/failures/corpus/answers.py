"""Outcomes of rollouts that are kept in a file, so that what was interrupted can go on."""

import json
from dataclasses import dataclass
from pathlib import Path

from pydantic import ConfigDict

from vlafuzz.common.files import writing
from vlafuzz.common.reading import parse_json, read_text, validated
from vlafuzz.errors import UsageError
from vlafuzz.failures.corpus.pairs import Answer, Probe
from vlafuzz.failures.corpus.regress import Side
from vlafuzz.model.label import Model, not_served
from vlafuzz.model.outcome import Verdict

_HINT = "give --answers the file of an earlier `vlafuzz bisect` or `diff`, or a new one"


@dataclass(frozen=True)
class _Row:
    """A line of the file: a policy with its label, the digest of a scene, and whether it passed there.

    ``passed`` is None where the rollout broke. ``repeat`` tells several rollouts in one scene apart.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")
    policy: str
    scene: str
    passed: bool | None
    repeat: int = 0


class Answers:
    """What is known already. Rollouts that broke are tried again.

    Args:
        path: a file of JSON lines, which grows with every outcome; None to keep them in memory only.

    Raises:
        UsageError: the file cannot be read or written, or is none of these.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._known: dict[tuple[str, str, int], Answer] = {}
        if path is not None:
            with writing(path, _HINT), path.open("a"):
                pass  # it can be written
            for number, line in enumerate(_whole_lines(path), start=1):
                self._read(line, f"{path}, line {number}")

    def __len__(self) -> int:
        return sum(answer.judged for answer in self._known.values())

    def of(self, side: Side, model: Model) -> Side:
        """A side that is asked only for what is not known of its model."""
        return _Remembering(side, str(model), self)

    def without(self, model: Model, served: str) -> Side:
        """The known results of a model that cannot be asked, since ``served`` answers at its address.

        Its ``answer`` raises a PrerequisiteError where none is known.
        """
        return _Absent(model, served, self)

    def get(self, policy: str, probe: Probe, repeat: int) -> Answer | None:
        return self._known.get((policy, probe.scene.digest, repeat))

    def keep(self, policy: str, probe: Probe, repeat: int, answer: Answer) -> None:
        self._known[policy, probe.scene.digest, repeat] = answer
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
        self._known[row.policy, row.scene, row.repeat] = Answer(verdict)


@dataclass(frozen=True)
class _Remembering:
    side: Side
    model: str
    answers: Answers

    @property
    def name(self) -> str:
        return self.side.name

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """The known result, or that of a rollout."""
        known = self.answers.get(self.model, probe, repeat)
        if known is None or not known.judged:
            known = self.side.answer(probe, repeat)
            self.answers.keep(self.model, probe, repeat, known)
        return known


@dataclass(frozen=True)
class _Absent:
    model: Model
    served: str
    answers: Answers

    @property
    def name(self) -> str:
        return self.model.short

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """The known result."""
        known = self.answers.get(str(self.model), probe, repeat)
        if known is None:
            raise not_served(self.model, self.served)
        return known


def _whole_lines(path: Path) -> list[str]:
    """The lines of a file; one that an interruption left unfinished is cut off."""
    text = read_text(path, UsageError, _HINT)
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        with writing(path, _HINT), path.open("r+b") as file:
            file.truncate(len(whole.encode()))
    return whole.splitlines()
