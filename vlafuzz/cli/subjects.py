"""``vlafuzz subjects``."""

from __future__ import annotations

from typing import Annotated

import typer

from vlafuzz.cli.output import print_rows


def command(
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """List the subjects that can be tested."""
    from vlafuzz.subjects.profiles import known_profiles
    from vlafuzz.subjects.registry import SERVERS, known_subjects

    rows = [{"subject": name, "is": says} for name, says in known_subjects().items()]
    rows += [
        {"subject": f"{SERVERS[protocol].form}?profile={name}", "is": profile.about}
        for name, profile in known_profiles().items()
        for protocol in profile.protocols
    ]
    print_rows(rows, json=json, csv=csv, title="subjects")
