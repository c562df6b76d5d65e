"""Runs that are compared must be of one version of policy, simulator and code."""

from collections.abc import Sequence
from pathlib import Path

from vlafuzz.errors import UsageError
from vlafuzz.model.conditions import Origin, Role
from vlafuzz.store.records import Manifest, Run


def check_one_version(path: Path, runs: Sequence[Run], here: Manifest | None, flag: str) -> None:
    """Raise a UsageError unless one version made all runs, wherever that was; with ``here`` it is this one.

    Args:
        flag: the option that names another place for the runs of another version.
    """
    roles = set(Role) - {Role.PLACE}
    for run in runs:
        for name in run.manifest.differences(here or runs[0].manifest, roles=roles, origins=[Origin.HERE]):
            other = "is installed" if here else f"run {runs[0].id}"
            raise UsageError(
                f"{path}: run {run.id} was made by another version than {other}: its {name} differs",
                hint=f"runs of two versions do not compare: give another {flag}",
            )
