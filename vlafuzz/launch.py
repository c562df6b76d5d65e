"""launch: from a plan to a run, with a simulator and a store."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial

from vlafuzz import campaign
from vlafuzz.config import Plan
from vlafuzz.corpus.packs import stored_catalogue
from vlafuzz.corpus.records import Manifest
from vlafuzz.corpus.store import Corpus
from vlafuzz.corpus.tally import Summary, Tally
from vlafuzz.execute.base import Executor
from vlafuzz.execute.registry import executor_at
from vlafuzz.sim.base import Evaluator
from vlafuzz.subjects.base import Subject
from vlafuzz.subjects.registry import make_subject


def start(plan: Plan, watch: Callable[[Tally], None]) -> Summary:
    """Run it."""
    # The store first: whether it can be written shows at once, a simulator takes seconds.
    with Corpus.open(plan.store, "write") as corpus, closing(make_executor(plan)) as executor:
        return fuzz(plan, corpus, executor, watch)


def fuzz(
    plan: Plan, corpus: Corpus, executor: Executor, watch: Callable[[Tally], None], *, alone: bool = False
) -> Summary:
    """Run it in an open store, with an executor that is there; see ``campaign.fuzz``."""
    return campaign.fuzz(
        manifest=plan.manifest,
        stages=plan.task.stage_names,
        space=plan.space,
        strategy=plan.strategy,
        executor=executor,
        corpus=corpus,
        meaningful=None if alone else plan.meaningful,  # who compares counts for himself
        patience=plan.patience,
        resume=plan.resume,
        alone=alone,
        watch=watch,
    )


def make_executor(plan: Plan) -> Executor:
    """What evaluates the run's scenes."""
    return executor_at(plan.place, partial(make_evaluator, plan.manifest), plan.subject)


def make_evaluator(manifest: Manifest, subject: Subject | None = None) -> Evaluator:
    """The simulator with the subject in it: from here on, seconds go by.

    Args:
        subject: by default made anew from its name.
    """
    from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator

    return ManiSkillEvaluator(
        manifest.task,
        subject or make_subject(manifest.subject),
        stored_catalogue(manifest),
        min_distance=manifest.min_distance,
        seed=manifest.seed,
        repeats=manifest.repeats,
        stop_early=manifest.stop_early,
        criteria=manifest.criteria,
        placement=manifest.placement,
    )
