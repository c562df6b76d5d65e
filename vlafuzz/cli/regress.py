"""``vlafuzz regress``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import AlphaFlag, LabelFlag, TimeFlag, TrustFlag
from vlafuzz.cli.output import Bar, print_json, print_rows, stdout
from vlafuzz.common.deadline import deadline
from vlafuzz.errors import PrerequisiteError, UsageError, check_number, check_probability

if TYPE_CHECKING:
    from vlafuzz.failures.corpus.corpus import Corpus
    from vlafuzz.failures.corpus.regress import Comparison


def command(
    corpus: Annotated[Path, typer.Argument(help="A folder that `vlafuzz export --minimal` wrote.")],
    policy: Annotated[str, typer.Option(help="The policy under test, or python:pkg.mod:factory.")],
    label: LabelFlag = None,
    baseline: Annotated[
        str | None, typer.Option(help="Roll out this policy, too.", show_default="what the corpus recorded of its own")
    ] = None,
    alpha: AlphaFlag = 0.05,
    nights: Annotated[
        int, typer.Option(help="Comparisons with this corpus, such as one a night, that share --alpha.")
    ] = 1,
    max_rollouts: Annotated[
        int | None,
        typer.Option(
            help="Most rollouts of the policy, controls first.", show_default="one a control, three in each other scene"
        ),
    ] = None,
    whole: Annotated[bool, typer.Option("--whole", help="Do not stop at an alarm: run everything.")] = False,
    time: TimeFlag = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML.")] = None,
    summary: Annotated[
        Path | None, typer.Option(help="Write Markdown, and beside it a picture of a broken scene.")
    ] = None,
    sarif: Annotated[Path | None, typer.Option(help="Write SARIF.")] = None,
    trust: TrustFlag = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Check whether a policy got worse: exit code 1 if it fails more often than the baseline.

    Both are compared in the controls of a corpus, random scenes that no outcome selected; a sequential test decides,
    and ends at an alarm. Then the failing scenes, their counterparts and the nominal scenes are run, jittered, to show
    what is fixed and what is broken. They raise no alarm: they were selected by what the corpus's own policy does.
    """
    places = {"--junit": junit, "--summary": summary, "--sarif": sarif}
    _check(policy, baseline, places)
    check_probability("--alpha", alpha)
    check_number("--nights", nights, 1)
    check_number("--max-rollouts", max_rollouts, 1)
    until = deadline("--time", time)
    from vlafuzz.failures.corpus.ci import write_junit, write_sarif, write_summary
    from vlafuzz.failures.corpus.folder import read_corpus
    from vlafuzz.failures.corpus.policies import compare_policies, still
    from vlafuzz.failures.corpus.tables import document

    exported = read_corpus(corpus)
    with Bar() as bar:
        compared = compare_policies(
            corpus,
            exported,
            policy,
            baseline,
            label=label or "",
            alpha=alpha,
            nights=nights,
            max_rollouts=max_rollouts,
            whole=whole,
            deadline=until,
            watch=bar,
        )
    if json:
        print_json(document(compared, exported))
    else:
        _print(compared, exported)
    # Last: where one cannot be written, the result of hours is shown all the same.
    if junit:
        write_junit(compared, junit)
    if summary:
        write_summary(compared, exported, summary, still(corpus, exported, compared, policy))
    if sarif:
        write_sarif(compared, exported, corpus, sarif)
    for path in filter(None, places.values()):
        Bar.note(f"written: {path}")
    if compared.alarm:
        raise typer.Exit(1)
    if not compared.tells:
        details = (scene.detail for scene in compared.compared if scene.standing in ("error", "invalid"))
        broken = next((f": {detail}" for detail in details if detail), "")
        more = "more --max-rollouts" if compared.stopped != "time" else "more --time"
        hint = f"`vlafuzz doctor` checks this machine; were the rollouts too few, give {more}"
        raise PrerequisiteError(compared.verdict + broken, hint=hint)


def _check(policy: str, baseline: str | None, places: Mapping[str, Path | None]) -> None:
    """Check the flags before anything is run."""
    from vlafuzz.rollouts.policies import check_policy_name

    for flag, path in places.items():
        if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
            message = f"{flag}: {path}: no place for a file"
            raise UsageError(message, hint="name a file in a folder that is there")
    for name in filter(None, (policy, baseline)):
        check_policy_name(name)


def _print(compared: Comparison, corpus: Corpus) -> None:
    from vlafuzz.failures.corpus.tables import difference, tables

    for title, rows in tables(compared, corpus).items():
        print_rows(rows, title=title)
    if between := difference(compared):
        stdout().print(between, soft_wrap=True)
    if compared.changes:
        stdout().print(compared.changes, soft_wrap=True)
    early = {"worse": "stopped", "time": "--time is over"}.get(compared.stopped)
    stopped = f"{early} after {compared.tried} controls: " if early else ""
    stdout().print(f"{stopped}{compared.verdict}", soft_wrap=True)
