"""Files of logs: lerobot's ``eval_info.json``, vla-eval's results, and CSV."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vlafuzz.common.reading import parse_json, read_text, validated
from vlafuzz.common.text import shortened
from vlafuzz.errors import UsageError, suggestion
from vlafuzz.logs.episodes import LoggedEpisode, judged

_MOST = 500  # suites or conditions, each with a row; larger numbers are those of episodes
_FORMATS = "lerobot's eval_info.json, vla-eval's results, or CSV with a heading; docs/logs.md describes them"
# What a column holds, with the names by which it is known without --column. All columns of conditions are
# joined; of the others the first name that is there counts.
NAMES: Mapping[str, tuple[str, ...]] = {
    "suite": ("suite", "task_suite", "task_suite_name", "task_group", "benchmark"),
    "task": ("task", "task_name", "task_index", "task_id"),
    "condition": ("condition", "change_type", "perturbation", "variation", "severity"),
    "state": (
        *("state", "init_state", "init_state_index", "init_state_id"),
        *("episode", "episode_index", "episode_ix", "episode_id", "trial"),
    ),
    "seed": ("seed", "policy_seed", "env_seed"),
    "run": ("run", "run_id"),
    "success": ("success", "is_success", "succeeded", "correct"),
}
_OUTCOMES = {"1": True, "1.0": True, "true": True, "0": False, "0.0": False, "false": False, "": None}


def read_logs(paths: Sequence[Path], columns: Mapping[str, str]) -> list[LoggedEpisode]:
    """The episodes of an evaluation whose log may be several files; UsageError if it cannot be read.

    ``columns`` are names of columns in CSV, by what they hold: see ``NAMES``.
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


def _read(path: Path, columns: Mapping[str, str]) -> Iterator[LoggedEpisode]:
    text = read_text(path, UsageError, _FORMATS)
    if not text.strip():
        raise UsageError(f"{path}: is empty", hint=_FORMATS)
    if text.lstrip()[0] not in "{[":
        return read_table(path, text, columns)
    try:
        content = parse_json(text)
    except ValueError as error:
        raise UsageError(f"{path}: not JSON: {error}", hint=_FORMATS) from None
    kinds = {"per_task": _lerobot, "tasks": _vla_eval}
    for key, reader in kinds.items():
        if isinstance(content, dict) and key in content:
            return reader(path, content)
    keys = shortened(list(content)) if isinstance(content, dict) else f"a {type(content).__name__}"
    raise UsageError(f"{path}: is no log that is known: it has {keys}", hint=_FORMATS)


def _check_once(episodes: Sequence[LoggedEpisode]) -> None:
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
class _Success:
    success: bool | None = None


@dataclass(frozen=True)
class _VlaEvalEpisode:
    episode_id: int | str | None = None
    metrics: _Success = _Success()
    failure_reason: str | None = None


@dataclass(frozen=True)
class _VlaEvalTask:
    task: str
    episodes: list[_VlaEvalEpisode]


@dataclass(frozen=True)
class _VlaEval:
    tasks: list[_VlaEvalTask]
    benchmark: str = ""


def _lerobot(path: Path, content: dict[str, Any]) -> Iterator[LoggedEpisode]:
    """A list of successes for every task; the place in it is the number of the episode."""
    for task in validated(list[_LeRobotTask], content["per_task"], f"{path}: per_task", UsageError):
        for number, success in enumerate(task.metrics.successes):
            yield LoggedEpisode(
                suite=task.task_group,
                task=str(task.task_id),
                state=str(number),
                run=str(path),
                place=f"{path}: per_task: {task.task_group} {task.task_id}: episode {number}",
                success=success,
            )


def _vla_eval(path: Path, content: dict[str, Any]) -> Iterator[LoggedEpisode]:
    log = validated(_VlaEval, content, path, UsageError)
    for task in log.tasks:
        for number, episode in enumerate(task.episodes):
            yield LoggedEpisode(
                suite=log.benchmark,
                task=task.task,
                state="" if episode.episode_id is None else str(episode.episode_id),
                run=str(path),
                place=f"{path}: {task.task}: episodes.{number}",
                success=None if episode.failure_reason else episode.metrics.success,
            )


def read_table(path: Path, text: str, columns: Mapping[str, str]) -> Iterator[LoggedEpisode]:
    """The episodes of a CSV file; commas, semicolons or tabs separate its cells."""
    heading = text.lstrip().partition("\n")[0]
    delimiter = max(",;\t", key=heading.count)
    rows = csv.reader(io.StringIO(text.lstrip(), newline=""), delimiter=delimiter, strict=True)
    try:
        heads = [head.strip() for head in next(rows)]
        found = _columns(path, heads, columns)
        for cells in filter(None, rows):
            place = f"{path}, line {rows.line_num}"
            if len(cells) != len(heads):
                raise UsageError(
                    f"{place}: has {len(cells)} cells, expected {len(heads)}",
                    hint="a cell with a comma in it needs quotation marks",
                )
            value = {holds: " ".join(cells[index].strip() for index in indices) for holds, indices in found.items()}
            success = _outcome(place, value.pop("success"))
            yield LoggedEpisode(**value, place=place, success=success)
    except csv.Error as error:
        raise UsageError(f"{path}, line {rows.line_num}: not CSV: {error}") from None


def _columns(path: Path, heads: Sequence[str], columns: Mapping[str, str]) -> dict[str, list[int]]:
    """Indices of the columns by what they hold; empty for what the table does not have."""
    twice = [head for head in heads if heads.count(head) > 1]
    if twice:
        raise UsageError(f"{path}: column {twice[0]!r} is there twice", hint="rename one of them")
    found: dict[str, list[int]] = {}
    for holds, names in NAMES.items():
        named = columns.get(holds)
        if named is not None and named not in heads:
            hint = suggestion(named, heads)
            raise UsageError(f"--column {holds}={named}: {path} has no such column", hint=hint)
        known = [heads.index(name) for name in ([named] if named else names) if name in heads]
        found[holds] = known if holds == "condition" else known[:1]
    if not found["success"]:
        raise UsageError(
            f"{path}: no column is known to say whether an episode succeeded: {', '.join(heads)}",
            hint="--column success=NAME",
        )
    return found


def _outcome(place: str, cell: str) -> bool | None:
    if cell.lower() not in _OUTCOMES:
        raise UsageError(
            f"{place}: success is {cell!r}",
            hint="expected 1, 0, true or false; nothing where the episode ended in an error",
        )
    return _OUTCOMES[cell.lower()]
