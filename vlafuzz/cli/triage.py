"""``vlafuzz triage``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import ExecutorFlag, JsonFlag, TimeFlag, TrustFlag, WorkersFlag, option
from vlafuzz.cli.output import Bar, interruptible, print_json, print_lines, print_list, print_rows
from vlafuzz.common.plugins import command as command_line
from vlafuzz.common.text import duration, plural
from vlafuzz.errors import PrerequisiteError, UsageError, check_number

if TYPE_CHECKING:
    from vlafuzz.failures.triage.pipeline import Allowance, Progress, TriageSummary
    from vlafuzz.failures.triage.triager import Unjudged
    from vlafuzz.store.store import Store

AGAIN = "the next triage tries them again"


def command(
    store: Annotated[Path, typer.Argument(help="A store that `vlafuzz run` wrote.")],
    limit: Annotated[int | None, option("Most failures to work on.", "all that are left")] = None,
    time: TimeFlag = None,
    workers: WorkersFlag = None,
    executor: ExecutorFlag = None,
    trust: TrustFlag = False,
    json: JsonFlag = False,
) -> None:
    """Say which failures can be trusted, and what they are due to.

    Every failure is confirmed, solved by an expert, shrunk to the operators that it takes, and attributed to them.
    Failures that were triaged before are left as they are. Those that show the commonest causes come first, so that
    --limit and --time leave out what matters least; the next triage goes on. A failure that a cause
    certified before explains is certified with the values that it was found with.
    """
    from vlafuzz.common.deadline import deadline

    for name, value in {"--limit": limit, "--workers": workers}.items():
        check_number(name, value, 1)
    until = deadline("--time", time)
    if not store.is_file():
        raise UsageError(f"{store}: no such store", hint="`vlafuzz run` says where its store is")
    from vlafuzz.failures.causes import all_causes
    from vlafuzz.failures.triage.pipeline import Allowance, hours, runner_of_run, summarise, triage, usual_workers
    from vlafuzz.failures.triage.triager import Unjudged
    from vlafuzz.rollouts.registry import place_of
    from vlafuzz.store.store import Store

    with Store.open(store) as opened:  # to write, an empty file would be made a store
        place = place_of(workers or (1 if executor == "local" else usual_workers(opened)), executor)
        names = [name for run in opened.runs() for name in (run.manifest.policy, run.manifest.task)]
        again = command_line("triage", store, names=names)
    allowance = Allowance(deadline=until)
    with (
        interruptible(f"interrupted: all finished failures are stored\nhint: continue with `{again}`") as bar,
        Store.open(store, "write") as opened,
    ):
        wanted = len(opened.triaged()) + _forecast(opened, limit, place.workers, allowance)
        unjudged = triage(
            opened,
            partial(runner_of_run, store, note=Bar.note),
            limit=limit,
            allowance=allowance,
            place=place,
            watch=shown_on(bar, "failures"),
        )
        summary = summarise(opened)
    if not json:
        _print(summary)
    broken = note_unjudged(unjudged)
    left = summary.findings - summary.triaged
    with Store.open(store) as opened:
        found = all_causes(opened)
        if allowance.used_up and summary.triaged + unjudged.total() < wanted:
            hint = f"hint: continue with `{again}`{hours(opened, left)}"
            Bar.note(f"{plural(left, 'failure')} left: --time is over\n{hint}")
    if json:
        counts = {"unjudged": unjudged.total(), "broken": unjudged[Unjudged.BROKEN]}
        print_json(asdict(summary) | counts | {"runs": [{"run": one.run, **one.document()} for one in found]})
    else:
        for one in (one for one in found if one.causes):  # of the others the table above says what triage found
            print_list([(*cause.conditions, cause.says) for cause in one.causes], title=one.title)
            print_lines(*one.sentences)
    if broken:
        raise PrerequisiteError(broken, hint=f"`vlafuzz doctor --policy` examines the policy; {AGAIN}")


def note_unjudged(unjudged: Counter[Unjudged]) -> str:
    """Note failures that are no longer fair; how many others could not be judged, empty where none."""
    from vlafuzz.failures.triage.triager import Unjudged

    if unfair := unjudged[Unjudged.UNFAIR]:
        Bar.note(f"{plural(unfair, 'failure')} could not be judged: no longer fair")
    broken = unjudged[Unjudged.BROKEN]
    return f"{plural(broken, 'failure')} could not be judged: policy or simulator broke" if broken else ""


def shown_on(bar: Bar, kind: str) -> Callable[[Progress], None]:
    """Shows how far triage of failures or causes is."""

    def watch(now: Progress) -> None:
        took = f", {plural(now.rollouts, 'rollout')}" if now.rollouts else ""  # of those that are done
        bar.progress(f"{kind}{took}", now.done, now.findings)

    return watch


def _forecast(store: Store, limit: int | None, workers: int, allowance: Allowance) -> int:
    """Say how long triage will take, unless nobody will have to wait; the number of failures."""
    from vlafuzz.campaign.forecast import NOBODY_WAITS
    from vlafuzz.failures.triage.pipeline import expected, pace

    done = {triaged.key for triaged in store.triaged()}
    left = len([finding for finding in store.findings() if finding.key not in done][:limit])
    rollouts = expected(store, left)
    seconds, within = rollouts * pace(store, workers), allowance.deadline.left
    if seconds > min(NOBODY_WAITS, within):
        end = f"; --time ends it after {duration(within)}" if seconds > within else ""
        of = f"{plural(left, 'failure')}, about {plural(rollouts, 'rollout')} as long as the run's"
        Bar.note(f"about {duration(seconds)}: {of}{end}")
    return left


def _print(summary: TriageSummary) -> None:
    def share(count: int, of: int = summary.triaged) -> str:
        return f"{count} ({count / of:.0%})" if of else "0"

    rows = {
        "failures": summary.findings,
        "triaged": summary.triaged,
        "confirmed": share(summary.confirmed),
        "witnessed": share(summary.witnessed),
        "of these, by sight": share(summary.by_sight, summary.witnessed),
        **{name.replace("witnessed", "confirmed, not minimal"): share(some) for name, some in summary.buckets.items()},
        "distinct causes": summary.distinct_signatures,
        "policy rollouts": summary.policy_rollouts,
        "expert rollouts": summary.expert_rollouts,
    }
    print_rows([{"what": name, "value": value} for name, value in rows.items()], title=summary.store)
    print_lines(f"`{command_line('report', summary.store)}` lists the failures with what each takes")
