"""``vlafuzz triage``."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.cli.flags import TimeFlag, TrustFlag, WorkersFlag
from vlafuzz.cli.output import Bar, interruptible, print_json, print_list, print_rows, stdout
from vlafuzz.common.plugins import trust_flag
from vlafuzz.common.text import duration, plural
from vlafuzz.errors import PrerequisiteError, UsageError, check_number

if TYPE_CHECKING:
    from vlafuzz.failures.triage.jobs import Allowance
    from vlafuzz.failures.triage.summary import TriageSummary
    from vlafuzz.failures.triage.triager import Unjudged
    from vlafuzz.report.causes import CauseList
    from vlafuzz.store.store import Store

AGAIN = "the next triage tries them again"


def command(
    store: Annotated[Path, typer.Argument(help="A store that `vlafuzz run` wrote.")],
    max_rollouts: Annotated[
        int | None,
        typer.Option(
            help="Most policy rollouts to shrink, certify and attribute one finding.",
            show_default="200, of a stochastic policy 1000",
        ),
    ] = None,
    limit: Annotated[
        int | None, typer.Option(help="Most findings to work on.", show_default="all that are left")
    ] = None,
    rollouts: Annotated[
        int | None,
        typer.Option(
            help="Policy rollouts of all findings together, after which no further one is begun.",
            show_default="no limit",
        ),
    ] = None,
    time: TimeFlag = None,
    thorough: Annotated[
        bool,
        typer.Option(
            "--thorough",
            help="Shrink every finding to its smallest values, also those of a cause certified before.",
        ),
    ] = False,
    workers: WorkersFlag = None,
    trust: TrustFlag = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Say which failures can be trusted, and what they are due to.

    Every finding is confirmed, solved by an expert, shrunk to the operators that it takes, and attributed to
    them. Findings that were triaged before are left as they are. Those that show the commonest causes come
    first, so that --limit, --rollouts and --time leave out what matters least; the next triage goes on.
    A finding that a cause certified before explains is certified with the values that it was found with.
    """
    from vlafuzz.common.deadline import deadline

    numbers = {"--max-rollouts": max_rollouts, "--limit": limit, "--rollouts": rollouts, "--workers": workers}
    for name, value in numbers.items():
        check_number(name, value, 1)
    until = deadline("--time", time)
    if not store.is_file():
        raise UsageError(f"{store}: no such store", hint="`vlafuzz run` says where its store is")
    from vlafuzz.failures.triage.jobs import Allowance
    from vlafuzz.report.causes import all_causes
    from vlafuzz.store.store import Store

    note_alone(store)
    allowance = Allowance(rollouts, until)
    result = triage_store(
        store, max_rollouts, limit, workers, allowance=allowance, thorough=thorough, show=not json
    )
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
    """How many findings could not be judged as policy or simulator broke; empty where none."""
    number = result.get("broken", 0)
    return f"{plural(number, 'finding')} could not be judged: policy or simulator broke" if number else ""


def note_alone(store: Path) -> None:
    """Note runs of which nobody says which model they tested."""
    from vlafuzz.store.store import Store

    with Store.open(store) as opened:
        alone = [str(run.id) for run in opened.runs() if run.manifest.alone]
    if alone:
        Bar.note(f"note: run {', '.join(alone)}: what answers now has to be the model that was tested then")


def triage_store(
    store: Path,
    max_rollouts: int | None = None,
    limit: int | None = None,
    workers: int | None = None,
    *,
    allowance: Allowance | None = None,
    causes_of: int | None = None,
    thorough: bool = False,
    show: bool,
) -> dict[str, Any]:
    """Triage what is left to triage in a store; its findings then as JSON and, with ``show``, printed.

    Args:
        causes_of: a run: only the findings that show its commonest causes.
        thorough: see ``pipeline.triage``.
    """
    from vlafuzz.failures.triage.pipeline import hours
    from vlafuzz.failures.triage.triager import Unjudged
    from vlafuzz.store.store import Store

    with Store.open(store) as opened:
        trust = trust_flag(*(run.manifest.policy for run in opened.runs()))
    again = shlex.join(["vlafuzz", "triage", str(store), *trust])
    note = "interrupted: all finished causes are stored"
    if causes_of is None:
        note = f"interrupted: all finished findings are stored\nhint: continue with `{again}`"
    with interruptible(note) as bar:
        summary, unjudged = _triage(store, max_rollouts, limit, workers, allowance, causes_of, thorough, bar)
    if show:
        _print(summary)
    if unfair := unjudged[Unjudged.UNFAIR]:
        Bar.note(f"{plural(unfair, 'finding')} could not be judged: no longer fair")
    left = summary.findings - summary.triaged
    if left and causes_of is None and allowance and allowance.used_up:
        verb = "is" if left == 1 else "are"
        over = "--rollouts are used up" if allowance.spent_all else "--time is over; what is begun is kept"
        with Store.open(store) as opened:
            takes = hours(opened, left)
        Bar.note(f"{plural(left, 'finding')} {verb} left: {over}\nhint: continue with `{again}`{takes}")
    return asdict(summary) | {"unjudged": unjudged.total(), "broken": unjudged[Unjudged.BROKEN]}


