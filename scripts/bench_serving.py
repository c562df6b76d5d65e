#!/usr/bin/env python
"""The cost of a policy server: `mini` behind a server with several clients, against `mini` in process.

Two rates, both measured alternately with and without the server:

answers      observations answered per second, without a simulator. In process: ``act`` on a batch with one
             observation per client. Server: one process per client, which sends an observation over its own connection
             and waits for the actions before it sends the next. Since other load on the machine affects the rates, the
             CPU time per answer is shown as well: with the server, that of server and clients together.
simulators   control steps per second of as many simulators, each in a process, in the same scenes. In
process:
             one `mini` for all of them, which gets the observations that are ready in one batch (``shared``, see
             ``vlafuzz.policies.base.Policy``). Server: the same through `vlafuzz serve`. Both must go through the same
             states.

The server is `vlafuzz serve mini`, in a process of its own, on loopback; it returns only the actions of a chunk that
are executed.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from itertools import count
from multiprocessing import get_context
from multiprocessing.synchronize import Barrier
from pathlib import Path
from typing import Any

import numpy as np
from timed_rollouts import timed_rollouts

from vlafuzz.model import Scene
from vlafuzz.policies.base import EpisodeStart, Observation, Policy
from vlafuzz.policies.mini.policy import CAMERA, Mini
from vlafuzz.rollouts.executor import Executor
from vlafuzz.rollouts.forks import single_threaded
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.registry import Place, executor_at, policy_at
from vlafuzz.worlds.evaluator import SceneEvaluator
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

GOAL = 0.8  # of the rate without a server
TASK, WORDS = "pick-up", "pick up coke can"
Measured = dict[str, list[float]]
IN_PROCESS, SERVER = "in process", "server"


class Shared(Mini):
    """A mini that all simulators share."""

    shared = True


def observation(episode: str, step: int) -> Observation:
    rng = np.random.default_rng(step)
    picture = rng.integers(0, 256, (CAMERA.height, CAMERA.width, 3), np.uint8)
    return Observation(episode, step, WORDS, images={CAMERA.name: picture}, state=rng.random(7, np.float32))


def begin(policy: Policy, episode: str) -> None:
    policy.reset([EpisodeStart(episode, WORDS, TASK, 0)])


@contextmanager
def server(policy: str = "mini") -> Iterator[tuple[str, int]]:
    """A running server: its policy name, and its process id."""
    command = [sys.executable, "-m", "vlafuzz", "serve", policy, "--port", "0"]
    with single_threaded(), subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        try:
            assert running.stdout is not None
            yield running.stdout.readline().strip(), running.pid
        finally:
            running.terminate()


def client(name: str, steps: int, rounds: int, together: Barrier) -> None:
    """One of the client processes."""
    with closing(make_policy(name)) as policy:
        for _ in range(rounds):
            together.wait()  # for the measurement in process
            begin(policy, "episode")
            policy.act([observation("episode", 0)])  # the connection is open, and the rollout has begun
            seen = [observation("episode", step) for step in range(steps)]
            together.wait()
            for item in seen:
                policy.act([item])
            together.wait()


def cpu_seconds(processes: list[int]) -> float:
    """CPU seconds that these processes have used so far, in total."""
    stats = (Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split() for number in processes)
    return sum(int(fields[11]) + int(fields[12]) for fields in stats) / os.sysconf("SC_CLK_TCK")


def answers(options: argparse.Namespace, name: str, process: int) -> tuple[Measured, Measured]:
    """Answers per second, and CPU seconds per answer."""
    rates: Measured = {IN_PROCESS: [], SERVER: []}
    spent: Measured = {IN_PROCESS: [], SERVER: []}
    context, mini = get_context("spawn"), Mini()
    together = context.Barrier(options.clients + 1)
    arguments = (name, options.steps, options.rounds, together)
    clients = [context.Process(target=client, args=arguments) for _ in range(options.clients)]
    with single_threaded():
        for started in clients:
            started.start()
    others, total = [process, *(started.pid or 0 for started in clients)], options.steps * options.clients
    names = [str(number) for number in range(options.clients)]
    for _ in range(options.rounds):
        batches = [[observation(episode, step) for episode in names] for step in range(options.steps)]
        for episode in names:
            begin(mini, episode)
        began, before = time.perf_counter(), time.process_time()
        for batch in batches:
            mini.act(batch)
        spent[IN_PROCESS].append((time.process_time() - before) / total)
        rates[IN_PROCESS].append(total / (time.perf_counter() - began))
        together.wait()
        together.wait()
        began, before = time.perf_counter(), cpu_seconds(others)
        together.wait()
        spent[SERVER].append((cpu_seconds(others) - before) / total)
        rates[SERVER].append(total / (time.perf_counter() - began))
    for started in clients:
        started.join()
    return rates, spent


def make_evaluator(name: str, policy: Policy | None = None) -> SceneEvaluator:
    from vlafuzz.model import Conditions
    from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator

    catalogue, apart = load_catalogue(), load_operators().min_distance
    return ManiSkillEvaluator(
        Conditions(task=TASK, world={"min_distance": apart}), policy or make_policy(name), catalogue
    )


def workers(options: argparse.Namespace, name: str) -> Executor:
    """An executor with one simulator per process."""
    place = Place(workers=options.clients, executor="processes")
    return executor_at(place, partial(make_evaluator, name), policy_at(place, name, TASK))


def rollouts(executor: Executor, scenes: list[Scene]) -> tuple[float, list[str]]:
    """Control steps per second, and the hashes of all states."""
    seconds, done = timed_rollouts(executor, scenes)
    steps = sum(len(rollout.actions) for rollout in done)
    return steps / seconds, [rollout.states_hash for rollout in done]


def simulators(options: argparse.Namespace, name: str) -> Measured:
    space = SearchSpace(load_operators(), load_catalogue(), TASK)
    drawn = (space.sample(np.random.default_rng([options.seed, number])) for number in count())
    shared = f"python:{Path(__file__).stem}:{Shared.__name__}"
    rates: Measured = {IN_PROCESS: [], SERVER: []}
    with ExitStack() as stack:
        executors = {
            kind: stack.enter_context(closing(workers(options, policy)))
            for kind, policy in ((IN_PROCESS, shared), (SERVER, name))
        }
        for executor in executors.values():  # starts all simulators
            rollouts(executor, [next(drawn) for _ in range(2 * options.clients)])
        for number in range(options.rounds):
            scenes, states = [next(drawn) for _ in range(options.scenes)], {}
            for kind in (IN_PROCESS, SERVER) if number % 2 else (SERVER, IN_PROCESS):
                rate, states[kind] = rollouts(executors[kind], scenes)
                rates[kind].append(rate)
            assert states[IN_PROCESS] == states[SERVER], "mini took another trajectory with the server"
    return rates


def summary(rates: Measured) -> dict[str, Any]:
    ratios = [there / here for here, there in zip(rates[IN_PROCESS], rates[SERVER], strict=True)]
    return {"per_second": rates, "ratios": ratios, "ratio": statistics.median(ratios)}


def machine() -> dict[str, Any]:
    models = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    name = models[0].partition(":")[2].strip() if models else platform.processor()
    return {"processor": name, "cores": os.cpu_count(), "load_before": os.getloadavg()[0]}


def show(part: str, unit: str, measured: dict[str, Any]) -> None:
    here, there = (statistics.median(measured["per_second"][kind]) for kind in (IN_PROCESS, SERVER))
    rates = f"{here:7.1f} {unit} in process, {there:7.1f} through the server"
    low, high = min(measured["ratios"]), max(measured["ratios"])
    print(f"{part:11}{rates}: {measured['ratio']:.2f} times ({low:.2f} to {high:.2f})", flush=True)


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--steps", type=int, default=15, help="answers per client and round; 0 to skip")
    parser.add_argument("--scenes", type=int, default=16, help="per round; 0 to skip the simulators")
    parser.add_argument("--seed", type=int, default=0, help="of the scenes")
    parser.add_argument("--json", type=Path, help="file to write the figures to")
    options = parser.parse_args()
    report: dict[str, Any] = {"machine": machine(), "clients": options.clients}
    print(", ".join(f"{name}: {value}" for name, value in report["machine"].items()))
    print(f"{options.clients} clients; goal: at least {GOAL} times the rate in process")
    with server() as (name, process):
        if options.steps:
            rates, spent = answers(options, name, process)
            report["answers"] = summary(rates)
            show("answers", "answers/s", report["answers"])
            report["cpu_ms"] = {kind: 1e3 * statistics.median(seconds) for kind, seconds in spent.items()}
            here, there = report["cpu_ms"].values()
            print(f"CPU time of an answer: {here:.2f} ms in process, {there:.2f} ms with server and client")
        if options.scenes:
            report["simulators"] = summary(simulators(options, name))
            show("simulators", "control steps/s", report["simulators"])
    if options.json:
        options.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
