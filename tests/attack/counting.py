"""Runs mutated inputs in child processes with bounds on time and memory, and counts the reactions."""

import logging
import multiprocessing
import resource
import shutil
import signal
import tempfile
import time
import traceback
import warnings
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.attack import samples
from tests.attack.folders import FOLDERS
from tests.attack.reactions import is_fair
from tests.attack.readers import READERS, Reader
from tests.attack.servers import SERVERS
from tests.attack.stored import STORED
from tests.attack.used import USED
from tests.attack.wires import FRAMES

TARGETS: dict[str, tuple[Reader, int]] = {
    **READERS, **STORED, **FOLDERS, **USED, **FRAMES, **SERVERS
}  # fmt: skip
SECONDS = 5.0  # that a reaction may take, not counting those in which other processes have the processor
MEMORY = 1 << 30  # bytes that it may take beyond what the process has
SLICE = 250  # inputs of one child


class HangError(BaseException):
    """A reaction took too long."""


@dataclass
class Count:
    """The reactions to the inputs of one reader."""

    inputs: int = 0
    refused: int = 0
    accepted: int = 0
    hangs: int = 0
    tracebacks: int = 0
    seconds: float = 0.0
    slowest: float = 0.0
    mebibytes: int = 0
    faults: dict[str, str] = field(default_factory=dict)  # one for each place in the code

    def add(self, number: int, kind: str, detail: str, seconds: float) -> None:
        """Count the reaction to an input; a traceback's detail begins with its place."""
        self.inputs += 1
        self.seconds, self.slowest = self.seconds + seconds, max(self.slowest, seconds)
        setattr(self, kind, getattr(self, kind) + 1)
        if detail:
            self.faults.setdefault(detail.partition("\n")[0], f"input {number}: {detail}")


def reaction(name: str, seed: int, number: int, seconds: float = 0.0) -> tuple[str, str]:
    """What a reader makes of an input: ``accepted``, ``refused``; ``tracebacks`` or ``hangs``, with where.

    ``seconds``: after which it hangs; 0 for no limit.
    """
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), number])
    folder = Path(tempfile.mkdtemp(prefix="attack-"))
    _waited[0] = _waiting()
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        TARGETS[name][0](rng, folder)
    except HangError as error:
        return "hangs", _place(error)
    except Exception as error:
        return ("refused", "") if is_fair(error) else ("tracebacks", _place(error))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        shutil.rmtree(folder, ignore_errors=True)
    return "accepted", ""


def count(name: str, inputs: int, seed: int, first: int = 0) -> Count:
    """The reactions to the inputs from ``first`` on."""
    samples.make_all()
    counted, number = Count(), first
    while number < first + inputs:
        last = min(number + SLICE, first + inputs)
        for done, kind, detail, seconds, mebibytes in _slice(name, seed, number, last):
            counted.add(done, kind, detail, seconds)
            counted.mebibytes = max(counted.mebibytes, mebibytes)
        number = first + counted.inputs
    return counted


def _slice(name: str, seed: int, first: int, last: int) -> Iterator[tuple[int, str, str, float, int]]:
    """The reactions to some inputs; ends at an input that the child does not survive."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    child = context.Process(target=_work, args=(theirs, name, seed, first, last))
    child.start()
    theirs.close()
    try:
        for number in range(first, last):
            try:
                if not ours.poll(12 * SECONDS):
                    yield number, "hangs", "hangs in a library", 12 * SECONDS, 0
                    return
                yield (number, *ours.recv())
            except EOFError:
                child.join()
                yield number, "tracebacks", f"the process died: {child.exitcode}", 0.0, 0
                return
    finally:
        child.kill()
        child.join()
        ours.close()


def _work(pipe: Any, name: str, seed: int, first: int, last: int) -> None:
    logging.disable()
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGALRM, _alarm)
    before = _pages(1)
    limit = _pages(0) + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    for number in range(first, last):
        began = time.monotonic() - _waiting()
        kind, detail = reaction(name, seed, number, SECONDS)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        pipe.send((kind, detail, time.monotonic() - _waiting() - began, max(0, peak - before) >> 20))


def _pages(column: int) -> int:
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[column]
    return int(pages) * resource.getpagesize()


_waited = [0.0]  # seconds that this process had waited for a processor when the present input began


def _waiting() -> float:
    """Seconds for which this process was ready to run, but did not."""
    return int(Path("/proc/self/schedstat").read_text(encoding="ascii").split()[1]) / 1e9


def _alarm(*_: object) -> None:
    now = _waiting()
    waited, _waited[0] = now - _waited[0], now
    if waited < 0.1:
        raise HangError
    signal.setitimer(signal.ITIMER_REAL, waited)


def _place(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    own = [
        frame for frame in frames if "/vlafuzz/vlafuzz/" in frame.filename or "vlafuzz" in Path(frame.filename).parts
    ]
    last = (own or frames)[-1]
    return f"{type(error).__name__} at {last.filename}:{last.lineno}\n{str(error)[-800:]}"
