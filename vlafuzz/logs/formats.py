"""Files of logs: lerobot's ``eval_info.json``, vla-eval's results, and CSV."""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from vlafuzz.common.reading import parse_json, read_text
from vlafuzz.common.text import shortened
from vlafuzz.errors import UsageError
from vlafuzz.logs.episodes import LoggedEpisode, judged

_FORMATS = "lerobot's eval_info.json, vla-eval's results, or CSV with a heading; docs/logs.md describes them"
# The names by which a column is known. All columns of conditions are joined; of the others the first counts.
_NAMES = {
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


def read_logs(paths: Sequence[Path]) -> list[LoggedEpisode]:
    """The episodes of an evaluation whose log may be several files; UsageError if it cannot be read."""
    resolved = [path.resolve() for path in paths]
    for path, place in zip(paths, resolved, strict=True):
        if resolved.count(place) > 1:
            raise UsageError(f"{path}: is given twice", hint="name every file once")
    episodes = [episode for path in paths for episode in _read(path)]
    if not judged(episodes):
        raise UsageError(f"{', '.join(map(str, paths))}: no episode says whether it succeeded", hint=_FORMATS)
    seen: dict[object, str] = {}
    for episode in episodes:
        key = (episode.run, episode.same) if episode.run and episode.same else episode.place
        if (before := seen.setdefault(key, episode.place)) != episode.place:
            hint = "leave one out; repeats of an episode need a column `run`, or a file of their own"
            raise UsageError(f"{episode.place}: is the same episode as {before}", hint=hint)
    return episodes


def _read(path: Path) -> Iterator[LoggedEpisode]:
    text = read_text(path, UsageError, _FORMATS).lstrip()
    if not text:
        raise UsageError(f"{path}: is empty", hint=_FORMATS)
    if text[0] not in "{[":
        return read_table(path, text)
    try:
        content = parse_json(text)
    except ValueError as error:
        raise UsageError(f"{path}: not JSON: {error}", hint=_FORMATS) from None
    keys = list(content) if isinstance(content, dict) else []
    reader = _lerobot if "per_task" in keys else _vla_eval if "tasks" in keys else None
    if reader is None:
        raise UsageError(f"{path}: is no log that is known: it has {shortened(keys)}", hint=_FORMATS)
    try:
        return iter(list(reader(str(path), content)))
    except (KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{path}: is laid out in another way: {type(error).__name__}: {error}", _FORMATS) from None


def _lerobot(path: str, content: dict[str, Any]) -> Iterator[LoggedEpisode]:
    """A list of successes for every task; the place in it is the number of the episode."""
    for task in content["per_task"]:
        suite, name = task["task_group"], str(task["task_id"])
        for number, success in enumerate(task["metrics"]["successes"]):
            place = f"{path}: per_task: {suite} {name}: episode {number}"
            yield _episode(place, success, suite=suite, task=name, state=str(number), run=path)


def _vla_eval(path: str, content: dict[str, Any]) -> Iterator[LoggedEpisode]:
    for task in content["tasks"]:
        for number, episode in enumerate(task["episodes"]):
            success = None if episode.get("failure_reason") else episode.get("metrics", {}).get("success")
            names = {"suite": content.get("benchmark", ""), "task": task["task"], "run": path}
            place = f"{path}: {task['task']}: episodes.{number}"
            yield _episode(place, success, state=str(episode.get("episode_id", "")), **names)


def read_table(path: Path, text: str) -> Iterator[LoggedEpisode]:
    """The episodes of a CSV file; commas, semicolons or tabs separate its cells."""
    delimiter = max(",;\t", key=text.partition("\n")[0].count)
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        heads = [head.strip() for head in next(rows)]
        columns = {holds: [heads.index(name) for name in names if name in heads] for holds, names in _NAMES.items()}
        if not columns["success"]:
            problem = f"no column is known to say whether an episode succeeded: {', '.join(heads)}"
            raise UsageError(f"{path}: {problem}", hint="call it success")
        for cells in filter(None, rows):
            place = f"{path}, line {rows.line_num}"
            if len(cells) != len(heads):
                hint = "a cell with a comma in it needs quotation marks"
                raise UsageError(f"{place}: has {len(cells)} cells, expected {len(heads)}", hint)
            found = {holds: [cells[index].strip() for index in indices] for holds, indices in columns.items()}
            value = {holds: " ".join(those if holds == "condition" else those[:1]) for holds, those in found.items()}
            yield _episode(place, value.pop("success"), **value)
    except csv.Error as error:
        raise UsageError(f"{path}, line {rows.line_num}: not CSV: {error}") from None


def _episode(place: str, success: object, **names: str) -> LoggedEpisode:
    said = "" if success is None else str(success).lower()
    if said not in _OUTCOMES:
        hint = "expected 1, 0, true or false; nothing where the episode ended in an error"
        raise UsageError(f"{place}: success is {shortened(success)}", hint)
    return LoggedEpisode(**names, place=place, success=_OUTCOMES[said])
