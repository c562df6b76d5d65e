"""Changes: what the last policy fails at by cause, against the shipped policy."""

from __future__ import annotations

import json
from pathlib import Path
from subprocess import CalledProcessError

from repair.steps import call
from repair.study import ROUND, Study, number_of


def changes(study: Study, name: str, weights: Path) -> list[dict[str, str]]:
    """One row for each cause that is fixed, remains or is new."""
    options, rows = study.options, list[dict[str, str]]()
    before = f"shipped-{number_of(name)}"
    study.fuzz({name: weights}, options.seed + 2 * ROUND)
    for task in options.tasks:
        stores = [options.out / "found" / policy / f"{task}.db" for policy in (before, name)]
        for store in stores:
            limits = f"--time={options.causes}", f"--workers={options.workers}"
            call("-m", "vlafuzz", "triage", store, *limits)
        try:
            compared = json.loads(call("-m", "vlafuzz", "diff", *stores, "--json"))
        except CalledProcessError:  # which says that neither has a certified cause
            continue
        rows += [
            {"task": task, "cause": cause["title"], "now": cause["standing"], "scenes": str(cause["scenes"])}
            for cause in compared["causes"]
        ]
    return rows
