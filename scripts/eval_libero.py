"""How often LIBERO's expert solves the suites' own initial states, and that keeping still solves none.

Needs scripts/setup-libero; runs for minutes.

    python scripts/eval_libero.py                           # all pick-and-place tasks of the four suites
    python scripts/eval_libero.py libero_goal/8 --states 20 --frozen
"""

import argparse
from collections import Counter
from collections.abc import Iterable
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.statistics import wilson
from vlafuzz.model import Monitor
from vlafuzz.worlds.libero.env import STILL, LiberoEnv
from vlafuzz.worlds.libero.expert import Expert
from vlafuzz.worlds.libero.packages import versions
from vlafuzz.worlds.libero.stages import Moment, find_stages
from vlafuzz.worlds.libero.suites import PLACING, SETTLING, SUITES, find_task, find_tasks


def main() -> None:
    flags = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    flags.add_argument("names", nargs="*", default=SUITES, help="suites, or SUITE/NUMBER")
    flags.add_argument("--states", type=int, default=5, help="initial states of each task")
    flags.add_argument("--frozen", action="store_true", help="keep still instead")
    given = flags.parse_args()
    print(versions())
    solved, tried = Counter[str](), Counter[str]()
    for name in given.names:
        for task in [find_task(name)] if "/" in name else find_tasks(name):
            env = LiberoEnv(task, size=64)
            if not _can_solve(env):
                print(f"{task}: without an expert: {task.instruction}", flush=True)
                continue
            ends = [_rollout(env, number, frozen=given.frozen) for number in range(given.states)]
            env.close()
            good = ends.count("goal")
            print(f"{task}: {good} of {len(ends)}: {task.instruction}: {', '.join(ends)}", flush=True)
            solved[task.suite] += good
            tried[task.suite] += len(ends)
    for suite, count in tried.items():
        interval = wilson(solved[suite], count)
        low, high = 100 * interval.low, 100 * interval.high
        print(f"{suite}: {solved[suite]} of {count} ({low:.0f}–{high:.0f} %)")


def _can_solve(env: LiberoEnv) -> bool:
    """Whether the task only needs things carried: nothing to push, no doors, drawers or knobs to move."""
    env.reset()
    sites = env.robosuite.object_sites_dict
    for atom in env.task.goal:
        if atom[0] not in PLACING and not env.holds(atom):
            return False
        if atom[0] in PLACING and getattr(sites.get(atom[2]), "joints", None):  # in a drawer
            return False
    return not env.task.instruction.startswith("push")


def _rollout(env: LiberoEnv, number: int, *, frozen: bool) -> str:
    """The last stage that is reached within the suite's horizon."""
    env.reset(number)
    env.settle(SETTLING)
    moment, monitor = Moment(env), Monitor(find_stages(env.task))
    actions: Iterable[NDArray[np.float64]] = repeat(STILL) if frozen else Expert(env).actions()
    for _, action in zip(range(env.task.horizon), actions, strict=False):
        env.step(action)
        monitor.observe(moment)
        if monitor.success_once:
            break
    return monitor.reached[-1] if monitor.reached else "–"


if __name__ == "__main__":
    main()