def _triage(
    store: Path,
    max_rollouts: int | None,
    limit: int | None,
    workers: int | None,
    allowance: Allowance | None,
    causes_of: int | None,
    thorough: bool,
    bar: Bar,
) -> tuple[TriageSummary, Counter[Unjudged]]:
    """The summary of the store after triage, and how many findings could not be judged, by the reason."""
    from vlafuzz.failures.triage.pipeline import Progress, certify_causes, triage, usual_workers
    from vlafuzz.failures.triage.scene_runner import runner_of_run
    from vlafuzz.failures.triage.summary import summarise
    from vlafuzz.store.store import Store

    noun = "findings" if causes_of is None else "causes"

    def watch(now: Progress) -> None:
        took = f", {plural(now.rollouts, 'rollout')}" if now.rollouts else ""  # of those that are done
        bar.progress(f"{noun}{took}", now.done, now.findings)

    Store.open(store).close()  # to write, an empty file would be made a store
    with Store.open(store, "write") as opened:
        runner = partial(runner_of_run, store, note=Bar.note)
        workers = workers or usual_workers(opened)
        if causes_of is None:
            _forecast(opened, limit, workers, allowance)
        if causes_of is None:
            unjudged = triage(
                opened,
                runner,
                max_rollouts=max_rollouts,
                limit=limit,
                allowance=allowance,
                workers=workers,
                thorough=thorough,
                watch=watch,
            )
        else:
            unjudged = certify_causes(
                opened, runner, causes_of, allowance=allowance, workers=workers, watch=watch
            )
        return summarise(opened), unjudged


def _forecast(store: Store, limit: int | None, workers: int, allowance: Allowance | None) -> None:
    """Say how long triage will take, unless nobody will have to wait."""
    from vlafuzz.campaign.forecast import NOBODY_WAITS
    from vlafuzz.failures.triage.pipeline import PER_FINDING, expected

    done = {triaged.key for triaged in store.triaged()}
    left = [finding for finding in store.findings() if finding.key not in done][:limit]
    seconds = expected(store, len(left), workers)
    if allowance and allowance.rollouts:
        seconds *= min(allowance.rollouts / (PER_FINDING * max(len(left), 1)), 1.0)
    one = expected(store, 1, workers)
    within = allowance.deadline.left if allowance else math.inf
    if left and within < one:
        Bar.note(f"a finding takes about {duration(one)}: --time may end before the first one is done")
    elif seconds > within:
        done_in_time = f"about {int(within / one)} of {plural(len(left), 'finding')}"
        Bar.note(f"in {duration(within)} (--time): {done_in_time}, which take about {duration(one)} each")
    elif seconds > NOBODY_WAITS:
        basis = f"about {PER_FINDING} rollouts each, which take as long as those of the run"
        Bar.note(f"about {duration(seconds)}: {plural(len(left), 'finding')}, {basis}")


def _print(summary: TriageSummary) -> None:
    shares = {name: _share(count, summary.triaged) for name, count in summary.buckets.items()}
    rows = {
        "findings": summary.findings,
        "triaged": summary.triaged,
        "confirmed": _share(summary.confirmed, summary.triaged),
        "witnessed": _share(summary.witnessed, summary.triaged),
        "of these, by sight": _share(summary.by_sight, summary.witnessed),
        **{f"in bucket {name}": share for name, share in shares.items()},
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
        causes = [{"cause": name, "findings": count} for name, count in summary.signatures.items()]
        print_rows(causes, title="findings by cause")


def print_causes(found: CauseList) -> None:
    """Print the causes of a run as a list, and what is known beside them."""
    causes = [(*cause.conditions, cause.says) for cause in found.causes]
    print_list(causes, title=found.table.title)
    for sentence in found.sentences:
        stdout().print(sentence, soft_wrap=True)


def _share(count: int, of: int) -> str:
    return f"{count} ({count / of:.0%})" if of else "0"
