"""Code that is tried in a process of its own, since native libraries and drivers may crash."""

import os
import subprocess
import sys


def tried(code: str, seconds: float = 120.0, **environment: str) -> tuple[list[str], str]:
    """The lines that Python code prints in a new process, and why it failed in a line; empty if it did not.

    ``environment``: variables, unless they are set here already.
    """
    command, variables = [sys.executable, "-c", code], {**environment, **os.environ}
    try:
        child = subprocess.run(command, env=variables, capture_output=True, text=True, timeout=seconds)
    except subprocess.TimeoutExpired:
        return [], f"no answer within {seconds:.0f} s"
    except OSError as error:
        return [], f"no process for it: {error.strerror}"
    if child.returncode < 0:
        return [], f"it crashed with signal {-child.returncode}"
    problem = (child.stderr.strip().splitlines() or ["no output"])[-1] if child.returncode else ""
    return child.stdout.splitlines(), problem
