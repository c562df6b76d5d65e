"""What a store tells a run before it begins: the causes and the outcomes of an earlier version, or of another task."""

import math
from pathlib import Path

import numpy as np

from vlafuzz.errors import UsageError
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.search.base import Genome
from vlafuzz.search.causes.predecessor import Predecessor
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of


def predecessor_of(path: Path, space: Space) -> Predecessor:
    """The newest run of a store, one of the same task before others; certified causes come first.

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
        outcomes = [(one.scene, one.outcome.verdict) for one in store.trials(run.id) if not one.duplicate]
    before = world.stored_space(path, run.manifest)
    certified, others = list[tuple[Genome, tuple[str, ...]]](), list[tuple[Genome, tuple[str, ...]]]()
    for cause in found.causes if found else ():
        row = triaged.get(cause.scene) if cause.scene else None
        if row and row.bucket == "minimal" and row.shrunk:
            certified.append((_genome(row.shrunk, before, space), row.operators))
        elif cause.scene:
            others.append((_genome(cause.scene, before, space), cause.operators))
    judged = [(scene, verdict) for scene, verdict in outcomes if verdict in (Verdict.PASSED, Verdict.FAILED)]
    return Predecessor(
        causes=(*certified, *others),
        genomes=np.array([_genome(scene, before, space) for scene, _ in judged]),
        failed=np.array([verdict is Verdict.FAILED for _, verdict in judged], dtype=bool),
    )


def _genome(scene: Scene, before: Space, space: Space) -> Genome:
    """A scene in another space, as far as that has its values: all else is nominal."""
    values = dict(space.nominal_values)
    for path, value in before.values(scene).items():
        gene = space.by_path.get(path)
        if gene is not None and gene.options == before.by_path[path].options and not math.isnan(value):
            values[path] = value
    return space.nearest(space.compose(values))
