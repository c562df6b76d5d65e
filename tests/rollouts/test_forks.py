"""Forked processes end with the one that asked for them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

SCRIPT = """
import os, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from vlafuzz.rollouts import forks

if __name__ == "__main__":
    environment = dict(os.environ)
    with ProcessPoolExecutor(1, get_context("forkserver"), forks.settle_in, (environment,)) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        time.sleep(60)
"""


def is_there(process: int) -> bool:
    stat = Path(f"/proc/{process}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


def test_a_worker_that_waits_for_work_ends_when_its_parent_is_killed(tmp_path: Path):
    (tmp_path / "waits.py").write_text(SCRIPT)
    with subprocess.Popen([sys.executable, str(tmp_path / "waits.py")], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        assert is_there(worker)
        os.kill(parent.pid, signal.SIGKILL)
    deadline = time.monotonic() + 30
    while is_there(worker) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not is_there(worker)
