"""``vlafuzz triage``."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.cli.flags import ExecutorFlag, JsonFlag, TimeFlag, TrustFlag, WorkersFlag, option
from vlafuzz.cli.output import Bar, interruptible, print_json, print_lines, print_list, print_rows
from vlafuzz.common.plugins import trust_flag
from vlafuzz.common.text import duration, plural
from vlafuzz.errors import PrerequisiteError, UsageError, check_number

if TYPE_CHECKING:
    from vlafuzz.failures.causes import CauseList
    from vlafuzz.failures.triage.jobs import Allowance
    from vlafuzz.failures.triage.summary import TriageSummary
    from vlafuzz.rollouts.registry import Place
    from vlafuzz.store.store import Store

AGAIN = "the next triage tries them again"


def command(
    store: Annotated[Path, typer.Argument(help="A store that `vlafuzz run` wrote.")],
    max_rollouts: Annotated[
        int | None,
        option(
            "Most policy rollouts to shrink, certify and attribute one failure.", "200, of a stochastic policy 1000"
        ),
    ] = None,
    limit: Annotated[int | None, option("Most failures to work on.", "all that are left")] = None,
    rollouts: Annotated[
        int | None, option("Policy rollouts of all failures together, after which no further one is begun.", "no limit")
    ] = None,
    time: TimeFlag = None,
    thorough: Annotated[
        bool,
        option(
            "Shrink every failure to its smallest values, also those of a cause certified before.", flag="--thorough"
        ),
    ] = False,
    workers: WorkersFlag = None,
    executor: ExecutorFlag = None,
    trust: TrustFlag = False,
    json: JsonFlag = False,
) -> None:
    """Say which failures can be trusted, and what they are due to.

    Every failure is confirmed, solved by an expert, shrunk to the operators that it takes, and attributed to them.
    Failures that were triaged before are left as they are. Those that show the commonest causes come first, so that
    --limit, --rollouts and --time leave out what matters least; the next triage goes on. A failure that a cause
    certified before explains is certified with the values that it was found with.
    """
    from vlafuzz.common.deadline import deadline

    numbers = {"--max-rollouts": max_rollouts, "--limit": limit, "--rollouts": rollouts, "--workers": workers}
    for name, value in numbers.items():
        check_number(name, value, 1)
    until = deadline("--time", time)
    if not store.is_file():
        raise UsageError(f"{store}: no such store", hint="`vlafuzz run` says where its store is")
    from vlafuzz.failures.causes import all_causes
    from vlafuzz.failures.triage.jobs import Allowance
    from vlafuzz.failures.triage.pipeline import usual_workers
    from vlafuzz.rollouts.registry import place_of
    from vlafuzz.store.store import Store

    note_alone(store)
    with Store.open(store) as opened:
        place = place_of(workers or (1 if executor == "local" else usual_workers(opened)), executor)
    options = {"max_rollouts": max_rollouts, "limit": limit, "thorough": thorough}
    result = triage_store(store, Allowance(rollouts, until), place, show=not json, **options)
    with Store.open(store) as opened:
        found = all_causes(opened)
    if json:
        print_json(result | {"runs": [{"run": one.run, **one.document()} for one in found]})
    else:
        for one in found:
            print_causes(one)
    if told := broken(result):
        raise PrerequisiteError(told, hint=f"`vlafuzz doctor --policy` examines the policy; {AGAIN}")


def broken(result: Mapping[str, Any]) -> str:
    """How many failures could not be judged as policy or simulator broke; empty where none."""
    number = result.get("broken", 0)
    return f"{plural(number, 'failure')} could not be judged: policy or simulator broke" if number else ""


def note_alone(store: Path) -> None:
    """Note runs of which nobody says which model they tested."""
    from vlafuzz.store.store import Store

    with Store.open(store) as opened:
        alone = [str(run.id) for run in opened.runs() if run.manifest.alone]
    if alone:
        Bar.note(f"note: run {', '.join(alone)}: what answers now has to be the model that was tested then")


def triage_store(
    store: Path, allowance: Allowance, place: Place, *, causes_of: int | None = None, show: bool, **options: Any
) -> dict[str, Any]:
    """Triage what is left to triage in a store; its failures then as JSON and, with ``show``, printed.

    Args:
        causes_of: a run: only the failures that show its commonest causes.
        options: ``max_rollouts``, ``limit`` and ``thorough`` of ``pipeline.triage``.
    """
    from vlafuzz.failures.triage.pipeline import Progress, certify_causes, hours, triage
    from vlafuzz.failures.triage.scene_runner import runner_of_run
    from vlafuzz.failures.triage.summary import summarise
    from vlafuzz.failures.triage.triager import Unjudged
    from vlafuzz.store.store import Store

    with Store.open(store) as opened:  # to write, an empty file would be made a store
        trust = trust_flag(*(run.manifest.policy for run in opened.runs()))
    again = shlex.join(["vlafuzz", "triage", str(store), *trust])
    kind, hint = ("failures", f"\nhint: continue with `{again}`") if causes_of is None else ("causes", "")

    def watch(now: Progress) -> None:
        took = f", {plural(now.rollouts, 'rollout')}" if now.rollouts else ""  # of those that are done
        bar.progress(f"{kind}{took}", now.done, now.findings)

    note = f"interrupted: all finished {kind} are stored{hint}"
    with interruptible(note) as bar, Store.open(store, "write") as opened:
        runner = partial(runner_of_run, store, note=Bar.note)
        within: dict[str, Any] = {"allowance": allowance, "place": place, "watch": watch}
        if causes_of is None:
            _forecast(opened, options.get("limit"), place.workers, allowance)
            unjudged = triage(opened, runner, **within, **options)
        else:
            unjudged = certify_causes(opened, runner, causes_of, **within)
        summary = summarise(opened)
    if show:
        _print(summary)
    if unfair := unjudged[Unjudged.UNFAIR]:
        Bar.note(f"{plural(unfair, 'failure')} could not be judged: no longer fair")
    left = summary.findings - summary.triaged
    if causes_of is None and allowance.used_up and left:
        over = "--rollouts are used up" if allowance.spent_all else "--time is over; what is begun is kept"
        with Store.open(store) as opened:
            takes = hours(opened, left)
        which = f"{plural(left, 'failure')} {'is' if left == 1 else 'are'} left"
        Bar.note(f"{which}: {over}\nhint: continue with `{again}`{takes}")
    return asdict(summary) | {"unjudged": unjudged.total(), "broken": unjudged[Unjudged.BROKEN]}


def _forecast(store: Store, limit: int | None, workers: int, allowance: Allowance) -> None:
    """Say how long triage will take, unless nobody will have to wait."""
    from vlafuzz.campaign.forecast import NOBODY_WAITS
    from vlafuzz.failures.triage.pipeline import PER_FINDING, expected

    done = {triaged.key for triaged in store.triaged()}
    left = len([finding for finding in store.findings() if finding.key not in done][:limit])
    one, within, failures = expected(store, 1, workers), allowance.deadline.left, plural(left, "failure")
    seconds = left * one
    if allowance.rollouts:
        seconds *= min(allowance.rollouts / (PER_FINDING * max(left, 1)), 1.0)
    if left and within < one:
        Bar.note(f"a failure takes about {duration(one)}: --time may end before the first one is done")
    elif seconds > within:
        done_in_time = f"about {math.floor(within / one)} of {failures}"
        Bar.note(f"in {duration(within)} (--time): {done_in_time}, which take about {duration(one)} each")
    elif seconds > NOBODY_WAITS:
        basis = f"about {PER_FINDING} rollouts each, which take as long as those of the run"
        Bar.note(f"about {duration(seconds)}: {failures}, {basis}")


def _print(summary: TriageSummary) -> None:
    def share(count: int, of: int = summary.triaged) -> str:
        return f"{count} ({count / of:.0%})" if of else "0"

    rows = {
        "failures": summary.findings,
        "triaged": summary.triaged,
        "confirmed": share(summary.confirmed),
        "witnessed": share(summary.witnessed),
        "of these, by sight": share(summary.by_sight, summary.witnessed),
        **{name: share(count) for name, count in summary.buckets.items()},
        "distinct causes": summary.distinct_signatures,
        "operators not nominal before, median": summary.deviating_before,
        "operators left, median": summary.deviating_after,
        "rollouts to shrink one, median": summary.shrink_rollouts,
        "policy rollouts": summary.policy_rollouts,
        "expert rollouts": summary.expert_rollouts,
        "seconds": round(summary.seconds, 1),
    }
    print_rows([{"what": name, "value": value} for name, value in rows.items()], title=summary.store)
    if summary.signatures:
        causes = [{"cause": name, "failures": count} for name, count in summary.signatures.items()]
        print_rows(causes, title="failures by cause")


def print_causes(found: CauseList) -> None:
    """Print the causes of a run as a list, and what is known beside them."""
    print_list([(*cause.conditions, cause.says) for cause in found.causes], title=found.title)
    print_lines(*found.sentences)
