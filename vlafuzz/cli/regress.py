"""``vlafuzz regress``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.cli.output import Bar, print_json, print_rows, stdout
from vlafuzz.errors import PrerequisiteError, UsageError, check_number
from vlafuzz.text import Row, count_of

if TYPE_CHECKING:
    from vlafuzz.regression.corpus import Corpus
    from vlafuzz.regression.pairs import Compared, Group, Tally
    from vlafuzz.regression.regress import Comparison

_GROUPS: dict[Group, str] = {
    "failing": "failing scenes",
    "counterpart": "counterparts",
    "nominal": "nominal scenes",
}
_STANDINGS = {
    "better": "solved: only the policy passes",
    "worse": "broken: only the baseline passes",
    "passes": "both pass",
    "fails": "both fail",
    "error": "errors: a policy or the simulator broke",
    "invalid": "invalid: no longer fair",
    "not run": "not run",
}


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
    """Say whether a policy got worse: exit code 1 when it did.

    It is shown the failing scenes of a corpus and, as controls, their counterparts and nominal scenes. All
    scenes are paired with the baseline's; a sequential test decides, and ends as soon as it can.
    """
    _check(policy, baseline, alpha, max_rollouts, junit)
    from vlafuzz.regression.folder import read_corpus
    from vlafuzz.regression.junit import write_junit
    from vlafuzz.regression.policies import compare_policies

    exported = read_corpus(corpus)
    with Bar() as bar:
        compared = compare_policies(
            corpus, exported, policy, baseline, alpha=alpha, max_rollouts=max_rollouts, watch=bar
        )
    if junit:
        write_junit(compared, junit)
        Bar.note(f"written: {junit}")
    if json:
        print_json(_as_json(compared, exported))
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
        raise UsageError(
            f"--junit: {junit}: no place for a file", hint="name a file in a folder that is there"
        )
    for name in filter(None, (policy, baseline)):
        check_policy_name(name)


def _print(compared: Comparison, corpus: Corpus) -> None:
    rows = [_row(name, compared.tally(group), len(compared.of(group))) for group, name in _GROUPS.items()]
    print_rows([*rows, _row("all", compared.total, len(compared.compared))], title=corpus.name)
    standings = [
        {"scenes": title} | {name: _count(compared.of(group), standing) for group, name in _GROUPS.items()}
        for standing, title in _STANDINGS.items()
    ]
    print_rows(standings, title="how the policy stands")
    worse = [scene for scene in compared.compared if scene.standing == "worse"]
    if worse:
        print_rows([_scene(scene) for scene in worse], title="got worse")
    stopped = f"stopped after {compared.tried} pairs: " if compared.stopped in ("worse", "hopeless") else ""
    stdout().print(f"{stopped}{compared.verdict}", soft_wrap=True)


def _row(group: str, tally: Tally, scenes: int) -> Row:
    return {
        "group": group,
        "scenes": scenes,
        "baseline passed": count_of(**asdict(tally.baseline)),
        "policy passed": count_of(**asdict(tally.policy)),
        "worse": tally.worse,
        "better": tally.better,
    }


def _count(scenes: list[Compared], standing: str) -> int:
    return sum(scene.standing == standing for scene in scenes)


def _scene(scene: Compared) -> Row:
    judged = len(scene.judged)
    return {
        "scene": scene.probe.scene.digest,
        "group": scene.probe.group,
        "what": scene.probe.what,
        "baseline passed": f"{scene.baseline_passed} of {judged}",
        "policy passed": f"{scene.policy_passed} of {judged}",
        "why": scene.detail,
    }


def _as_json(compared: Comparison, corpus: Corpus) -> dict[str, Any]:
    total = compared.total
    names = ("policy", "baseline", "alarm", "verdict", "alpha", "p_value", "needed", "stopped")
    return {
        "corpus": corpus.name,
        **{name: getattr(compared, name) for name in names},
        "pairs": compared.tried,
        "judged": total.baseline.of,
        "groups": {group: _group(compared, group) for group in _GROUPS},
        "total": asdict(total),
        "scenes": [_scene(scene) | {"standing": scene.standing} for scene in compared.compared],
    }


def _group(compared: Comparison, group: Group) -> dict[str, Any]:
    scenes = compared.of(group)
    standings = {name: _count(scenes, name) for name in _STANDINGS}
    return {"scenes": len(scenes), **asdict(compared.tally(group)), "standings": standings}
