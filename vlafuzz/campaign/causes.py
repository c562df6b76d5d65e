"""The causes that a strategy has found, each with a stored failure that shows it, and those that a run begins with."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vlafuzz.errors import UsageError
from vlafuzz.failures.mechanisms import HARDLY, Merged, mechanisms
from vlafuzz.model import Scene, Space, Verdict
from vlafuzz.search.base import Cause, Genome, Strategy, said_by
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import Attribution, FoundCause
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of

Failure = tuple[Scene, Genome]


def attribution(strategy: Strategy, space: Space, store: Store, run: int) -> Attribution:
    """What a strategy has found out in a run; causes by their share of random scenes, else by failures.

    A cause's failures are some of all failures, so no bound of its share is above that of the probability.
    """
    overall: Probability | None = said_by(strategy, "probability", None)
    listed: Sequence[Cause] = said_by(strategy, "causes", ())
    trials = list(store.trials(run)) if listed else []
    failed = (trial for trial in trials if trial.outcome.verdict is Verdict.FAILED)
    failures = [(trial.scene, trial.genome) for trial in failed if trial.genome is not None]
    drawn = tuple(said_by(strategy, "at_random", ()))
    plain = [
        FoundCause(
            _shown_by(cause, failures, space),
            cause.operators,
            cause.failures,
            _within(cause.share, overall),
            tests=cause.tests,
        )
        for cause in listed
    ]
    merged = mechanisms(space, listed, trials, drawn)
    policy = next(one.manifest.key() for one in store.runs() if one.id == run)
    triaged = (row for row in store.triaged() if row.policy_key == policy)
    standing = dict[Scene | None, int]((row.scene, 1 if row.bucket == "minimal" else -1) for row in triaged)
    left = set(range(len(plain))) - {member for one in merged for member in one.members}
    found = [plain[index] for index in sorted(left)] + [_as_one(plain, one, overall, standing) for one in merged]
    found.sort(key=lambda cause: (-cause.share.value if cause.share else 0.0, -cause.failures))
    return Attribution(tuple(found), len(said_by(strategy, "unexplained", ())), overall, drawn)


def _as_one(
    found: Sequence[FoundCause], merged: Merged, overall: Probability | None, standing: Mapping[Scene | None, int]
) -> FoundCause:
    """Causes that act through one quantity, shown by one that is certified, else not refuted, and explains most."""
    members = [found[index] for index in merged.members]
    shown = max(members, key=lambda one: (one.scene is not None, standing.get(one.scene, 0), one.failures))
    share = _within(merged.share, overall) or shown.share
    return replace(shown, failures=sum(one.failures for one in members), share=share, mechanism=merged.mechanism)


def _within(share: Probability | None, overall: Probability | None) -> Probability | None:
    return Probability(*map(min, share, overall)) if share and overall else share


def _shown_by(cause: Cause, failures: Sequence[Failure], space: Space) -> Scene | None:
    """The failure nearest to a cause's own scene, of those with its operators alone."""
    members = [space.groups.get(operator, (operator,)) for operator in cause.operators]
    own = {name for group in members for name in group}
    for scene, _ in sorted(failures, key=lambda failure: float(np.abs(failure[1] - cause.genome).sum())):
        severities = space.severities(scene)
        has_all = all(any(severities.get(name, 0.0) > 0 for name in group) for group in members)
        if has_all and all(far <= HARDLY for name, far in severities.items() if name not in own):
            return scene
    return None


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
