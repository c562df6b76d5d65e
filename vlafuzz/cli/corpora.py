"""``regress``, ``diff``, ``bisect`` and ``confirm``: other policies or worlds in scenes of a corpus or store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import (
    AlphaFlag,
    JsonFlag,
    LabelFlag,
    TimeFlag,
    TrustFlag,
    VideosFlag,
    WorkersFlag,
    option,
    option_of,
)
from vlafuzz.cli.output import Bar, interruptible, print_json, print_lines, print_list, print_rows
from vlafuzz.common.deadline import deadline
from vlafuzz.errors import PrerequisiteError, UsageError, check_number, check_probability

if TYPE_CHECKING:
    from vlafuzz.failures.corpus.diff import Difference
    from vlafuzz.report.view import View

UNFIT = 4  # exit code where the policy does not work in the other world, so that its failures there say nothing
CorpusFlag = Annotated[Path, typer.Argument(help="A folder that `vlafuzz export --minimal` wrote.")]
BaselineFlag = Annotated[
    str | None, option("Roll out this policy as the baseline, too.", "what the corpus recorded of its own")
]


def _check_policies(*names: str | None) -> None:
    from vlafuzz.rollouts.policies import check_policy_name

    for name in filter(None, names):
        check_policy_name(name)


def regress(
    corpus: CorpusFlag,
    policy: Annotated[str, option_of("policy", "")],
    label: LabelFlag = None,
    baseline: BaselineFlag = None,
    alpha: AlphaFlag = 0.05,
    nights: Annotated[int, option("Comparisons with this corpus, such as one a night, that share --alpha.")] = 1,
    whole: Annotated[bool, option("Do not stop at an alarm: run everything.", flag="--whole")] = False,
    time: TimeFlag = None,
    trust: TrustFlag = False,
    json: JsonFlag = False,
) -> None:
    """Check whether a policy got worse: exit code 1 if it fails more often than the baseline.

    Both are compared in the controls of a corpus, random scenes that no outcome selected; a sequential test decides,
    and ends at an alarm. Then the failing scenes are run, jittered, to show what is fixed. They raise no alarm: they
    were selected by what the corpus's own policy does.
    """
    _check_policies(policy, baseline)
    check_probability("--alpha", alpha)
    check_number("--nights", nights, 1)
    until = deadline("--time", time)
    from vlafuzz.failures.corpus.policies import compare_policies
    from vlafuzz.failures.corpus.tables import difference, document, tables

    with Bar() as bar:
        compared = compare_policies(
            corpus,
            policy,
            baseline,
            label=label or "",
            alpha=alpha,
            nights=nights,
            whole=whole,
            deadline=until,
            watch=bar,
        )
    if json:
        print_json(document(compared))
    else:
        for title, rows in tables(compared).items():
            print_rows(rows, title=title)
        early = {"worse": "stopped", "time": "--time is over"}.get(compared.stopped)
        stopped = f"{early} after {compared.tried} controls: " if early else ""
        print_lines(difference(compared), compared.changes, f"{stopped}{compared.verdict}")
    if compared.alarm:
        raise typer.Exit(1)
    if not compared.tells:
        details = (scene.detail for scene in compared.compared if scene.standing in ("error", "invalid"))
        broken = next((f": {detail}" for detail in details if detail), "")
        hint = "`vlafuzz doctor` checks this machine; were the rollouts too few, give more --time"
        raise PrerequisiteError(compared.verdict + broken, hint=hint)


def diff(
    a: Annotated[Path, typer.Argument(help="A store or a corpus of the first policy.")],
    b: Annotated[Path, typer.Argument(help="A store or a corpus of the second policy.")],
    policy_a: Annotated[str | None, option("The first policy, if it has another name now.", "as in A")] = None,
    policy_b: Annotated[str | None, option("The second policy, if it has another name now.", "as in B")] = None,
    alpha: AlphaFlag = 0.05,
    out: Annotated[Path | None, option("Write one HTML page, with films of both.", "the terminal")] = None,
    videos: VideosFlag = True,
    trust: TrustFlag = False,
    json: JsonFlag = False,
) -> None:
    """Compare two policies by the causes of their failures: which are fixed, which remain, which are new.

    Both are rolled out where one of them is certified to fail: each scene three times or more, each cause eight times
    or more, jittered. A cause is fixed, or new, only if a paired test shows that one of them passes there more often.
    """
    check_probability("--alpha", alpha)
    _check_policies(policy_a, policy_b)
    from vlafuzz.failures.corpus.diff import diff_policies
    from vlafuzz.failures.corpus.tables import difference_document, difference_rows
    from vlafuzz.report.page import check_place
    from vlafuzz.report.sources import view_of

    if out:  # what is wrong with it is said before minutes go by
        check_place(out)
    views = [view_of(source) for source in (a, b)] if out else []
    with Bar() as bar:
        result = diff_policies(a, b, policy_a, policy_b, alpha=alpha, watch=bar)
    if json:
        print_json(difference_document(result))
    else:
        print_rows(difference_rows(result), title=f"{result.first} and {result.second}")
        print_lines(result.verdict)
    if out:
        _write_difference(a, b, result, views, out, videos=videos)


def _write_difference(a: Path, b: Path, result: Difference, views: Sequence[View], out: Path, *, videos: bool) -> None:
    from vlafuzz.cli.report import FILMED, with_films, write
    from vlafuzz.report.differences import view_of_difference
    from vlafuzz.report.films import RunFilms, of_both

    first, second = views
    view = view_of_difference(first, second, result)
    if videos:
        in_b = {run.key(): b for run in second.runs}
        films = [RunFilms(a, policy, in_b) for policy in result.asked]
        view = with_films(view, films, partial(of_both, (result.first, result.second), films), FILMED)
    write(out, view)


def bisect(
    corpus: CorpusFlag,
    more: Annotated[list[str] | None, typer.Argument(hidden=True, metavar="checkpoint")] = None,
    checkpoints: Annotated[list[str] | None, option("Checkpoints in the order of their training: A B C …")] = None,
    policy: Annotated[str, option("How a checkpoint {} is named as a policy: lerobot:{}.")] = "{}",
    baseline: BaselineFlag = None,
    alpha: AlphaFlag = 0.05,
    error: Annotated[float, option("Probability up to which something else may have happened.")] = 0.05,
    comparisons: Annotated[int | None, option("Most comparisons.", "log2 of the checkpoints, and 2")] = None,
    time: TimeFlag = None,
    trust: TrustFlag = False,
    json: JsonFlag = False,
) -> None:
    """Find out which checkpoint broke a policy: exit code 1 if one did.

    First the last checkpoint is compared with the baseline, as `vlafuzz regress` does. If it is worse, a binary search
    that expects noise compares few of the others, until it is clear whether all of the loss came in one step.
    """
    check_probability("--alpha", alpha)
    check_probability("--error", error)
    check_number("--comparisons", comparisons, 1)
    if "{}" not in policy:
        hint = "for example --policy lerobot:{} --checkpoints out/010000 out/020000"
        raise UsageError(f"--policy: {policy!r} has no {{}} for the checkpoint", hint=hint)
    names = [policy.replace("{}", name) for name in (*(checkpoints or ()), *(more or ()))]
    _check_policies(*names, baseline)
    until = deadline("--time", time)
    from vlafuzz.failures.corpus.policies import bisect_checkpoints
    from vlafuzz.failures.corpus.tables import bisection_document

    with Bar() as bar:
        options = {"alpha": alpha, "error": error, "comparisons": comparisons, "deadline": until}
        result = bisect_checkpoints(corpus, names, baseline, watch=bar, **options)
    told = bisection_document(result, corpus.resolve().name)
    if json:
        print_json(told)
    else:
        print_rows(told["compared"], title=f"compared with {result.last.baseline}")
        print_lines(f"{'' if result.in_time else '--time is over: '}{result.verdict}")
    if result.alarm:
        raise typer.Exit(1)


def confirm(
    source: Annotated[Path, typer.Argument(help="A store that `vlafuzz triage` worked on, or a corpus.")],
    world: Annotated[str, option("The other world, which has the same tasks.", "none")],
    workers: WorkersFlag = None,
    trust: TrustFlag = False,
    json: JsonFlag = False,
) -> None:
    """Say which certified causes hold in another world too, and which are the first simulator's own.

    First the policy is rolled out in nominal scenes there: below 70 % success causes are not compared (exit code 4).
    Then it is, jittered, in the scene of each cause and in its passing neighbours, as certification does: a cause holds
    if it is shown to fail more often, most likely by 20 points; it does not where that has become improbable.
    """
    from vlafuzz.failures.causes import counted
    from vlafuzz.failures.confirmation import confirm as confirmed_in

    check_number("--workers", workers, 1)
    with interruptible("interrupted: nothing is kept") as bar:
        result = confirmed_in(source, world, bar, workers)
    if json:
        print_json(asdict(result))
    else:
        items = []
        for one in result.causes:
            here, there = (
                f"fails {', without it '.join(counted(rate) if rate else 'unknown' for rate in rates)}"
                for rates in (one.found, one.other)
            )
            why = f" ({one.why})" if one.why else ""
            small = f"where it was found: {here} · {one.task} · {one.scene[:12]}"
            items.append((one.cause, f"{one.verdict} in {world}{why}: {there}", small))
        print_list(items, title=f"Causes of {source} in {world}")
        print_lines(result.says)
    if result.unfit:
        raise typer.Exit(UNFIT)
