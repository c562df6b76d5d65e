#!/usr/bin/env python
"""False alarms and power of `vlafuzz regress`, with simulated policies whose failure rates are known.

Every corpus has failing scenes and counterparts, selected by the outcomes of its own policy, and controls as
`vlafuzz export` records them. It is compared with policies that fail equally often, and with worse ones, by
the same code as on the command line; only policies and simulator are made up. A policy passes in a scene and
its neighbourhood with a probability that has a given distribution over scenes: independent of the baseline's,
or (related) equal to the baseline's in nine of ten scenes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import cast

import numpy as np

from vlafuzz.common.assets import corpus_dir
from vlafuzz.common.statistics import wilson
from vlafuzz.common.watch import SILENT
from vlafuzz.failures.corpus import controls
from vlafuzz.failures.corpus.corpus import Case, Corpus
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.failures.corpus.pairs import probes
from vlafuzz.failures.corpus.regress import compare
from vlafuzz.failures.corpus.sides import Recorded, Rerun
from vlafuzz.failures.triage.path import nominal
from vlafuzz.failures.triage.runner import SceneRunner
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.rollouts.setup import stored_space
from vlafuzz.store.records import Run
from vlafuzz.worlds.manipulation.jitter import load_jitter

TEMPLATE = corpus_dir() / "mini-pick-up"
CASES, REPEATS = 3, 5
OWN = 0.1  # share of scenes in which a related policy differs
LOSSES = (0.1, 0.2, 0.3)
FRESH = 10_000  # the bets were chosen with corpora of smaller seeds

# Probability of passing, by a number that is uniform over scenes; and its mean.
KINDS: dict[str, tuple[Callable[[float], float], float]] = {
    "stochastic, 0.3 to 0.7": (lambda u: 0.3 + 0.4 * u, 0.5),
    "stochastic, uniform": (lambda u: u, 0.5),
    "stochastic, bimodal": (lambda u: 0.95 if u < 0.5 else 0.05, 0.5),
    "deterministic, skill 0.3": (lambda u: float(u < 0.3), 0.3),
    "deterministic, skill 0.5": (lambda u: float(u < 0.5), 0.5),
    "deterministic, skill 0.7": (lambda u: float(u < 0.7), 0.7),
}


class Policy:
    """A runner whose policy passes with known probabilities.

    Args:
        name: of which all probabilities are a function.
        related: a policy that it agrees with in most scenes.
        loss: of the mean probability.
    """

    deterministic = True

    def __init__(
        self, kind: str, name: str, space: Space, *, related: str | None = None, loss: float = 0.0
    ) -> None:
        (self._rate, mean), self._name, self._related = KINDS[kind], name, related or name
        self.space, self._kept = space, 1 - loss / mean
        self._certain = kind.startswith("deterministic")
        self._rng = np.random.default_rng(int.from_bytes(hashlib.blake2b(name.encode()).digest()[:8], "big"))

    def passes(self, scene: Scene) -> bool:
        target = scene.targets[0]
        place = f"{target.object} {target.x:.2f} {target.y:.2f} {target.yaw // 20:.0f}"
        own = _uniform(f"{self._name} differs in {place}") < OWN
        rate = self._rate(_uniform(f"{self._name if own else self._related} in {place}"))
        if self._certain:
            return rate > 0.5 and _uniform(f"{self._name} keeps {place}") < self._kept
        return bool(self._rng.random() < rate * self._kept)

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        verdicts = [Verdict.PASSED if self.passes(scene) else Verdict.FAILED for scene in scenes]
        return [Outcome(verdict=verdict) for verdict in verdicts]

    def close(self) -> None:
        """Nothing to release."""


def _uniform(text: str) -> float:
    """A number in [0, 1) that looks random, the same for the same text."""
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=6).digest(), "big") / 2**48


@dataclass(frozen=True)
class Maker:
    """Makes corpora with the conditions and the kind of cases of a shipped one."""

    template: Corpus
    space: Space

    def corpus(self, policy: Policy, seed: int) -> Corpus:
        recorded = controls.record(cast(SceneRunner, policy), seed, controls.CONTROLS, SILENT)
        return replace(self.template, cases=self._cases(policy, seed), controls=recorded)

    def _cases(self, policy: Policy, seed: int) -> list[Case]:
        """Scenes that mostly fail, and pass with their target at its nominal place."""
        rng, cases = np.random.default_rng([seed, 1]), list[Case]()
        for _ in range(100 * CASES):
            scene = self.space.sample(rng)
            counterpart = self.space.reset(scene, ["target-position"])
            if self._passes(policy, scene) or not self._passes(policy, counterpart):
                continue
            control = nominal(self.space, scene)
            case = replace(self.template.cases[0], scene=scene, counterparts={"target-position": counterpart})
            passes = self._passes(policy, control)
            cases.append(replace(case, nominal=control, nominal_passes=passes))
            if len(cases) == CASES:
                break
        return cases

    def _passes(self, policy: Policy, scene: Scene) -> bool:
        around = [load_jitter().apply(scene, number) for number in range(REPEATS)]
        return 2 * sum(policy.passes(jittered) for jittered in around) > REPEATS


def _always(policy: Policy, run: Run) -> Policy:
    return policy


def simulate(kind: str, seed: int, maker: Maker) -> Counter[str]:
    """Alarms in one corpus, by comparison."""
    name = f"baseline {seed}, {kind}"
    baseline = Policy(kind, name, maker.space)
    corpus = maker.corpus(baseline, seed)
    scenes, recorded = probes(corpus), Recorded("recorded")
    again = Rerun("baseline", corpus.runs, lambda run: baseline)
    alarms: Counter[str] = Counter()
    for related, loss in [(related, loss) for related in (None, name) for loss in (0.0, *LOSSES)]:
        new = Policy(kind, f"new {related} {loss} {name}", maker.space, related=related, loss=loss)
        side = Rerun("new", corpus.runs, partial(_always, new))
        label = f"{'related' if related else 'independent'}, {100 * loss:.0f} points"
        alarms[label] += compare(scenes, side, recorded).alarm
        if not loss:
            alarms[f"{label}, both run anew"] += compare(scenes, side, again).alarm
    return alarms


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--corpora", type=int, default=400, help="of each kind")
    parser.add_argument(
        "--seed", type=int, default=FRESH, help=f"of the first corpus; those below {FRESH} chose the bets"
    )
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    options = parser.parse_args()
    template = read_corpus(TEMPLATE)
    maker = Maker(template, stored_space(TEMPLATE, template.runs[0]))
    controls.draw = cache(controls.draw)  # the n-th corpora of all kinds have the same scenes
    alarms: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    for done, seed in enumerate(range(options.seed, options.seed + options.corpora), start=1):
        for kind in KINDS:
            alarms[kind].update(simulate(kind, seed, maker))
        controls.draw.cache_clear()
        print(f"{done} of {options.corpora} corpora of each kind", file=sys.stderr, flush=True)
    for kind, counts in alarms.items():
        for comparison, count in sorted(counts.items()):
            low, high = wilson(count, options.corpora)
            share = f"{count / options.corpora:6.1%} ({low:.1%}-{high:.1%})"
            print(f"{kind:28}{comparison:40}{share}", flush=True)
    if options.out:
        figures = {"seed": options.seed, "corpora": options.corpora, "alarms": alarms}
        options.out.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
