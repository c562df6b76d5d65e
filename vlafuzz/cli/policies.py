"""``vlafuzz policies``, ``vlafuzz strategies`` and ``vlafuzz serve``."""

import inspect
import shlex
import sys
import threading
from contextlib import closing, suppress
from typing import Annotated

import typer

from vlafuzz.cli.output import data, print_rows
from vlafuzz.errors import check_number


def policies(
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """List the policies that can be tested."""
    from vlafuzz.policies.clients.profiles import known_profiles
    from vlafuzz.policies.clients.servers import client
    from vlafuzz.rollouts.policies import known_policies

    rows = [{"policy": name, "is": says} for name, says in known_policies().items()]
    rows += [
        {"policy": f"{client(protocol).form}?profile={name}", "is": profile.about}
        for name, profile in known_profiles().items()
        for protocol in profile.protocols
    ]
    print_rows(rows, json=json, csv=csv, title="policies")


def strategies(
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """List the strategies that propose scenes."""
    from vlafuzz.campaign.config import STRATEGY
    from vlafuzz.search.registry import STRATEGIES

    first = dict.fromkeys([STRATEGY, *STRATEGIES])  # the default
    rows = [{"strategy": name, "is": _says(STRATEGIES[name])} for name in first]
    if not (json or csv):
        rows[0]["strategy"] += " (default)"
    print_rows(rows, json=json, csv=csv, title="strategies")


def worlds(
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """List the worlds that come with vlafuzz, with their tasks and robots, the defaults first."""
    from vlafuzz.worlds import known_worlds

    most = None if json or csv else 8  # tasks in a table
    rows = []
    for name, world in known_worlds().items():
        tasks, robots = list(world.tasks), list(world.robots)
        shown = tasks[:most] + ["…"] * (len(tasks[:most]) < len(tasks))
        row = {"world": name, "tasks": shown, "robots": robots}
        rows.append(
            row if json else {key: value if isinstance(value, str) else ", ".join(value) for key, value in row.items()}
        )
    print_rows(rows, json=json, csv=csv, title="worlds")


def _says(strategy: object) -> str:
    """The first paragraph of its docstring, in one line."""
    return " ".join((inspect.getdoc(strategy) or "").partition("\n\n")[0].split())


def serve(
    policy: Annotated[str, typer.Argument(help="The policy: `vlafuzz list policies` lists them.")],
    protocol: Annotated[str, typer.Option(help="vla-eval, openpi or http (OpenVLA's /act).")] = "vla-eval",
    port: Annotated[int, typer.Option(help="Where to listen; 0 for any port that is free.")] = 8000,
    host: Annotated[str, typer.Option(help="Address to listen at; 0.0.0.0 for all.")] = "127.0.0.1",
) -> None:
    """Serve a policy until interrupted; prints the name under which vlafuzz finds it.

    The name says what the numbers of its actions mean, so that a run need not guess. Simultaneous requests of several
    clients are batched into one call of the policy, up to its max_batch.
    """
    from vlafuzz.policies.serving.serve import says_of, serving
    from vlafuzz.rollouts.policies import make_policy

    check_number("--port", port, 0, 65535)
    with (
        closing(make_policy(policy)) as served,
        serving(served, protocol, host, port) as name,
        suppress(KeyboardInterrupt),
    ):
        data().write(f"{name}\n")
        data().flush()
        run = shlex.join(["vlafuzz", "run", "--policy", name])
        sys.stderr.write(f"serving {served.spec.name}; Ctrl-C ends it\n{says_of(served.spec)}\n")
        sys.stderr.write(f"hint: fuzz it with `{run}`\n")
        threading.Event().wait()
