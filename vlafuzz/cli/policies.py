"""``vlafuzz policies``."""

from __future__ import annotations

from typing import Annotated

import typer

from vlafuzz.cli.output import print_rows


def command(
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """List the policies that can be tested."""
    from vlafuzz.clients.profiles import known_profiles
    from vlafuzz.policies.registry import client, known_policies

    rows = [{"policy": name, "is": says} for name, says in known_policies().items()]
    rows += [
        {"policy": f"{client(protocol).form}?profile={name}", "is": profile.about}
        for name, profile in known_profiles().items()
        for protocol in profile.protocols
    ]
    print_rows(rows, json=json, csv=csv, title="policies")
