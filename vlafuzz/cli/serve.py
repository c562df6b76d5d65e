"""``vlafuzz serve``."""

import sys
import threading
from contextlib import closing, suppress
from typing import Annotated

import typer

from vlafuzz.cli.flags import option
from vlafuzz.cli.output import data
from vlafuzz.common.plugins import command
from vlafuzz.errors import check_number


def serve(
    policy: Annotated[str, typer.Argument(help="The policy: `vlafuzz list policies` lists them.")],
    port: Annotated[int, option("Where to listen; 0 for any port that is free.")] = 8000,
    host: Annotated[str, option("Address to listen at; 0.0.0.0 for all.")] = "127.0.0.1",
) -> None:
    """Serve a policy until interrupted; prints the name under which vlafuzz finds it.

    It speaks vla-eval's protocol. The name says what the numbers of its actions mean, so that a run need not guess.
    Simultaneous requests of several clients are batched into one call of the policy, up to its max_batch.
    """
    from vlafuzz.policies.clients.servers import needed
    from vlafuzz.rollouts.policies import make_policy

    with needed("vlafuzz serve"):
        from vlafuzz.policies.serving import serving

    check_number("--port", port, 0, 65535)
    with closing(make_policy(policy)) as served, serving(served, host, port) as name, suppress(KeyboardInterrupt):
        data().write(f"{name}\n")
        data().flush()
        sys.stderr.write(f"serving {served.spec.name}; Ctrl-C ends it\n")
        sys.stderr.write(f"hint: fuzz it with `{command('run', '--policy', name)}`\n")
        threading.Event().wait()
