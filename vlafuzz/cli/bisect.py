"""``vlafuzz bisect``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import AlphaFlag, AnswersFlag, ServedFlag, TimeFlag, TrustFlag
from vlafuzz.cli.output import interruptible, print_json, print_rows, stdout
from vlafuzz.common.deadline import deadline
from vlafuzz.common.text import percent
from vlafuzz.errors import UsageError, check_number, check_probability

if TYPE_CHECKING:
    from vlafuzz.failures.corpus.bisect import Bisection

NOT_KEPT = "with --answers FILE outcomes are kept, and the same command goes on"


def command(
    corpus: Annotated[Path, typer.Argument(help="A folder that `vlafuzz export --minimal` wrote.")],
    more: Annotated[list[str] | None, typer.Argument(hidden=True, metavar="checkpoint")] = None,
    checkpoints: Annotated[
        list[str] | None, typer.Option(help="Checkpoints in the order of their training: A B C …", metavar="A B C …")
    ] = None,
    policy: Annotated[
        str,
        typer.Option(
            help="How a checkpoint {} is named as a policy: lerobot:{}; without {}, where all are served.",
            metavar="NAME",
        ),
    ] = "{}",
    label: ServedFlag = None,
    baseline: Annotated[
        str | None,
        typer.Option(
            help="A policy that works, to be rolled out, too.", show_default="what the corpus recorded of its own"
        ),
    ] = None,
    alpha: AlphaFlag = 0.05,
    error: Annotated[float, typer.Option(help="Probability up to which something else may have happened.")] = 0.05,
    comparisons: Annotated[
        int | None, typer.Option(help="Most comparisons.", show_default="log2 of the checkpoints, and 2")
    ] = None,
    time: TimeFlag = None,
    trust: TrustFlag = False,
    answers: AnswersFlag = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Find out which checkpoint broke a policy: exit code 1 if one did.

    First the last checkpoint is compared with the baseline in the controls of a corpus, as `vlafuzz regress` does. If
    it is worse, a binary search that expects noise compares few of the others, each until it is clear whether it is
    broken, and then whether all of the loss came in one step.

    Checkpoints that are served at one address in turn are told apart by their labels. Whenever another one has to
    answer, the exit code is 3, and a message says which.
    """
    names = [*(checkpoints or ()), *(more or ())]
    _check(names, policy, baseline, alpha, error, comparisons)
    until = deadline("--time", time)
    in_turn = "{}" not in policy
    from vlafuzz.failures.corpus.folder import read_corpus
    from vlafuzz.failures.corpus.policies import bisect_checkpoints
    from vlafuzz.failures.corpus.tables import bisection_document
    from vlafuzz.model.label import Model

    exported = read_corpus(corpus)
    kept = f"the outcomes are kept in {answers}: the same command goes on" if answers else NOT_KEPT
    with interruptible(f"interrupted\nhint: {kept}") as bar:
        result = bisect_checkpoints(
            corpus,
            exported,
            [Model(policy, name) if in_turn else Model(policy.replace("{}", name)) for name in names],
            baseline,
            label=label or "",
            alpha=alpha,
            error=error,
            comparisons=comparisons,
            deadline=until,
            answers=answers,
            watch=bar,
        )
    if json:
        print_json(bisection_document(result, exported))
    else:
        _print(result)
    if result.alarm:
        raise typer.Exit(1)


def _check(
    names: list[str], policy: str, baseline: str | None, alpha: float, error: float, comparisons: int | None
) -> None:
    """Check the flags before anything is run."""
    from vlafuzz.failures.corpus.bisect import check_checkpoints
    from vlafuzz.model.label import check_label
    from vlafuzz.rollouts.policies import check_policy_name, is_built_in

    check_checkpoints(names)
    check_probability("--alpha", alpha)
    check_probability("--error", error)
    check_number("--comparisons", comparisons, 1)
    if "{}" not in policy and is_built_in(policy):
        hint = "for example --policy lerobot:{} --checkpoints out/010000 out/020000"
        raise UsageError(f"--policy: {policy!r} has no {{}} for the checkpoint", hint=hint)
    for name in names:
        if "{}" not in policy:
            check_label("--checkpoints", name)
    for name in filter(None, (*(policy.replace("{}", name) for name in names), baseline)):
        check_policy_name(name)


def _print(result: Bisection) -> None:
    rows = [
        {
            "checkpoint": step.checkpoint,
            "controls": step.of,
            "baseline passes": step.baseline_passed,
            "checkpoint passes": step.passed,
            "broken": percent(step.broken),
        }
        for step in result.steps
    ]
    print_rows(rows, title=f"comparisons with {result.baseline}")
    early = "" if result.in_time else "--time is over: "
    stdout().print(f"{early}{result.verdict}", soft_wrap=True)
