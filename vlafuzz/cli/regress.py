"""``vlafuzz regress``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.output import Bar, print_json, print_rows, stdout
from vlafuzz.errors import PrerequisiteError, UsageError, check_number

if TYPE_CHECKING:
    from vlafuzz.regression.corpus import Corpus
    from vlafuzz.regression.regress import Comparison


def command(
    corpus: Annotated[Path, typer.Argument(help="A folder that `vlafuzz export --minimal` wrote.")],
    policy: Annotated[str, typer.Option(help="The policy under test, or python:pkg.mod:factory.")],
    baseline: Annotated[
        str | None,
        typer.Option(help="Roll out this policy, too.", show_default="what the corpus recorded of its own"),
    ] = None,
    alpha: Annotated[float, typer.Option(help="Probability of a false alarm, at most.")] = 0.05,
    max_rollouts: Annotated[
        int | None,
        typer.Option(help="Most rollouts of the policy.", show_default="one a scene; stochastic: five"),
    ] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML, a test case a scene.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Check whether a policy got worse: exit code 1 if it did.

    The policy runs in the failing scenes of a corpus and, as controls, their counterparts and nominal scenes.
    All scenes are paired with the baseline's; a sequential test decides, and ends as soon as it can.
    """
    _check(policy, baseline, alpha, max_rollouts, junit)
    from vlafuzz.regression.folder import read_corpus
    from vlafuzz.regression.junit import write_junit
    from vlafuzz.regression.policies import compare_policies
    from vlafuzz.regression.tables import document

    exported = read_corpus(corpus)
    with Bar() as bar:
        compared = compare_policies(
            corpus, exported, policy, baseline, alpha=alpha, max_rollouts=max_rollouts, watch=bar
        )
    if junit:
        write_junit(compared, junit)
        Bar.note(f"written: {junit}")
    if json:
        print_json(document(compared, exported))
    else:
        _print(compared, exported)
    if compared.alarm:
        raise typer.Exit(1)
    if not compared.tells:
        details = (scene.detail for scene in compared.compared if scene.standing in ("error", "invalid"))
        broken = next(details, "")
        raise PrerequisiteError(f"{compared.verdict}: {broken}", hint="`vlafuzz doctor` checks this machine")


def _check(
    policy: str, baseline: str | None, alpha: float, max_rollouts: int | None, junit: Path | None
) -> None:
    """Check the flags before anything is run."""
    from vlafuzz.policies.registry import check_policy_name

    if not 0 < alpha < 1:
        raise UsageError(f"--alpha: expected a probability above 0 and below 1, got {alpha:g}", hint="0.05")
    check_number("--max-rollouts", max_rollouts, 1)
    if junit is not None and (junit.is_dir() or not junit.absolute().parent.is_dir()):
        message = f"--junit: {junit}: no place for a file"
        raise UsageError(message, hint="name a file in a folder that is there")
    for name in filter(None, (policy, baseline)):
        check_policy_name(name)


def _print(compared: Comparison, corpus: Corpus) -> None:
    from vlafuzz.regression.tables import tables

    for title, rows in tables(compared, corpus).items():
        print_rows(rows, title=title)
    stopped = f"stopped after {compared.tried} pairs: " if compared.stopped in ("worse", "hopeless") else ""
    stdout().print(f"{stopped}{compared.verdict}", soft_wrap=True)
