"""``vlafuzz watch``."""

import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.flags import TrustFlag, label_option
from vlafuzz.cli.output import data
from vlafuzz.errors import check_number


def command(
    store: Annotated[Path, typer.Argument(help="A store that `vlafuzz run` writes to.")],
    label: Annotated[
        str | None, label_option("--label", "Follow the last run of this model.", "the last run")
    ] = None,
    port: Annotated[
        int, typer.Option(help="Where to listen on this machine; 0 for any port that is free.")
    ] = 0,
    trust: TrustFlag = False,
    films: Annotated[
        bool, typer.Option("--films/--no-films", help="Film the newest failure by its stored actions.")
    ] = True,
) -> None:
    """Follow a run on a page in the browser, until interrupted; prints the page's address.

    The page shows how far the run is, how often the policy fails, the causes so far, and the newest failure.
    Only this machine can open it. The store is read, never written.
    """
    check_number("--port", port, 0, 65535)
    from vlafuzz.report.follow import Films, PageServer, live_page
    from vlafuzz.report.live import Live
    from vlafuzz.store.store import Store

    with Store.open(store) as opened:
        live, made = Live(opened, label), Films(store) if films else None
        with PageServer(port, lambda: live_page(live, made)) as server, suppress(KeyboardInterrupt):
            data().write(f"{server.address}\n")
            data().flush()
            sys.stderr.write(f"following {store}; Ctrl-C ends it\n")
            server.serve_forever()
