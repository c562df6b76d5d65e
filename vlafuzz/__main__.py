"""``python -m vlafuzz`` and the command ``vlafuzz``: an interruption is heard from the first import on."""

import os
import signal
import sys


def main() -> int:
    """Run the command line as a process of its own; returns the exit code."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        from vlafuzz.cli import main as run
        from vlafuzz.cli.ending import INTERRUPTED, leave

        code = run()
    except KeyboardInterrupt:
        os.write(2, b"error: interrupted\n")
        os._exit(130)
    if code == INTERRUPTED:
        leave()  # Python would kill itself where the interruption came while it compiled something
    return code


if __name__ == "__main__":
    sys.exit(main())
