#!/usr/bin/env python
"""Success rates with 95 % intervals from the logs of an evaluation by another tool: docs/logs.md says what is read."""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from scipy.special import ndtri, stdtrit

from vlafuzz.cli.output import print_json, print_rows
from vlafuzz.common.reading import parse_json, read_text
from vlafuzz.common.statistics import Share, wilson
from vlafuzz.common.text import shortened
from vlafuzz.errors import UsageError

TAIL = 0.975  # of intervals of 95 %
MOST = 5  # tasks in a table: those that fail most often
FORMATS = "lerobot's eval_info.json, vla-eval's results, or CSV with a heading; docs/logs.md describes them"
# The names by which a column is known. All columns of conditions are joined; of the others the first counts.
NAMES = {
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
OUTCOMES = {"1": True, "1.0": True, "true": True, "0": False, "0.0": False, "false": False, "": None}


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One episode; a name that the log does not have is empty.

    Attributes:
        condition: what was changed, such as ``camera_shift high``.
        state: number of the initial state, or of the episode; ``seed``: of the policy or the environment.
        run: the evaluation, which has every episode once.
        place: file and line.
        success: None where the episode ended in an error, which is no failure.
    """

    suite: str = ""
    task: str = ""
    condition: str = ""
    state: str = ""
    seed: str = ""
    run: str = ""
    place: str
    success: bool | None

    @property
    def start(self) -> tuple[str, ...]:
        """Where the episode begins: episodes with the same start may be alike, whatever their condition."""
        begins = self.state or self.seed
        return (self.suite, self.task, begins) if begins else (self.run, self.place)


@dataclass(frozen=True, kw_only=True)
class SuccessRate:
    """The success rate of some episodes; ``errors``: further ones that ended in an error, counted for neither."""

    suite: str = ""
    task: str = ""
    condition: str = ""
    success: Share
    errors: int


def read_logs(paths: Sequence[Path]) -> list[Episode]:
    """The episodes of an evaluation whose log may be several files; UsageError if it cannot be read."""
    if len({path.resolve() for path in paths}) < len(paths):
        raise UsageError(f"{', '.join(map(str, paths))}: a file is given twice", hint="name every file once")
    episodes = [episode for path in paths for episode in _read(path)]
    if all(episode.success is None for episode in episodes):
        raise UsageError(f"{', '.join(map(str, paths))}: no episode says whether it succeeded", hint=FORMATS)
    seen: dict[object, str] = {}
    for one in episodes:
        names = (one.run, one.suite, one.task, one.condition, one.state, one.seed)
        key = names if one.run and (one.state or one.seed) else one.place
        if (before := seen.setdefault(key, one.place)) != one.place:
            hint = "leave one out; repeats of an episode need a column `run`, or a file of their own"
            raise UsageError(f"{one.place}: is the same episode as {before}", hint=hint)
    return episodes


def _read(path: Path) -> Iterator[Episode]:
    text = read_text(path, UsageError, FORMATS).lstrip()
    if not text:
        raise UsageError(f"{path}: is empty", hint=FORMATS)
    if text[0] not in "{[":
        return _table(path, text)
    try:
        content = parse_json(text)
    except ValueError as error:
        raise UsageError(f"{path}: not JSON: {error}", hint=FORMATS) from None
    keys = list(content) if isinstance(content, dict) else []
    reader = _lerobot if "per_task" in keys else _vla_eval if "tasks" in keys else None
    if reader is None:
        raise UsageError(f"{path}: is no log that is known: it has {shortened(keys)}", hint=FORMATS)
    try:
        return iter(list(reader(str(path), content)))
    except (KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{path}: is laid out in another way: {type(error).__name__}: {error}", FORMATS) from None


def _lerobot(path: str, content: dict[str, Any]) -> Iterator[Episode]:
    """A list of successes for every task; the place in it is the number of the episode."""
    for task in content["per_task"]:
        suite, name = task["task_group"], str(task["task_id"])
        for number, success in enumerate(task["metrics"]["successes"]):
            place = f"{path}: per_task: {suite} {name}: episode {number}"
            yield _episode(place, success, suite=suite, task=name, state=str(number), run=path)


def _vla_eval(path: str, content: dict[str, Any]) -> Iterator[Episode]:
    for task in content["tasks"]:
        for number, episode in enumerate(task["episodes"]):
            success = None if episode.get("failure_reason") else episode.get("metrics", {}).get("success")
            names = {"suite": content.get("benchmark", ""), "task": task["task"], "run": path}
            place = f"{path}: {task['task']}: episodes.{number}"
            yield _episode(place, success, state=str(episode.get("episode_id", "")), **names)


def _table(path: Path, text: str) -> Iterator[Episode]:
    """The episodes of a CSV file; commas, semicolons or tabs separate its cells."""
    delimiter = max(",;\t", key=text.partition("\n")[0].count)
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        heads = [head.strip() for head in next(rows)]
        columns = {holds: [heads.index(name) for name in names if name in heads] for holds, names in NAMES.items()}
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


def _episode(place: str, success: object, **names: str) -> Episode:
    said = "" if success is None else str(success).lower()
    if said not in OUTCOMES:
        hint = "expected 1, 0, true or false; nothing where the episode ended in an error"
        raise UsageError(f"{place}: success is {shortened(success)}", hint)
    return Episode(**names, place=place, success=OUTCOMES[said])


def rates(episodes: Sequence[Episode]) -> list[SuccessRate]:
    """The rates by suite, by condition and by task, where there are several; the first one is of all episodes."""

    def by(*names: str) -> list[SuccessRate]:
        groups = dict[tuple[str, ...], list[Episode]]()
        for episode in episodes:
            groups.setdefault(tuple(getattr(episode, name) for name in names), []).append(episode)
        return [_rate(some, **dict(zip(names, key, strict=True))) for key, some in groups.items()]

    suites, conditions, tasks = by("suite"), by("condition"), by("suite", "task")
    found = [*(by() if len(suites) > 1 else []), *suites]
    return found + conditions * (len(conditions) > 1) + tasks * (len(tasks) > len(suites))


def _rate(episodes: Sequence[Episode], **of: str) -> SuccessRate:
    """The rate of some episodes; where several have the same start, these are a group."""
    judged = [(episode.start, episode.success) for episode in episodes if episode.success is not None]
    apart = len({start for start, _ in judged}) == len(judged)
    counted = Share.of_counts(sum(passed for _, passed in judged), len(judged)) if apart else grouped(judged)
    return SuccessRate(**of, success=counted, errors=len(episodes) - len(judged))


def grouped(cases: Sequence[tuple[Hashable, bool]]) -> Share:
    """The share of cases, each with its group; those of one group may be alike.

    The interval is Wilson's for the effective number of cases, reduced further when there are few groups: Korn,
    Graubard 1998; Franco, Little, Louis, Slud 2019 <https://pmc.ncbi.nlm.nih.gov/articles/PMC6690503>. With one
    group, or where all or no cases are positive, it is Wilson's of all cases, which may be too narrow.
    """
    groups: dict[Hashable, list[bool]] = {}
    for of, positive in cases:
        groups.setdefault(of, []).append(positive)
    count, of = sum(positive for _, positive in cases), len(cases)
    effective = of if count in (0, of) else _effective(list(groups.values()))
    return Share(count, of, *wilson(count / max(of, 1) * effective, effective))


def _effective(groups: Sequence[Sequence[bool]]) -> float:
    """The number of independent cases whose share would vary as that of groups."""
    number = sum(map(len, groups))
    mean = sum(map(sum, groups)) / number
    # The variance of a ratio of totals, by linearisation.
    apart = sum((sum(group) - mean * len(group)) ** 2 for group in groups)
    if len(groups) < 2 or not apart:
        return float(number)
    variance = apart / number**2 * len(groups) / (len(groups) - 1)
    few = (float(ndtri(TAIL)) / float(stdtrit(len(groups) - 1, TAIL))) ** 2
    return float(min(number, few * (mean - mean**2) / variance))


def print_rates(title: str, some: Sequence[SuccessRate], *names: str) -> None:
    rows = [
        {name: getattr(rate, name) or "all" for name in names}
        | {"episodes": rate.success.of, "success": str(rate.success), "failed": rate.success.of - rate.success.count}
        | ({"errors": rate.errors} if any(one.errors for one in some) else {})
        for rate in some
    ]
    if rows:
        print_rows(rows, title=title)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="+", type=Path, help="of lerobot, vla-eval or CSV; several are one evaluation")
    parser.add_argument("--json", action="store_true", help="print one object")
    given = parser.parse_args(arguments)
    try:
        found = rates(read_logs(given.logs))
    except UsageError as error:
        sys.stderr.write(f"error: {error}\n" + (f"hint: {error.hint}\n" if error.hint else ""))
        return error.exit_code
    name = ", ".join(map(str, given.logs))
    if given.json:
        print_json({"log": name, "rates": list(map(asdict, found))})
        return 0
    tasks = sorted((rate for rate in found if rate.task), key=lambda rate: rate.success.share)
    some = f"The {MOST} of {len(tasks)} tasks that fail most" if len(tasks) > MOST else "Tasks"
    print_rates(name, [rate for rate in found if not (rate.condition or rate.task)], "suite")
    print_rates("Conditions", [rate for rate in found if rate.condition], "condition")
    print_rates(some, tasks[:MOST], "suite", "task")
    return 0


if __name__ == "__main__":
    sys.exit(main())
