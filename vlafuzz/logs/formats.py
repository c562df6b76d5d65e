"""Files of logs: lerobot's ``eval_info.json``, vla-eval's results, and CSV."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from vlafuzz.common.reading import parse_json, read_text, validated
from vlafuzz.common.text import shortened
from vlafuzz.errors import UsageError
from vlafuzz.logs.csv_table import read_table
from vlafuzz.logs.episodes import Episode, judged

_OPTIONAL: TypeAdapter[bool | None] = TypeAdapter(bool | None)
_MOST = 500  # suites or conditions, each with a row; larger numbers are those of episodes
_FORMATS = "lerobot's eval_info.json, vla-eval's results, or CSV with a heading; docs/logs.md describes them"


def read_logs(paths: Sequence[Path], columns: Mapping[str, str]) -> list[Episode]:
    """The episodes of an evaluation whose log may be several files.

    Args:
        columns: names of columns in CSV, by what they hold: see ``csv_table.NAMES``.

    Raises:
        UsageError: a file cannot be read, has another format, or has an episode twice.
    """
    resolved = [path.resolve() for path in paths]
    for path, place in zip(paths, resolved, strict=True):
        if resolved.count(place) > 1:
            raise UsageError(f"{path}: is given twice", hint="name every file once")
    episodes = [episode for path in paths for episode in _read(path, columns)]
    if not judged(episodes):
        files = ", ".join(str(path) for path in paths)
        raise UsageError(f"{files}: no episode says whether it succeeded", hint=_FORMATS)
    _check_once(episodes)
    for name in ("suite", "condition"):
        if (number := len({getattr(episode, name) for episode in episodes})) > _MOST:
            hint = f"is another column the {name}? --column {name}=NAME"
            raise UsageError(f"{paths[0]}: has {number} different names of a {name}", hint)
    return episodes


def _read(path: Path, columns: Mapping[str, str]) -> Iterator[Episode]:
    text = read_text(path, UsageError, _FORMATS)
    if not text.strip():
        raise UsageError(f"{path}: is empty", hint=_FORMATS)
    if text.lstrip()[0] not in "{[":
        return read_table(path, text, columns)
    try:
        content = parse_json(text)
    except ValueError as error:
        raise UsageError(f"{path}: not JSON: {error}", hint=_FORMATS) from None
    kinds = {"per_task": _lerobot, "per_episode": _lerobot_before, "tasks": _vla_eval}
    for key, reader in kinds.items():
        if isinstance(content, dict) and key in content:
            return reader(path, content)
    keys = shortened(list(content)) if isinstance(content, dict) else f"a {type(content).__name__}"
    raise UsageError(f"{path}: is no log that is known: it has {keys}", hint=_FORMATS)


def _check_once(episodes: Sequence[Episode]) -> None:
    seen: dict[object, str] = {}
    for episode in episodes:
        if not episode.run or episode.same is None:
            continue
        before = seen.setdefault((episode.run, episode.same), episode.place)
        if before != episode.place:
            hint = "leave one out; repeats of an episode need a column `run`, or a file of their own"
            raise UsageError(f"{episode.place}: is the same episode as {before}", hint=hint)


@dataclass(frozen=True)
class _Metrics:
    successes: list[bool]


@dataclass(frozen=True)
class _LeRobotTask:
    task_group: str
    task_id: int
    metrics: _Metrics


@dataclass(frozen=True)
class _LeRobotEpisode:
    episode_ix: int
    success: bool
    seed: int | None = None


@dataclass(frozen=True)
class _VlaEvalEpisode:
    """Up to version 0.0.4 success is beside the number, since then in the metrics."""

    episode_id: int | str | None = None
    success: bool | None = None
    metrics: dict[str, Any] = field(default_factory=dict)
    failure_reason: str | None = None


@dataclass(frozen=True)
class _VlaEvalTask:
    task: str
    episodes: list[_VlaEvalEpisode]


@dataclass(frozen=True)
class _VlaEval:
    tasks: list[_VlaEvalTask]
    benchmark: str = ""


def _lerobot(path: Path, content: dict[str, Any]) -> Iterator[Episode]:
    """Of lerobot 0.4: a list of successes for every task; the place in it is the number of the episode."""
    for task in validated(list[_LeRobotTask], content["per_task"], f"{path}: per_task", UsageError):
        for number, success in enumerate(task.metrics.successes):
            yield Episode(
                suite=task.task_group,
                task=str(task.task_id),
                state=str(number),
                run=str(path),
                place=f"{path}: per_task: {task.task_group} {task.task_id}: episode {number}",
                success=success,
            )


def _lerobot_before(path: Path, content: dict[str, Any]) -> Iterator[Episode]:
    """Of lerobot up to 0.3: one task, which the log does not name."""
    kept = validated(list[_LeRobotEpisode], content["per_episode"], f"{path}: per_episode", UsageError)
    for number, episode in enumerate(kept):
        yield Episode(
            state=str(episode.episode_ix),
            seed="" if episode.seed is None else str(episode.seed),
            run=str(path),
            place=f"{path}: per_episode.{number}",
            success=episode.success,
        )


def _vla_eval(path: Path, content: dict[str, Any]) -> Iterator[Episode]:
    log = validated(_VlaEval, content, path, UsageError)
    for task in log.tasks:
        for number, episode in enumerate(task.episodes):
            place = f"{path}: {task.task}: episodes.{number}"
            counted = episode.metrics.get("success", episode.success)
            success = validated(_OPTIONAL, counted, f"{place}: success", UsageError)
            state = "" if episode.episode_id is None else str(episode.episode_id)
            yield Episode(
                suite=log.benchmark,
                task=task.task,
                state=re.sub(r".*_ep(?=\d+$)", "", state),  # up to 0.0.4: the task, _ep and the number
                run=str(path),
                place=place,
                success=None if episode.failure_reason else success,
            )
