#!/usr/bin/env python
"""Seconds of triage by where it rolls out; results have to be the same everywhere.

    python scripts/bench_triage.py    # pinhole: one and two workers, ray, a shared model; ten minutes each
    python scripts/bench_triage.py --policy mini --places 1 2 shared:2 server --findings 4

The failures are the first ones of a campaign of random scenes, which every place runs for itself. A place is a number
of workers, ``ray:N``, ``shared:N`` with one model for all workers, or ``server`` with the model behind vla-eval's
protocol and as many scenes at a time as it takes. The start of workers is part of a triage, as it is for its user.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before the first import of NumPy and torch
os.environ.setdefault("LP_NUM_THREADS", "0")

import argparse
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from bench_serving import server

from vlafuzz.campaign import config
from vlafuzz.common.plugins import trust
from vlafuzz.failures.triage.pipeline import runner_of_run, triage
from vlafuzz.policies.base import Policy
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.registry import Place, place_of
from vlafuzz.store.records import Triaged
from vlafuzz.store.store import Store

OF_ALL = "BENCH_TRIAGE_POLICY"  # environment variable: what ``shared_model`` makes


def shared_model() -> Policy:
    """The policy of the bench, which all workers share."""
    return make_policy(os.environ[OF_ALL])


shared_model.shared = True  # type: ignore[attr-defined]


@contextmanager
def named(place: str, policy: str) -> Iterator[tuple[str, Place]]:
    """The policy's name and the place of its rollouts."""
    kind, _, count = place.partition(":")
    if kind == "server":
        with server(policy) as (address, _):
            yield address, place_of(int(count or 1), None)
    elif kind == "shared":
        name = "python:bench_triage:shared_model"
        trust(name)
        yield name, place_of(int(count), "processes")
    elif kind == "ray":
        yield policy, place_of(int(count), "ray")
    else:
        yield policy, place_of(int(kind), None)


def measure(place: str, options: argparse.Namespace, folder: Path) -> tuple[dict[str, Any], list[Any]]:
    """The row of a place, and what triage found."""
    with named(place, options.policy) as (policy, where):
        run = config.RunConfig(
            policy=policy,
            task=options.task,
            strategy="random",
            budget=3 * options.findings,
            seed=options.seed,
            store=folder / f"{place.replace(':', '-')}.db",
            workers=where.workers,
            executor=where.kind,
        )
        config.start(config.plan(run), lambda tally: None)
        assert run.store is not None
        with Store.open(run.store, "write") as store:
            some = store.findings()[: options.findings]
            began = time.perf_counter()
            triage(store, partial(runner_of_run, run.store), findings=some, place=where)
            seconds = time.perf_counter() - began
            rows = {row.scene.digest: row for row in store.triaged()}
    found = [rows[finding.scene.digest] for finding in some if finding.scene.digest in rows]
    rollouts = sum(row.policy_rollouts + row.expert_rollouts for row in found)
    row = {"place": place, "findings": len(found), "seconds": seconds, "rollouts": rollouts}
    return row | {"rollouts_an_hour": 3600 * rollouts / seconds}, [result(row) for row in found]


def result(row: Triaged) -> Any:
    """All of a finding's evidence but time and the name of the policy."""
    shrunk = row.shrunk.digest if row.shrunk else None
    counts = row.repeats, row.failures, row.policy_rollouts, row.expert_rollouts
    return row.scene.digest, row.bucket, shrunk, row.signature, row.certified, counts, row.detail


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--policy", default="pinhole")
    parser.add_argument("--task", default="pick-up")
    parser.add_argument("--places", nargs="+", default=["1", "2", "ray:2", "shared:2"])
    parser.add_argument("--findings", type=int, default=20)
    parser.add_argument("--seed", type=int, default=33)
    parser.add_argument("--json", type=Path, help="file to write the figures to")
    options = parser.parse_args()
    os.environ[OF_ALL] = options.policy
    rows, results = list[dict[str, Any]](), list[list[Any]]()
    with TemporaryDirectory() as folder:
        for place in options.places:
            row, found = measure(place, options, Path(folder))
            rows, results = [*rows, row], [*results, found]
            faster = rows[0]["seconds"] / row["seconds"]
            print(
                f"{place:10}{row['findings']:3} failures in {row['seconds']:6.1f} s, {row['rollouts']} rollouts, "
                f"{row['rollouts_an_hour']:.0f} an hour, {faster:.2f} times",
                flush=True,
            )
            if found != results[0]:
                differing = [pair for pair in zip_longest(results[0], found) if pair[0] != pair[1]]
                parser.exit(1, f"{place}: {len(differing)} results differ, the first being\n{differing[0]}\n")
            if options.json:
                options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
