"""Start the run of a plan."""

from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any

from vlafuzz.campaign.config import Plan
from vlafuzz.campaign.fuzz import Campaign
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.common.deadline import Deadline
from vlafuzz.rollouts.executor import Executor
from vlafuzz.rollouts.registry import executor_at
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.store.store import Store

SEARCH = 0.5  # share of the time for a run where triage follows, which takes about as many rollouts


def start(plan: Plan, watch: Callable[[Tally], None], deadline: Deadline | None = None) -> Summary:
    """Run a plan; after the deadline no scene is begun, and the run can be resumed."""
    # The store first: it shows at once whether it can be written, while a simulator takes seconds to start.
    with Store.open(plan.store, "write") as store, closing(make_executor(plan)) as executor:
        return fuzz(plan, store, executor, watch, deadline=deadline or Deadline())


def fuzz(plan: Plan, store: Store, executor: Executor, watch: Callable[[Tally], None], **options: Any) -> Summary:
    """Run a plan in an open store with an existing executor; ``options``: see ``Campaign``."""
    planned = {name: getattr(plan, name) for name in ("manifest", "space", "strategy", "patience", "resume")}
    return Campaign(**planned, executor=executor, store=store, watch=watch, **options).run()


def make_executor(plan: Plan) -> Executor:
    """The executor of a plan, with its evaluator."""
    return executor_at(plan.place, partial(make_evaluator, plan.manifest), plan.policy)


def stands_alone(policy: str) -> str:
    """Why no stored outcome answers for a policy whose model nobody names, as a note."""
    return (
        f"note: {policy}: nothing says which model that is, so no stored outcome answers, and none of this "
        "run will later; ?version=NAME in the policy's name, or --label NAME of `run`, says which it is"
    )
