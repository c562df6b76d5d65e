#!/usr/bin/env python
"""Time that a campaign spends outside its rollouts: in the strategy's ask and tell, and in the store.

The first part runs one campaign of pinhole in the simulator per strategy, and shows the seconds of search and store and
their share of the wall time. All campaigns use one simulator that was started before. The second part runs one long
campaign per strategy on the toy evaluator, in a process of its own, and shows the milliseconds of search and store per
proposal for successive blocks, and the resident memory after each block.

Both parts use campaign.fuzz with a store on disk, which syncs every trial and is deleted in the end.
--rollouts 0 leaves out the first part, --evaluations 0 the second.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.search.toy import Region, Toy, near
from vlafuzz.campaign import config
from vlafuzz.campaign.fuzz import Campaign
from vlafuzz.campaign.tally import Tally
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.search.registry import STRATEGIES
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

CONDITIONS = (
    near("targets.0.x", -0.10, 0.32),
    near("targets.0.y", 0.12, 0.50),
    near("light.intensity", -2.0, 8.6),
    near("camera.roll", 2.0, 10.0),
)
SAMPLES, SHARE = 2000, 0.01  # the region is scaled so that 1 % of these scenes fail


@dataclass(frozen=True)
class Block:
    """Successive proposals: the last one, milliseconds per proposal, and resident memory after them."""

    proposals: int
    search_ms: float
    store_ms: float
    mib: float


class Clock:
    """Adds up the seconds in some methods of an object."""

    def __init__(self, timed: object, *names: str) -> None:
        self.seconds = 0.0
        for name in names:
            setattr(timed, name, partial(self._call, getattr(timed, name)))

    def _call(self, method: Callable[..., Any], *args: Any, **options: Any) -> Any:
        began = time.perf_counter()
        try:
            return method(*args, **options)
        finally:
            self.seconds += time.perf_counter() - began


def clocks(strategy: object, store: Store) -> tuple[Clock, Clock]:
    """Those of a strategy and a store in a campaign."""
    return Clock(strategy, "ask", "tell"), Clock(store, "add", "known", "keep_causes")


class Blocks:
    """Watches a campaign, and adds a block after every ``size`` proposals."""

    def __init__(self, size: int, parts: tuple[Clock, Clock]) -> None:
        self.blocks: list[Block] = []
        self._size, self._parts, self._before = size, parts, (0.0, 0.0)

    def __call__(self, tally: Tally) -> None:
        """Called when a trial is stored."""
        if tally.proposals % self._size:
            return
        now = (self._parts[0].seconds, self._parts[1].seconds)
        search, store = (1e3 * (b - a) / self._size for a, b in zip(self._before, now, strict=True))
        self._before = now
        self.blocks.append(Block(tally.proposals, search, store, resident()))


def resident() -> float:
    """Resident memory, MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def plan(options: argparse.Namespace, strategy: str, budget: int, folder: str) -> config.Plan:
    run = config.RunConfig(
        task=options.task,
        policy="pinhole",
        strategy=strategy,
        budget=budget,
        seed=options.seed,
        store=Path(folder) / "a.db",
    )
    return config.plan(run)


def space_of(options: argparse.Namespace) -> SearchSpace:
    return SearchSpace(load_operators(), load_catalogue(), options.task)


def simulate(options: argparse.Namespace) -> list[dict[str, Any]]:
    """One campaign per strategy in the simulator."""
    rows = []
    with TemporaryDirectory(dir=options.folder) as folder:
        first = plan(options, options.strategies[0], options.rollouts, folder)
        evaluator = make_evaluator(first.manifest, first.policy)
        with closing(LocalExecutor(evaluator)) as executor:
            scene = space_of(options).sample(np.random.default_rng(options.seed))
            list(executor.run([(0, scene)]))  # its start takes seconds
            with Store.open(first.store, "write") as store:
                for name in options.strategies:
                    prepared = plan(options, name, options.rollouts, folder)
                    search, storing = clocks(prepared.strategy, store)
                    summary = config.fuzz(prepared, store, executor, lambda tally: None, alone=True)
                    spent = {"search": search.seconds, "store": storing.seconds}
                    row: dict[str, Any] = {"strategy": name, "rollouts": summary.rollouts}
                    row |= {"proposals": summary.proposals, "seconds": summary.seconds}
                    row |= {f"{part}_seconds": seconds for part, seconds in spent.items()}
                    row |= {f"{part}_share": seconds / summary.seconds for part, seconds in spent.items()}
                    rows.append(row)
    return rows


