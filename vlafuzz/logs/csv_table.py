"""Episodes in CSV: one a line, or a control beside a changed episode in one line."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from vlafuzz.errors import UsageError, suggestion
from vlafuzz.logs.episodes import CONTROL, Episode

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
    "control": ("control_correct", "control_success", "baseline_correct", "baseline_success"),
    "changed": ("intervention_correct", "intervention_success", "changed_correct", "changed_success"),
}
_OUTCOMES = {"1": True, "1.0": True, "true": True, "0": False, "0.0": False, "false": False, "": None}


def read_table(path: Path, text: str, columns: Mapping[str, str]) -> Iterator[Episode]:
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
            yield from _episodes(place, [cell.strip() for cell in cells], found)
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
    if not found["success"] and not (found["control"] and found["changed"]):
        raise UsageError(
            f"{path}: no column is known to say whether an episode succeeded: {', '.join(heads)}",
            hint="--column success=NAME; or control=NAME and changed=NAME, where a line has two episodes",
        )
    return found


def _episodes(place: str, cells: Sequence[str], found: Mapping[str, Sequence[int]]) -> Iterator[Episode]:
    value = {holds: " ".join(cells[index] for index in indices) for holds, indices in found.items()}
    common = {name: value[name] for name in ("suite", "task", "state", "seed")}
    if found["success"]:
        success = _outcome(place, value["success"])
        yield Episode(**common, condition=value["condition"], run=value["run"], place=place, success=success)
        return
    # The controls of one episode are its repeats, so that a run may have it several times: no run is named.
    for condition, holds in ((CONTROL, "control"), (value["condition"] or "changed", "changed")):
        yield Episode(**common, condition=condition, place=place, success=_outcome(place, value[holds]))


def _outcome(place: str, cell: str) -> bool | None:
    if cell.lower() not in _OUTCOMES:
        raise UsageError(
            f"{place}: success is {cell!r}",
            hint="expected 1, 0, true or false; nothing where the episode ended in an error",
        )
    return _OUTCOMES[cell.lower()]
