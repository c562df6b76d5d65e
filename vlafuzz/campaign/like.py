"""Reads what an earlier store tells a run: the causes of another version of the policy, or of another task."""

import math
from pathlib import Path

from vlafuzz.errors import UsageError
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.search.base import Cause, Genome
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of


def causes_like(path: Path, space: Space) -> list[Cause]:
    """The causes of the newest run of a store, one of the same task before others; certified ones come first.

    Raises:
        StoreError: it cannot be read.
        UsageError: it has no run of this world.
    """
    world, task = world_of(space.task.name), space.task.name
    with Store.open(path) as store:
        runs = [run for run in store.runs() if world_of(run.manifest.task) is world]
        if not runs:
            raise UsageError(f"--like {path}: has no run in the world of {task}", hint="name the store of one")
        run = max(runs, key=lambda run: (run.manifest.task == task, run.id))
        found, triaged = store.causes(run.id), {row.scene: row for row in store.triaged()}
    before = world.stored_space(path, run.manifest)
    certified, others = list[Cause](), list[Cause]()
    for cause in found.causes if found else ():
        row = triaged.get(cause.scene) if cause.scene else None
        if row and row.bucket == "minimal" and row.shrunk:
            certified.append(Cause(_genome(row.shrunk, before, space), row.operators, cause.failures))
        elif cause.scene:
            others.append(Cause(_genome(cause.scene, before, space), cause.operators, cause.failures))
    return [*certified, *others]


def _genome(scene: Scene, before: Space, space: Space) -> Genome:
    """A scene in another space, as far as that has its values: all else is nominal."""
    values = dict(space.nominal_values)
    for path, value in before.values(scene).items():
        gene = space.by_path.get(path)
        if gene is not None and gene.options == before.by_path[path].options and not math.isnan(value):
            values[path] = value
    return space.nearest(space.compose(values))
