"""Attack everything that reads files, stores and wires with mutated inputs, and count the reactions.

    scripts/attack.py                          43,300 inputs over all readers and wires
    scripts/attack.py --share 0.01             the same mix, a hundredth of it
    scripts/attack.py meshes --first 17 --inputs 1
                                               one input again

The exit code is 1 if any reaction is a traceback, takes more than 5 s of a processor, or more than 1 GiB.
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.attack.counting import TARGETS, count


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("readers", nargs="*", help=f"of {', '.join(TARGETS)}; by default all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--share", type=float, default=1.0, help="of the usual number of inputs")
    parser.add_argument("--inputs", type=int, help="instead, for each reader")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    asked = parser.parse_args()
    faults = total = 0
    print("reader                inputs refused accepted   TB hangs  slowest")
    for name in asked.readers or TARGETS:
        inputs = asked.inputs or max(1, round(asked.share * TARGETS[name][1]))
        counted = count(name, inputs, asked.seed, asked.first)
        total, faults = total + counted.inputs, faults + counted.tracebacks + counted.hangs
        print(
            f"{name:20} {counted.inputs:7} {counted.refused:7} {counted.accepted:8} {counted.tracebacks:4} "
            f"{counted.hangs:5} {counted.slowest:6.1f} s",
            flush=True,
        )
        for fault in counted.faults.values():
            print("   ", fault.replace("\n", "\n      "), flush=True)
    print(f"{total} inputs, {faults} faults")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
