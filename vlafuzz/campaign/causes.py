"""The causes that a strategy has found, each with a stored failure that shows it."""

from collections.abc import Sequence

import numpy as np

from vlafuzz.outcome import Verdict
from vlafuzz.scene import Scene
from vlafuzz.scoring import Measure
from vlafuzz.search.base import Cause, Genome, Strategy, at_random, causes, probability, unexplained
from vlafuzz.store.records import Attribution, FoundCause
from vlafuzz.store.store import Store
from vlafuzz.triage.path import GROUPS

HARDLY = 0.1  # severity up to which other operators may be off: strategies vary scenes that they repeat

Failure = tuple[Scene, Genome]


def attribution(strategy: Strategy, space: Measure, store: Store, run: int) -> Attribution:
    """What a strategy has found out in a run; causes by their share of random scenes, else by failures."""
    failures = [
        (trial.scene, trial.genome)
        for trial in store.trials(run)
        if trial.outcome.verdict is Verdict.FAILED and trial.genome is not None
    ]
    found = [
        FoundCause(_shown_by(cause, failures, space), cause.operators, cause.failures, cause.share)
        for cause in causes(strategy)
    ]
    found.sort(key=lambda cause: (-cause.share.value if cause.share else 0.0, -cause.failures))
    return Attribution(tuple(found), unexplained(strategy), probability(strategy), at_random(strategy))


def _shown_by(cause: Cause, failures: Sequence[Failure], space: Measure) -> Scene | None:
    """The failure nearest to a cause's own scene, of those with its operators alone."""
    nearest = sorted(failures, key=lambda failure: float(np.abs(failure[1] - cause.genome).sum()))
    return next((scene for scene, _ in nearest if _has_alone(cause.operators, scene, space)), None)


def _has_alone(operators: Sequence[str], scene: Scene, space: Measure) -> bool:
    severities = space.severities(scene)
    members = [GROUPS.get(operator, (operator,)) for operator in operators]
    others = severities.keys() - {name for group in members for name in group}
    return all(any(severities.get(name, 0.0) > 0 for name in group) for group in members) and all(
        severities[name] <= HARDLY for name in others
    )