def endure(options: argparse.Namespace, strategy: str) -> dict[str, Any]:
    """One long campaign on the toy."""
    with TemporaryDirectory(dir=options.folder) as folder:
        prepared, space = plan(options, strategy, options.evaluations, folder), space_of(options)
        scenes = [space.sample(np.random.default_rng([options.seed, 1, index])) for index in range(SAMPLES)]
        toy = Toy(
            Region(CONDITIONS).calibrated(scenes, SHARE),
            space.catalogue,
            min_distance=prepared.manifest.value("min_distance"),
        )
        with Store.open(prepared.store, "write") as store:
            watch = Blocks(options.block, clocks(prepared.strategy, store))
            summary = Campaign(
                manifest=prepared.manifest,
                space=space,
                strategy=prepared.strategy,
                executor=LocalExecutor(toy),
                store=store,
                patience=None,
                alone=True,
                watch=watch,
            ).run()
        size = prepared.store.stat().st_size / 2**20
    return {
        "strategy": strategy,
        "evaluations": summary.rollouts,
        "seconds": summary.seconds,
        "store_mib": size,
        "blocks": [asdict(block) for block in watch.blocks],
    }


def apart(work: Callable[..., Any], *args: Any) -> Any:
    """Work in a process of its own, so that its memory is its own, too."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(work, *args).result()


def show_simulated(rows: list[dict[str, Any]]) -> None:
    print("pinhole in the simulator")
    print(f"{'':14} rollouts  proposals  seconds  search s   share  store s   share")
    for row in rows:
        print(f"{row['strategy']:14} {row['rollouts']:8}  {row['proposals']:9}  {row['seconds']:7.1f}", end="  ")
        print(f"{row['search_seconds']:8.3f}  {row['search_share']:6.2%}", end="  ")
        print(f"{row['store_seconds']:7.3f}  {row['store_share']:6.2%}", flush=True)


def show_endured(row: dict[str, Any]) -> None:
    took = f"{row['evaluations']} evaluations in {row['seconds']:.0f} s, a store of {row['store_mib']:.1f} MiB"
    print(f"\n{row['strategy']} on the toy: {took}")
    print("proposals  search ms  store ms  resident MiB")
    for block in row["blocks"]:
        print(f"{block['proposals']:9}  {block['search_ms']:9.3f}  {block['store_ms']:8.3f}", end="  ")
        print(f"{block['mib']:12.1f}", flush=True)


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--task", default="pick-up")
    parser.add_argument("--strategies", nargs="+", default=list(STRATEGIES), choices=list(STRATEGIES))
    parser.add_argument("--rollouts", type=int, default=100, help="in the simulator, per strategy")
    parser.add_argument("--evaluations", type=int, default=20_000, help="of the toy, per strategy")
    parser.add_argument("--block", type=int, default=1000, help="proposals per block")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path(), help="folder for the stores")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    options = parser.parse_args()
    report: dict[str, list[dict[str, Any]]] = {"simulated": [], "endured": []}
    if options.rollouts:
        report["simulated"] = apart(simulate, options)
        if not options.json:
            show_simulated(report["simulated"])
    for name in options.strategies if options.evaluations else []:
        report["endured"].append(apart(endure, options, name))
        if not options.json:
            show_endured(report["endured"][-1])
    if options.json:
        print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
