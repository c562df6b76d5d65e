"""launch: from a plan to a run, with a simulator and a store."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial

from vlafuzz.campaign import fuzz as campaign
from vlafuzz.campaign.config import Plan
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.execute.base import Executor
from vlafuzz.execute.registry import executor_at
from vlafuzz.sim.make import make_evaluator
from vlafuzz.store.store import Store


def start(plan: Plan, watch: Callable[[Tally], None]) -> Summary:
    """Run it."""
    # The store first: whether it can be written shows at once, a simulator takes seconds.
    with Store.open(plan.store, "write") as store, closing(make_executor(plan)) as executor:
        return fuzz(plan, store, executor, watch)


def fuzz(
    plan: Plan, store: Store, executor: Executor, watch: Callable[[Tally], None], *, alone: bool = False
) -> Summary:
    """Run it in an open store, with an executor that is there; see ``campaign.fuzz``."""
    return campaign.fuzz(
        manifest=plan.manifest,
        stages=plan.task.stage_names,
        space=plan.space,
        strategy=plan.strategy,
        executor=executor,
        store=store,
        embed=None if alone else plan.embed,  # who compares counts for himself
        patience=plan.patience,
        resume=plan.resume,
        alone=alone,
        watch=watch,
    )


def make_executor(plan: Plan) -> Executor:
    """What evaluates the run's scenes."""
    return executor_at(plan.place, partial(make_evaluator, plan.manifest), plan.policy)
