"""Compare two worlds with the same tasks: how often a policy passes in the same scenes, and how often both agree.

python scripts/compare_worlds.py tabletop-mujoco --policy pinhole --scenes 60
"""

import argparse
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np

from vlafuzz.model import Conditions, Outcome, Scene
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.worlds import task_in, usual_world, world_of


def outcomes(task: str, policy: str, scenes: Sequence[Scene]) -> list[Outcome]:
    """Of a policy in these scenes, as scenes of a task, which may be another world's."""
    conditions = Conditions(task=task, policy=policy, stop_early=True)
    made = make_policy(policy)
    world = world_of(task)
    with closing(world.evaluator(conditions, made, None, recording=None, checked=True)) as evaluator:
        return evaluator.evaluate([replace(scene, task=task) for scene in scenes])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("world", help="the other world")
    parser.add_argument("--policy", default="expert")
    parser.add_argument("--tasks", nargs="+", default=list(usual_world().tasks))
    parser.add_argument("--scenes", type=int, default=25, help="random ones, behind the nominal one")
    parser.add_argument("--jittered", action="store_true", help="jittered nominal scenes instead of random ones")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for task in options.tasks:
        space = usual_world().space(task, next(iter(usual_world().robots)))
        scenes = [space.nominal()]
        for number in range(options.scenes):
            rng = np.random.default_rng([options.seed, number])
            scenes.append(space.jittered(scenes[0], number) if options.jittered else space.sample(rng))
        first, other = (outcomes(name, options.policy, scenes) for name in (task, task_in(options.world, task)))
        both = [(one.passed, two.passed) for one, two in zip(first, other, strict=True) if one.judged and two.judged]
        passes, there = (sum(one) for one in zip(*both, strict=True))
        agree = sum(one is two for one, two in both)
        print(f"{task}: passes {passes} and {there} of {len(both)}, the same verdict in {agree}")


if __name__ == "__main__":
    main()
