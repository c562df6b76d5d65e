#!/usr/bin/env python
"""Check the causes of a store on scenes that its run has not seen.

First each certified cause: in scenes with its operators alone, anywhere in its range, how often does the policy fail,
and how often with each operator reset? Then random scenes: how many of the failures does a cause of the list predict,
and how many of those pass when the operators of the causes that predict them are reset?
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from vlafuzz.common.plugins import EVERYTHING, trusting
from vlafuzz.common.statistics import Share
from vlafuzz.failures.mechanisms import reset
from vlafuzz.failures.regions import Range
from vlafuzz.model import Causes, Scene, Space, Verdict
from vlafuzz.rollouts.scene_runner import SimulatorSceneRunner
from vlafuzz.store.records import FoundCause, Triaged
from vlafuzz.store.store import Store

MOST = 5000  # random scenes among which those in a range are looked for


@dataclass(frozen=True, eq=False)
class Listed:
    """A cause of the list, certified or not."""

    space: Space
    found: FoundCause
    triaged: Triaged | None

    @property
    def certified(self) -> bool:
        return self.triaged is not None and self.triaged.bucket == "minimal"

    @property
    def operators(self) -> tuple[str, ...]:
        if self.found.mechanism:
            return tuple(dict.fromkeys(way.split()[0] for way in self.found.mechanism.ways))
        return self.triaged.operators if self.triaged and self.certified else self.found.operators

    def holds(self, scene: Scene) -> bool:
        """Whether a scene is in its range; of one without a scene of its own, never."""
        if mechanism := self.found.mechanism:
            value = self.space.measured(scene)[mechanism.quantity]
            return value >= mechanism.threshold if mechanism.above else value <= mechanism.threshold
        shown, causes = self.found.scene, Causes()
        if self.triaged and self.triaged.shrunk and self.certified:
            shown, causes = self.triaged.shrunk, self.triaged.causes
        return shown is not None and bool(Range(self.space, shown, self.operators, causes).holds([scene])[0])


class Checked:
    """A run with its causes, and what rolls out in other scenes."""

    def __init__(self, path: Path, seed: int) -> None:
        with Store.open(path) as store:
            run = store.runs()[-1]
            found, triaged = store.causes(run.id), {row.scene: row for row in store.triaged()}
        self.runner = SimulatorSceneRunner(path, run.manifest)
        self.space, self._seed, self._number = self.runner.space, seed, seed
        self.causes = [
            Listed(self.space, one, triaged.get(one.scene) if one.scene else None)
            for one in (found.causes if found else ())
        ]

    def fails(self, scenes: Sequence[Scene]) -> list[bool]:
        """Whether the policy fails in those that are fair, each rolled out once with a seed of its own."""
        self._number += len(scenes)
        outcomes = self.runner.evaluate(scenes, range(self._number - len(scenes), self._number))
        return [one.verdict is Verdict.FAILED for one in outcomes if one.verdict in (Verdict.FAILED, Verdict.PASSED)]

    def random(self) -> Iterator[Scene]:
        yield from (self.space.sample(np.random.default_rng([self._seed, index, 3])) for index in range(MOST))

    def alone(self, cause: Listed) -> Iterator[Scene]:
        """Scenes in the range of a cause, with its operators alone."""
        for scene in self.random():
            if not cause.holds(scene):
                continue
            for name in self.space.groups.keys() - set(cause.operators):
                scene = reset(self.space, scene, name)
            repaired = self.space.repaired(scene, np.random.default_rng(0))
            if repaired is not None and repaired.digest == scene.digest and cause.holds(scene):
                yield scene


def check_certified(checked: Checked, each: int) -> None:
    for cause in filter(lambda one: one.certified, checked.causes):
        scenes = list(islice(checked.alone(cause), each))
        print(f"{' + '.join(cause.operators)}: fails {_counted(checked.fails(scenes))} in its range", flush=True)
        for name in cause.operators:
            without = checked.fails([reset(checked.space, scene, name) for scene in scenes])
            print(f"  without {name}: {_counted(without)}", flush=True)


def check_random(checked: Checked, number: int) -> None:
    scenes = list(islice(checked.random(), number))
    failing = [scene for scene in scenes if any(checked.fails([scene]))]
    predicted = [
        (scene, inside) for scene in failing if (inside := [one for one in checked.causes if one.holds(scene)])
    ]
    within = sum(any(one.holds(scene) for one in checked.causes) for scene in scenes)
    passes = list[bool]()
    for scene, inside in predicted:
        for name in {name for one in inside for name in one.operators}:
            scene = reset(checked.space, scene, name)
        passes += [not failed for failed in checked.fails([scene])]
    print(f"random scenes: {_counted([scene in failing for scene in scenes])} fail; {within} are in a cause's range")
    print(f"failures that a cause predicts: {Share.of_counts(len(predicted), len(failing))}")
    print(
        f"of these, pass when it is reset: {Share.of_counts(sum(passes), len(passes))} ({sum(passes)} of {len(passes)})"
    )


def _counted(failed: Sequence[bool]) -> str:
    return f"{sum(failed)} of {len(failed)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("store", type=Path, help="its newest run is checked")
    parser.add_argument("--each", type=int, default=12, help="scenes of each certified cause")
    parser.add_argument("--random", type=int, default=80, help="random scenes")
    parser.add_argument("--seed", type=int, default=9000, help="of the scenes and of their rollouts")
    options = parser.parse_args()
    with trusting(EVERYTHING):
        checked = Checked(options.store, options.seed)
        with closing(checked.runner):
            check_certified(checked, options.each)
            check_random(checked, options.random)


if __name__ == "__main__":
    main()
