"""launch: start the run of a plan, with a simulator and a store."""

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
    """Run a plan."""
    # The store first: it shows at once whether it can be written, while a simulator takes seconds to start.
    with Store.open(plan.store, "write") as store, closing(make_executor(plan)) as executor:
        return fuzz(plan, store, executor, watch)


def fuzz(
    plan: Plan, store: Store, executor: Executor, watch: Callable[[Tally], None], *, alone: bool = False
) -> Summary:
    """Run a plan in an open store with an existing executor; see ``campaign.fuzz``."""
    return campaign.fuzz(
        manifest=plan.manifest,
        stages=plan.task.stage_names,
        space=plan.space,
        strategy=plan.strategy,
        executor=executor,
        store=store,
        embed=None if alone else plan.embed,  # comparisons count on their own
        patience=plan.patience,
        resume=plan.resume,
        alone=alone,
        watch=watch,
    )


def make_executor(plan: Plan) -> Executor:
    """The executor of a plan, with its evaluator."""
    return executor_at(plan.place, partial(make_evaluator, plan.manifest), plan.policy)
