"""LIBERO here beside LIBERO itself: whether states and pictures are equal bit by bit, and how fast each is.

Needs scripts/setup-libero. Runs for minutes: LIBERO itself draws four to eight pictures a second on one core.

    python scripts/bench_libero.py    # all tasks of the four suites, ten initial states each
    python scripts/bench_libero.py libero_goal/3 --states 2 --pictures 40
    python scripts/bench_libero.py --states 0 --pictures 40    # what pictures cost, and how similar they are
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.worlds.similarity import similarity
from vlafuzz.worlds.libero.env import SEED, LiberoEnv
from vlafuzz.worlds.libero.packages import load, quiet, versions
from vlafuzz.worlds.libero.pictures import CAMERAS
from vlafuzz.worlds.libero.suites import SUITES, LiberoTask, find_task, find_tasks, initial_states

SIZE = 224
Step = tuple[NDArray[np.float64], NDArray[np.float64], list[NDArray[np.uint8]]]  # state, (8,), pictures


def main() -> None:
    flags = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    flags.add_argument("tasks", nargs="*", help="SUITE/NUMBER; all of the four suites by default")
    flags.add_argument("--states", type=int, default=10, help="initial states of each task")
    flags.add_argument("--actions", type=int, default=50, help="random actions after each")
    flags.add_argument("--pictures", type=int, default=0, help="first steps whose two pictures are compared and timed")
    given = flags.parse_args()
    tasks = [find_task(name) for name in given.tasks] or [task for suite in SUITES for task in find_tasks(suite)]
    print(versions())
    for task in tasks if given.states else []:
        numbers = range(min(given.states, len(initial_states(task))))
        theirs, their_time = _timed(_libero(task, numbers, given.actions, given.pictures))
        ours, our_time = _timed(_here(task, numbers, given.actions, given.pictures))
        print(f"{task}: {_compared(theirs, ours)}; a step {their_time:.1f} and {our_time:.1f} ms", flush=True)
    if given.pictures:
        for task in tasks:
            _pictured(task, given.pictures)


def _compared(theirs: list[Step], ours: list[Step]) -> str:
    pairs = list(zip(theirs, ours, strict=True))
    states = sum(np.array_equal(a[0], b[0]) for a, b in pairs)
    seen = sum(np.array_equal(a[1], b[1]) for a, b in pairs)
    both = [(x, y) for a, b in pairs for x, y in zip(a[2], b[2], strict=True)]
    pictures = sum(np.array_equal(x, y) for x, y in both)
    return f"equal: {states} of {len(pairs)} states, {seen} observed states, {pictures} of {len(both)} pictures"


def _timed(steps: Iterator[tuple[Step, float]]) -> tuple[list[Step], float]:
    """All steps, and milliseconds of processor time that a step took in the middle."""
    done = list(steps)
    return [step for step, _ in done], 1000 * float(np.median([seconds for _, seconds in done]))


def _actions(number: int, count: int) -> NDArray[np.float64]:
    return np.random.default_rng(number).uniform(-1, 1, (count, 7))


def _here(task: LiberoTask, numbers: range, actions: int, pictures: int) -> Iterator[tuple[Step, float]]:
    env = LiberoEnv(task, size=SIZE)
    for number in numbers:
        env.reset(number)
        for done in range(actions + 1):
            begun = time.process_time()
            if done:
                env.step(_actions(number, actions)[done - 1])
            seconds = time.process_time() - begun
            taken = list(env.pictures().values()) if done < pictures else []
            yield (env.state(), env.proprioception(), taken), seconds
    env.close()


def _libero(task: LiberoTask, numbers: range, actions: int, pictures: int) -> Iterator[tuple[Step, float]]:
    env = _their_env(task, cameras=pictures > 0)
    once = len(env.env.object_property_initializers)
    for number in numbers:
        # LIBERO never empties this list: as in a new environment, in a tenth of the time
        del env.env.object_property_initializers[once:]
        env.seed(SEED)
        env.reset()
        seen = env.set_init_state(initial_states(task)[number])
        for done in range(actions + 1):
            begun = time.process_time()
            if done:
                seen = env.step(_actions(number, actions)[done - 1])[0]
            seconds = time.process_time() - begun
            taken = [seen[f"{name}_image"][::-1, ::-1] for name in CAMERAS] if done < pictures else []
            yield (env.get_sim_state(), _their_state(seen), taken), seconds
    env.close()


def _their_env(task: LiberoTask, *, cameras: bool):  # type: ignore[no-untyped-def]
    kind = load("libero.libero.envs").OffScreenRenderEnv
    with quiet():
        return kind(bddl_file_name=str(task.bddl), camera_heights=SIZE, camera_widths=SIZE, use_camera_obs=cameras)


def _their_state(seen: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """As the examples of LIBERO's models make it of an observation."""
    x, y, z, w = seen["robot0_eef_quat"]
    sine = np.sqrt(1.0 - w * w)
    turn = np.zeros(3) if np.isclose(sine, 0.0) else np.array([x, y, z]) * 2.0 * np.arccos(w) / sine
    return np.concatenate([seen["robot0_eef_pos"], turn, seen["robot0_gripper_qpos"]])


def _pictured(task: LiberoTask, steps: int) -> None:
    """Print what a step with its two pictures costs by quality, and how similar these are to LIBERO's.

    States are LIBERO's own, so pictures show the same. The hand moves on in one direction for ten steps.
    """
    actions = np.repeat(_actions(0, -(-steps // 10)), 10, axis=0)[:steps]
    theirs = _their_env(task, cameras=True)
    theirs.seed(SEED)
    theirs.reset()
    theirs.set_init_state(initial_states(task)[0])
    spent, pictures = [], []
    for action in actions:
        begun = time.process_time()
        seen = theirs.step(action)[0]
        spent.append(time.process_time() - begun)
        pictures.append([seen[f"{name}_image"][::-1, ::-1] for name in CAMERAS])
    theirs.close()
    stock = float(np.mean(spent))
    print(f"{task}: LIBERO {1000 * stock:.0f} ms")
    for name in ("full", "fast"):
        ours, alike = _cheaper(task, name, actions, pictures)
        worst, median = alike.min(axis=0), np.median(alike, axis=0)
        words = ", ".join(
            f"{camera} {low:.3f} (median {middle:.3f})"
            for camera, low, middle in zip(CAMERAS, worst, median, strict=True)
        )
        print(f"{task}: {name} {1000 * ours:.0f} ms, {stock / ours:.1f}×, similarity {words}", flush=True)


def _cheaper(
    task: LiberoTask, quality: str, actions: NDArray[np.float64], expected: list[list[NDArray[np.uint8]]]
) -> tuple[float, NDArray[np.float64]]:
    """Seconds of processor time of a step with pictures, and their similarity ``(steps, 2)`` to LIBERO's."""
    env = LiberoEnv(task, size=SIZE, quality=quality)
    env.reset()
    env.pictures()
    spent, alike = [], []
    for action, pair in zip(actions, expected, strict=True):
        begun = time.process_time()
        env.step(action)
        seen = env.pictures()
        spent.append(time.process_time() - begun)
        alike.append([similarity(seen[name], own) for name, own in zip(CAMERAS, pair, strict=True)])
    env.close()
    return float(np.mean(spent)), np.array(alike)


if __name__ == "__main__":
    main()
