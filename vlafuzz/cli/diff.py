"""``vlafuzz diff``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.flags import AnswersFlag, ServedFlag, TrustFlag, label_option
from vlafuzz.cli.output import Bar, print_json, print_rows, stdout
from vlafuzz.errors import check_probability


def command(
    a: Annotated[Path, typer.Argument(help="A store or a corpus of the first policy.")],
    b: Annotated[Path, typer.Argument(help="A store or a corpus of the second policy.")],
    policy_a: Annotated[
        str | None, typer.Option(help="The first policy, if it has another name now.", show_default="as in A")
    ] = None,
    policy_b: Annotated[
        str | None, typer.Option(help="The second policy, if it has another name now.", show_default="as in B")
    ] = None,
    label_a: Annotated[
        str | None, label_option("--label-a", "Which model the first policy is, or which of those in A.", "as in A")
    ] = None,
    label_b: Annotated[
        str | None, label_option("--label-b", "Which model the second policy is, or which of those in B.", "as in B")
    ] = None,
    label: ServedFlag = None,
    answers: AnswersFlag = None,
    run_a: Annotated[int | None, typer.Option(help="Only this run of A.", show_default="all runs")] = None,
    run_b: Annotated[int | None, typer.Option(help="Only this run of B.", show_default="all runs")] = None,
    alpha: Annotated[float, typer.Option(help="Probability of a false claim of a test, at most.")] = 0.05,
    trust: TrustFlag = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Compare two policies by the causes of their failures: which are fixed, which remain, which are new.

    Both are rolled out where one of them is certified to fail, and in the passing scenes beside these: each scene three
    times or more, each cause eight times or more, jittered. A cause is fixed, or new, only if a paired test shows that
    one of them passes there more often.

    Two models that are served at one address in turn are told apart by their labels, and take two commands with the
    same --answers: one while the one answers, and the same with the other --label once the other one does. Until then
    the exit code is 3.
    """
    from vlafuzz.rollouts.policies import check_policy_name

    check_probability("--alpha", alpha)
    for name in filter(None, (policy_a, policy_b)):
        check_policy_name(name)
    from vlafuzz.failures.corpus.policies import diff_policies
    from vlafuzz.failures.corpus.tables import difference_document, difference_rows

    with Bar() as bar:
        result = diff_policies(
            a,
            b,
            policy_a,
            policy_b,
            label_a=label_a or "",
            label_b=label_b or "",
            label=label or "",
            answers=answers,
            run_a=run_a,
            run_b=run_b,
            alpha=alpha,
            watch=bar,
        )
    if json:
        print_json(difference_document(result))
        return
    print_rows(difference_rows(result), title=f"{result.first} and {result.second}")
    stdout().print(result.verdict, soft_wrap=True)
