#!/usr/bin/env python
"""Triage of simulated policies whose true failure rates are known, without a simulator.

Each policy fails more often where a planted condition of one or two operators holds. Its rates are drawn from beta
distributions; between them the rate changes at once (``sharp``), over a stretch (``smooth``), or from nearly 0 to
nearly 1 (``bimodal``); ``deterministic`` ones fail always or never. To ``additive`` ones every value adds some load:
they fail where it is too much, mostly by one to four operators together. Of the minimal scenes it is reported how many
truly fail more than half the time, and how many truly pass that often without any one operator; of the findings whose
planted operators truly are a minimal cause, how many it finds.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median

import numpy as np

from vlafuzz.common.statistics import Share
from vlafuzz.failures.triage.triager import Triager
from vlafuzz.model import Gene, Outcome, Rollout, Scene, Verdict
from vlafuzz.store.records import Finding, Triaged
from vlafuzz.worlds.manipulation.jitter import jittered
from vlafuzz.worlds.manipulation.operators import TargetType
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

SPACE = SearchSpace(load_operators(), load_catalogue(), "pick-up")
STAGES = ("grasp", "lift", "success")
KINDS = ("sharp", "smooth", "bimodal", "deterministic", "additive")
LOADS, BEARABLE, TOGETHER = ((0.0, 0.1, 0.25, 0.4, 0.7), 0.8, 1.3)  # the last: exponent of the norm that adds up
NOTHING = np.zeros(0, dtype=np.float32)


@dataclass(frozen=True)
class Slope:
    """How far a value is beyond its threshold, in widths: positive where the policy is worse."""

    operator: str
    value: Callable[[Scene], float]
    threshold: float
    width: float

    def beyond(self, scene: Scene) -> float:
        return (self.value(scene) - self.threshold) / self.width


# By operator: a value that grows away from nominal, the range of its thresholds, the width of a smooth edge.
VALUES: dict[str, tuple[Callable[[Scene], float], float, float, float]] = {
    "light": (lambda scene: -math.log2(scene.light.intensity), 0.8, 2.5, 0.4),
    "camera-orientation": (lambda scene: scene.camera.yaw, 1.0, 3.0, 0.4),
    "camera-position": (lambda scene: scene.camera.distance, 0.01, 0.03, 0.004),
    "target-position": (lambda scene: scene.targets[0].x, -0.02, 0.06, 0.01),
    "target-orientation": (lambda scene: abs(scene.targets[0].yaw), 30.0, 100.0, 12.0),
    "confounders": (lambda scene: len(scene.confounders), 0.5, 1.5, 0.25),
}


@dataclass
class Simulated:
    """A runner whose policy fails at a known rate; the expert solves everything.

    Attributes:
        rates: of failure far on either side of all thresholds.
    """

    slopes: Sequence[Slope]
    rates: tuple[float, float]
    smooth: bool
    seed: int
    deterministic: bool = False
    renderer: str | None = None
    rollouts: int = 0
    space: SearchSpace = field(default=SPACE, init=False)
    stages: tuple[str, ...] = field(default=STAGES, init=False)

    def rate(self, scene: Scene) -> float:
        """The true rate."""
        low, high = self.rates
        beyond = [slope.beyond(scene) for slope in self.slopes]
        if not self.smooth:
            return high if min(beyond) > 0 else low
        return low + (high - low) * math.prod(1 / (1 + math.exp(min(-4 * value, 50))) for value in beyond)

    def around(self, scene: Scene) -> float:
        """The true rate in the scene's neighbourhood."""
        return float(np.mean([self.rate(jittered(scene, number)) for number in range(10**6, 10**6 + 64)]))

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        return [self._outcome(scene, number) for scene, number in zip(scenes, numbers, strict=True)]

    def _outcome(self, scene: Scene, number: int) -> Outcome:
        if rejection := check_static(scene, SPACE.catalogue, SPACE.operators.min_distance):
            return Outcome.invalid(rejection.check, rejection.reason)
        self.rollouts += 1
        rng = np.random.default_rng([self.seed, int(scene.digest, 16), number])
        return _failed() if rng.random() < self.rate(scene) else _passed()

    def solve(self, scene: Scene, attempt: int, solver: str = "expert") -> Outcome:
        return _passed()

    def play(self, scene: Scene, actions: object) -> Outcome:
        return _passed()

    def close(self) -> None: ...


@dataclass
class Additive(Simulated):
    """Fails where deviations add up; a rollout in a scene always ends alike.

    Attributes:
        loads: by value, of the whole way to the lower and to the upper end of its range.
        clutter: load of a confounder.
        steepness: of the rate at ``BEARABLE``, per load.
    """

    loads: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    clutter: float = 0.0
    steepness: float = 0.0

    def rate(self, scene: Scene) -> float:
        low, high = self.rates
        too_much = self.load(scene) - BEARABLE
        return low + (high - low) / (1 + math.exp(min(-self.steepness * too_much, 50)))

    def load(self, scene: Scene) -> float:
        values = SPACE.values(scene)
        total = 0.0
        for path, (down, up) in self.loads.items():
            away = _away(SPACE.by_path[path], values[path])
            total += (up * away if away > 0 else -down * away) ** TOGETHER
        return float(total ** (1 / TOGETHER)) + self.clutter * len(scene.confounders)


def _away(gene: Gene, value: float) -> float:
    """How far a value is from nominal, in halves of its range; 1 for another category."""
    start = SPACE.nominal_values[gene.path]
    if gene.kind == "category":
        return float(value != start)
    if gene.grid.wraps:
        return ((value - start + 180) % 360 - 180) / 180
    return 2 * (value - start) / (gene.grid.high - gene.grid.low)


