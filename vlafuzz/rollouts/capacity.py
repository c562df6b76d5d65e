"""How many workers this machine has room for."""

import os
from contextlib import suppress
from pathlib import Path

from vlafuzz.errors import UsageError

WORKERS = "VLAFUZZ_WORKERS"  # environment variable: the default of --workers
PER_WORKER = 1.5 * 2**30  # bytes: simulator, torch and mini take 1.0 GiB
_QUOTA = Path("/sys/fs/cgroup/cpu.max")
_MEMORY = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current"))


def usable_cores() -> int:
    """The cores that this process may use: a container may have fewer than its machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with suppress(OSError, ValueError):  # no such file or no limit
        quota, period = _QUOTA.read_text(encoding="ascii").split()
        cores = min(cores, max(1, round(int(quota) / int(period))))
    return cores


def usable_memory() -> float:
    """Bytes that this process and its children may still take."""
    free = float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_AVPHYS_PAGES"))
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        free = 1024.0 * int(next(line for line in lines if line.startswith("MemAvailable:")).split()[1])
    with suppress(OSError, ValueError):
        limit, taken = (int(path.read_text(encoding="ascii")) for path in _MEMORY)
        free = min(free, limit - taken)
    return free


def most_workers() -> int:
    """As many as there are cores and memory for, or as ``$VLAFUZZ_WORKERS`` says; a UsageError if that is no number."""
    wanted = os.environ.get(WORKERS)
    if wanted is None:
        return max(1, min(usable_cores(), int(usable_memory() // PER_WORKER)))
    if not (wanted.isdecimal() and int(wanted) > 0):
        raise UsageError(f"{WORKERS}={wanted}: not a number of workers", hint="expected 1 or more")
    return int(wanted)
