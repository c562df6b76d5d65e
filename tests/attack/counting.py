"""Runs mutated inputs in a child process with bounds on time and memory, and counts the reactions."""

import logging
import resource
import shutil
import signal
import tempfile
import time
import traceback
import warnings
import zlib
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from tests.attack import samples
from tests.attack.reactions import is_fair
from tests.attack.readers import READERS, Reader
from tests.attack.servers import SERVERS
from tests.attack.stored import STORED
from tests.attack.used import USED
from tests.attack.wires import FRAMES

TARGETS: dict[str, tuple[Reader, int]] = {**READERS, **STORED, **USED, **FRAMES, **SERVERS}
SECONDS = 5.0  # of a processor that a reaction may take
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
    slowest: float = 0.0
    faults: dict[str, str] = field(default_factory=dict)  # one for each place in the code

    def add(self, number: int, kind: str, detail: str, seconds: float) -> None:
        """Count the reaction to an input; a traceback's detail begins with its place."""
        self.inputs += 1
        self.slowest = max(self.slowest, seconds)
        setattr(self, kind, getattr(self, kind) + 1)
        if detail:
            self.faults.setdefault(detail.partition("\n")[0], f"input {number}: {detail}")


def reaction(name: str, seed: int, number: int) -> tuple[str, str]:
    """What a reader makes of an input: ``accepted``, ``refused``; ``tracebacks`` or ``hangs``, with where."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), number])
    folder = Path(tempfile.mkdtemp(prefix="attack-"))
    try:
        TARGETS[name][0](rng, folder)
    except HangError as error:
        return "hangs", _place(error)
    except Exception as error:
        return ("refused", "") if is_fair(error) else ("tracebacks", _place(error))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return "accepted", ""


def count(name: str, inputs: int, seed: int, first: int = 0) -> Count:
    """The reactions to the inputs from ``first`` on."""
    samples.make_all()
    counted, numbers = Count(), iter(range(first, first + inputs))
    while counted.inputs < inputs:
        with ProcessPoolExecutor(1, get_context("fork"), _bound) as child:
            for number, _ in zip(numbers, range(SLICE), strict=False):
                try:
                    counted.add(number, *child.submit(_timed, name, seed, number).result(12 * SECONDS))
                except BrokenProcessPool:
                    counted.add(number, "tracebacks", "the process died", 0.0)
                    break
                except TimeoutError:
                    counted.add(number, "hangs", "hangs in a library", 12 * SECONDS)
                    for process in child._processes.values():
                        process.kill()
                    break
    return counted


def _bound() -> None:
    """In the child."""
    logging.disable()
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGPROF, _alarm)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY,) * 2)


def _timed(name: str, seed: int, number: int) -> tuple[str, str, float]:
    began = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        return *reaction(name, seed, number), time.process_time() - began
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def _alarm(*_: object) -> None:
    raise HangError


def _place(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "vlafuzz" in Path(frame.filename).parts]
    last = (own or frames)[-1]
    return f"{type(error).__name__} at {last.filename}:{last.lineno}\n{str(error)[-800:]}"