def additive(seed: int) -> Additive:
    """A policy to which everything is some load."""
    rng = np.random.default_rng([seed, KINDS.index("additive")])
    rates = float(rng.beta(1, 25)), float(rng.beta(25, 1))
    loads = {
        gene.path: (float(rng.choice(LOADS)), float(rng.choice(LOADS)))
        for gene in SPACE.genes
        if not gene.neutral and gene.operator != TargetType.name and not gene.slot.startswith("confounders")
    }
    clutter, steepness = float(rng.choice([0.0, 0.0, 0.15, 0.3])), float(rng.choice([15.0, 40.0, 200.0]))
    return Additive(
        [], rates, smooth=True, seed=seed, deterministic=True, loads=loads, clutter=clutter, steepness=steepness
    )


def _rollout(reached: tuple[str, ...]) -> Rollout:
    success = reached == STAGES
    return Rollout(
        success_once=success,
        success_at_end=success,
        reached=reached,
        progress=len(reached) / len(STAGES),
        trace=NOTHING,
        actions=NOTHING.reshape(0, 7),
        states_hash="",
        seconds=0.0,
    )


def _failed() -> Outcome:
    return Outcome(verdict=Verdict.FAILED, rollouts=(_rollout(()),), lost_stage=STAGES[0])


def _passed() -> Outcome:
    return Outcome(verdict=Verdict.PASSED, rollouts=(_rollout(STAGES),), progress=1.0)


def policy(kind: str, seed: int) -> Simulated:
    """A policy of a kind, with one or two planted operators or, if ``additive``, none."""
    if kind == "additive":
        return additive(seed)
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    slopes = []
    for index in rng.choice(len(VALUES), rng.integers(1, 3), replace=False):
        name = list(VALUES)[index]
        value, low, high, width = VALUES[name]
        slopes.append(Slope(name, value, float(rng.uniform(low, high)), width))
    rates = {"deterministic": (0.0, 1.0), "bimodal": (float(rng.beta(1, 30)), float(rng.beta(30, 1)))}.get(
        kind, (float(rng.beta(2, 12)), float(rng.beta(8, 2)))
    )
    return Simulated(slopes, rates, kind == "smooth", seed, kind == "deterministic")


def finding(simulated: Simulated, seed: int) -> Scene | None:
    """A random fair scene in which the policy failed once; None where that hardly happens."""
    rng = np.random.default_rng([seed, 1])
    for _ in range(3000):
        scene = SPACE.sample(rng)
        if simulated.evaluate([scene], [-1 % 2**32])[0].verdict is Verdict.FAILED:
            return scene
    return None


def reset(scene: Scene, names: Sequence[str]) -> Scene:
    return SPACE.reset(scene, [operator for name in names for operator in SPACE.groups[name]])


def is_cause(simulated: Simulated, scene: Scene) -> bool:
    """Whether the planted operators make a scene fail mostly, and each of them is needed for that."""
    planted = [slope.operator for slope in simulated.slopes]
    only = reset(scene, [name for name in SPACE.groups if name not in planted])
    without = [reset(only, [name]) for name in planted]
    if any(check_static(shown, SPACE.catalogue, SPACE.operators.min_distance) for shown in (only, *without)):
        return False
    return simulated.around(only) > 0.5 and all(simulated.around(shown) < 0.5 for shown in without)


def is_needed(simulated: Simulated, triaged: Triaged) -> bool:
    """Whether a minimal scene truly passes mostly without any one of its operators."""
    counterparts = triaged.counterparts
    all_there = set(counterparts) == set(triaged.operators)
    return all_there and all(simulated.around(scene) < 0.5 for scene in counterparts.values())


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--findings", type=int, default=200, help="of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first policy")
    options = parser.parse_args()
    for kind in options.kinds:
        print(json.dumps({"kind": kind, **trial(kind, options.findings, options.seed)}), flush=True)


def trial(kind: str, findings: int, seed: int) -> dict[str, object]:
    """The figures of one kind."""
    buckets, truly, rates, spent = Counter[str](), 0, [], []
    causes = recovered = 0
    number = seed
    done = 0
    while done < findings:
        simulated = policy(kind, number)
        scene = finding(simulated, number)
        number += 1
        if scene is None:
            continue
        done += 1
        triaged = Triager(simulated).triage(Finding(scene, "p", 0, ""))
        assert isinstance(triaged, Triaged)
        buckets[triaged.bucket] += 1
        spent.append(triaged.policy_rollouts)
        minimal = triaged.bucket == "minimal"
        if minimal and triaged.shrunk is not None:
            rates.append(simulated.around(triaged.shrunk))
            truly += rates[-1] >= 0.5 and is_needed(simulated, triaged)
        if simulated.slopes and simulated.around(scene) > 0.5 and is_cause(simulated, scene):
            causes += 1
            recovered += minimal and set(triaged.operators) == {slope.operator for slope in simulated.slopes}
        if done % 20 == 0:
            print(f"{kind}: {done} of {findings}", file=sys.stderr, end="\r")
    true = sum(rate >= 0.5 for rate in rates)
    return {
        "buckets": dict(buckets),
        "minimal with a true rate of at least one half": str(Share.of_counts(true, len(rates))),
        "truly minimal": str(Share.of_counts(truly, len(rates))),
        "mean true rate": round(float(np.mean(rates)), 3) if rates else None,
        "true minimal causes found": f"{recovered} of {causes}: {Share.of_counts(recovered, causes)}",
        "rollouts a finding, median": median(spent),
        "mean": round(float(np.mean(spent)), 1),
        "90 %": float(np.quantile(spent, 0.9)),
    }


if __name__ == "__main__":
    main()
