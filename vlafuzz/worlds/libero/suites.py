"""Suites and tasks of LIBERO as data: names, instructions, goals and nominal initial states. No simulator."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.errors import UsageError, suggestion
from vlafuzz.worlds.libero.packages import load, quiet

Atom = tuple[str, ...]  # a predicate with its arguments: ("on", "bowl_1", "plate_1")
SUITES = ("libero_spatial", "libero_object", "libero_goal", "libero_10")
# Control steps that LIBERO's evaluations allow, by the longest demonstration of a suite; 520 for others.
HORIZONS = {"libero_spatial": 220, "libero_object": 280, "libero_goal": 300, "libero_90": 400}
REST = "initial"  # the rest pose of scenes' things: as in the suite's own initial state
LYING = "lying"  # that of a target that has been knocked over: on its lower side
PLACING = ("on", "in")  # predicates whose first thing is to be carried to the second
# LIBERO-PRO's suites whose words or goals are new: the words stand in the problem's file. LIBERO takes them
# from the file's name, which is the old one; the authors of LIBERO-PRO say to read the file.
REWORDED = ("_lan", "_task")
SETTLING = 10  # control steps with the hand held still, before a policy is asked first


@dataclass(frozen=True)
class LiberoTask:
    """A task of a suite.

    Attributes:
        instruction: as LIBERO's evaluations give it to policies; of reworded suites the problem's own. paraphrase: how
        LIBERO-PRO says it, if it does.
        bddl: file of the problem: objects, regions, initial state and goal.
        initial: what the problem says of the start, as predicates.
        goal: predicates that all hold where the task is solved.
        interest: names of the objects of interest.
        things: names of all that can be moved: what is to be carried, the rest of interest, then the others.
    """

    suite: str
    number: int
    instruction: str
    bddl: Path
    initial: tuple[Atom, ...]
    goal: tuple[Atom, ...]
    interest: tuple[str, ...]
    things: tuple[str, ...]
    paraphrase: str = ""

    @property
    def carried(self) -> tuple[str, ...]:
        """Names of the things that the goal wants elsewhere, in its order."""
        return tuple(atom[1] for atom in self.goal if atom[0] in PLACING)

    @property
    def riders(self) -> dict[str, str]:
        """By the names of things that stand on another thing: which one that is."""
        on = (atom[1:] for atom in self.initial if atom[0] == "on")
        return {rider: carrier for rider, carrier in on if {rider, carrier} <= set(self.things)}

    @property
    def concerned(self) -> int:
        """How many of the things, the first ones, the task is about."""
        return len({*self.carried, *self.interest} & set(self.things))

    def __str__(self) -> str:
        return f"{self.suite}/{self.number}"

    @property
    def horizon(self) -> int:
        """Control steps that the suite's evaluation gives a policy."""
        return next((steps for suite, steps in HORIZONS.items() if self.suite.startswith(suite)), 520)


def find_task(name: str) -> LiberoTask:
    """The task that ``SUITE/NUMBER`` names, such as ``libero_object/0``; errors as of ``find_tasks``."""
    suite, _, number = name.partition("/")
    tasks = find_tasks(suite)
    if not number.isdecimal() or int(number) >= len(tasks):
        hint = f"give SUITE/NUMBER: {suite}/0 to {suite}/{len(tasks) - 1}"
        raise UsageError(f"no task {name!r}", hint=hint)
    return tasks[int(number)]


def find_tasks(suite: str) -> list[LiberoTask]:
    """All tasks of a suite, in order; UsageError if there are none, PrerequisiteError if LIBERO is not installed."""
    return [_task(suite, number) for number in range(_suite(suite).get_num_tasks())]


def initial_states(task: LiberoTask) -> Array:
    """``(n, 1 + nq + nv)``: time, positions and velocities of the suite's own initial states."""
    return np.asarray(_suite(task.suite).get_task_init_states(task.number))


@cache
def _suite(name: str) -> Any:
    known = load("libero.libero.benchmark").get_benchmark_dict()
    if name not in known:
        raise UsageError(f"LIBERO has no suite {name!r}", hint=suggestion(name, known))
    with quiet():  # it says in which order its tasks are
        suite = known[name]()
    if not suite.get_num_tasks():
        raise UsageError(f"LIBERO's suite {name!r} is empty", hint=suggestion(name, SUITES))
    return suite


@cache
def _task(suite: str, number: int) -> LiberoTask:
    benchmark = _suite(suite)
    file, words = Path(benchmark.get_task_bddl_file_path(number)), benchmark.get_task(number).language
    if not file.is_file():
        hint = "`libero-pro list` shows which suites are complete"
        raise UsageError(f"LIBERO's suite {suite!r} has no file for its task {number}", hint=hint)
    problem = load("libero.libero.envs.bddl_utils").robosuite_parse_problem(str(file))
    goal, interest = _atoms(problem["goal_state"]), tuple(problem["obj_of_interest"])
    movable = [name for names in problem["objects"].values() for name in names]
    wanted = [*(atom[1] for atom in goal if atom[0] in PLACING), *interest]
    return LiberoTask(
        suite=suite,
        number=number,
        instruction=" ".join(problem["language_instruction"]) if suite.endswith(REWORDED) else words,
        bddl=file,
        initial=_atoms(problem["initial_state"]),
        goal=goal,
        interest=interest,
        things=tuple(name for name in dict.fromkeys([*wanted, *movable]) if name in movable),
        paraphrase=_task(f"{suite}_lan", number).instruction if suite in SUITES else "",
    )


def _atoms(parsed: list[list[str]]) -> tuple[Atom, ...]:
    return tuple((atom[0].lower(), *atom[1:]) for atom in parsed)
