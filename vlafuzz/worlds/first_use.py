"""Where a world of the user's own is first used: what seconds of checks say of it, once for its sources."""

import hashlib
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from vlafuzz.common import assets
from vlafuzz.common.check import Check
from vlafuzz.common.plugins import PREFIX, is_reference
from vlafuzz.common.text import duration
from vlafuzz.common.watch import Watch
from vlafuzz.errors import PrerequisiteError
from vlafuzz.worlds import world_of
from vlafuzz.worlds.parameters import Parameters
from vlafuzz.worlds.soundness import SIMULATORS, examine
from vlafuzz.worlds.values import ValuesWorld, own_name


def looked_at(task: str, watch: Watch) -> Iterator[Check]:
    """The findings on a world of the user's own in a task, unless it was checked as it is now; none on ours.

    A world with nothing to refuse is kept as checked.
    """
    name = task.rpartition("/")[0]
    world = world_of(task) if is_reference(name) else None
    if not isinstance(world, ValuesWorld) or _place(name, world, own_name(task)).is_dir():
        return
    began, sound = time.monotonic(), True
    for number, check in enumerate(examine(world, own_name(task), brief=True), start=1):
        watch.progress("checks of the world", number, None)
        if check.verdict != "ok":
            sound = sound and check.verdict != "refuse"
            yield check
        if number == 1:  # two simulators were made for it
            about = duration((time.monotonic() - began) * SIMULATORS / 2)
            watch.note(f"note: {name} is new here, or has changed: checks of its resets and steps take about {about}")
    if sound:
        remember(name, world, own_name(task))


def remember(name: str, world: ValuesWorld[Any], task: str) -> None:
    """Keep a world as checked, by its sources; without a cache that can be written it is checked again."""
    kept = _place(name, world, task)
    with suppress(PrerequisiteError):
        assets.made_once(str(kept.relative_to(assets.cache_dir())), lambda _: None, Path.is_dir)


def _place(name: str, world: ValuesWorld[Any], task: str) -> Path:
    """The folder of the cache that is there if a world was checked with these files, parameters and packages."""
    parts = [name, task, world.simulator, Parameters(world.named, frozenset()).to_json()]
    modules = [name.removeprefix(PREFIX).partition(":")[0], *(one.__module__ for one in type(world).__mro__)]
    for module in dict.fromkeys(module for module in modules if not module.startswith("vlafuzz.")):
        file = getattr(sys.modules[module], "__file__", None)
        parts.append(hashlib.blake2b(Path(file).read_bytes()).hexdigest() if file else module)
    return assets.cache_dir() / "worlds" / hashlib.blake2b("\n".join(parts).encode(), digest_size=8).hexdigest()
