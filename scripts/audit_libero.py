"""What is wrong with initial states of LIBERO's suites before any policy acts: docs/libero-audit.md has what it found.

Needs scripts/setup-libero; runs for minutes.

    python scripts/audit_libero.py libero_spatial                 # all initial states of all tasks
    python scripts/audit_libero.py libero_goal/3 --states 10      # ten of one task
"""

import argparse
from collections import Counter
from functools import partial

from vlafuzz.errors import UsageError
from vlafuzz.worlds.libero.defects import defects
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.packages import versions
from vlafuzz.worlds.libero.suites import find_task, find_tasks


def main() -> None:
    flags = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    flags.add_argument("names", nargs="+", help="suites, or SUITE/NUMBER")
    flags.add_argument("--states", type=int, help="the first initial states of each task (default all)")
    given = flags.parse_args()
    print(versions())
    for name in given.names:
        for task in [find_task(name)] if "/" in name else find_tasks(name):
            try:
                env = LiberoEnv(task, size=64)
            except UsageError as error:
                print(f"{task}: {error.message}")
                continue
            numbers, found, sound = range(len(env.states[: given.states])), Counter[str](), 0
            for number in numbers:
                wrong = list(defects(env, partial(env.reset, number)))
                for defect in wrong:
                    print(f"{task} state {number}: {defect.check}: {defect.reason}")
                found.update({defect.check for defect in wrong})
                sound += not wrong
            env.close()
            print(f"{task}: {sound} of {len(numbers)} sound", *(f"{check} {count}" for check, count in found.items()))


if __name__ == "__main__":
    main()
