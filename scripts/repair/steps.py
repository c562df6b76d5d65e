"""Steps of a repair, each in a folder or file of its own: what is there already is not done again."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Protocol, TypeVar

from rich.console import Console
from rich.progress import track

from vlafuzz.policies.mini.policy import SHIPPED

SCRIPTS = Path(__file__).parents[1]
ONE_THREAD = {"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}
T = TypeVar("T", covariant=True)


class Job(Protocol[T]):
    """Work for one process."""

    def run(self) -> T: ...


def side_by_side(jobs: Iterable[Job[T]], workers: int, what: str) -> list[T]:
    """What the jobs return, in order, with a progress bar; jobs may come while others run."""
    os.environ.update(ONE_THREAD)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        running = [pool.submit(job.run) for job in jobs]
        return [one.result() for one in track(running, what, console=Console(stderr=True))]


@contextmanager
def once(path: Path) -> Iterator[Path | None]:
    """Where to put a file or folder, which gets its name when the block has ended; None if it is there."""
    if path.exists():
        yield None
        return
    unfinished = path.with_name(f"unfinished-{path.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    if unfinished.is_dir():
        shutil.rmtree(unfinished)
    unfinished.unlink(missing_ok=True)
    yield unfinished
    unfinished.rename(path)


def fuzz(weights: Path, task: str, budget: int, seed: int, store: Path, workers: int) -> Path:
    """A store of random scenes, which is named after its task."""
    policy = "mini" if weights == SHIPPED else f"mini:{weights}"
    flags = {"policy": policy, "task": task, "strategy": "random", "budget": budget, "seed": seed}
    with once(store) as unfinished:
        if unfinished:
            flags |= {"store": unfinished, "workers": workers}
            call("-m", "vlafuzz", "run", *(f"--{name}={value}" for name, value in flags.items()))
    return store


def train(
    demos: Path,
    old: Path,
    init: Path,
    out: Path,
    recipe: Sequence[str] = (),
    gpu: int | None = None,
    *,
    quantized: bool = True,
) -> Path:
    """Weights that continue from ``init``; half of what they learn from is ``old``."""
    if not (out / "figures").exists():
        where = {} if gpu is None else {"CUDA_VISIBLE_DEVICES": str(gpu)}
        folders = demos, "--replay", old, "--init", init, "--out", out
        lines = call(SCRIPTS / "train_mini.py", *folders, *recipe, environment=where)
        if quantized:
            call(SCRIPTS / "quantize_mini.py", "--weights", out, "--scenes", 2)
        (out / "figures").write_text(lines)
    return out


def old_demonstrations(out: Path, number: int, workers: int) -> Path:
    """That many demonstrations of each task as `mini` was trained with, but fresh ones."""
    numbers = "--episodes", *[number] * 4, "--workers", *[max(1, workers // 4)] * 4
    with once(out) as unfinished:
        if unfinished:
            call(SCRIPTS / "make_demos.py", *numbers, "--out", unfinished)
    return out


def together(folder: Path, parts: Sequence[Path]) -> Path:
    """A folder of links to these."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, part in enumerate(parts):
        link = folder / f"{number:04d}-{part.name}"
        if not link.exists():
            link.symlink_to(part.resolve())
    return folder


def call(*command: object, environment: dict[str, str] | None = None) -> str:
    """The output of a Python program; its errors go where ours go."""
    done = subprocess.run(
        [sys.executable, *map(str, command)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        env=os.environ | ONE_THREAD | (environment or {}),
    )
    return done.stdout
