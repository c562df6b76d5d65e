"""``vlafuzz regress``."""

from __future__ import annotations

from contextlib import ExitStack, closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.cli.output import print_json, print_rows, progress, stderr, stdout
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.text import Row

if TYPE_CHECKING:
    from vlafuzz.regression.corpus import Corpus, Share
    from vlafuzz.regression.pairs import Compared, Group, Probe, Tally
    from vlafuzz.regression.regress import Comparison, Rerun, Side
    from vlafuzz.store.records import Manifest
    from vlafuzz.triage.scene_runner import SimulatorSceneRunner

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

    exported = read_corpus(corpus)
    found = _compare(corpus, exported, policy, baseline, alpha, max_rollouts)
    if junit:
        write_junit(found, junit)
        stderr().print(f"written: {junit}", soft_wrap=True)
    if json:
        print_json(_as_json(found, exported))
    else:
        _print(found, exported)
    if found.alarm:
        raise typer.Exit(1)
    if not found.tells:
        broken = next((each.detail for each in found.compared if each.standing in ("error", "invalid")), "")
        raise PrerequisiteError(f"{found.verdict}: {broken}", hint="`vlafuzz doctor` checks this machine")


def _check(
    policy: str, baseline: str | None, alpha: float, max_rollouts: int | None, junit: Path | None
) -> None:
    """What can be known to be wrong before anything is run."""
    from vlafuzz.policies.registry import check_policy_name

    if not 0 < alpha < 1:
        raise UsageError(f"--alpha: expected a probability above 0 and below 1, got {alpha:g}", hint="0.05")
    if max_rollouts is not None and max_rollouts < 1:
        raise UsageError(
            f"--max-rollouts: expected at least 1, got {max_rollouts}", hint="give --max-rollouts 1 or more"
        )
    if junit is not None and (junit.is_dir() or not junit.absolute().parent.is_dir()):
        raise UsageError(
            f"--junit: {junit}: no place for a file", hint="name a file in a folder that is there"
        )
    for name in filter(None, (policy, baseline)):
        check_policy_name(name)


def _compare(
    folder: Path, corpus: Corpus, policy: str, baseline: str | None, alpha: float, max_rollouts: int | None
) -> Comparison:
    """Do it, with a bar."""
    from vlafuzz.regression import regress
    from vlafuzz.regression.pairs import probes

    asked = probes(corpus)
    with ExitStack() as stack, progress() as bar:
        task = bar.add_task("scenes", total=None)

        def watch(now: regress.Progress) -> None:
            said = f"rollouts, {now.worse} worse, {now.better} better"
            bar.update(task, completed=now.done, total=now.most, description=said)

        new = stack.enter_context(closing(_rerun(folder, corpus, policy)))
        if baseline is None and not (new.deterministic and regress.records_hold(corpus)):
            baseline = corpus.policy
            _note(
                "a stochastic policy cannot be compared fairly with recorded outcomes, which were selected; "
                f"{baseline} rolls out beside it, as the baseline"
            )
        old: Side = regress.Recorded(f"{corpus.policy} as recorded")
        if baseline is not None:
            old = stack.enter_context(closing(_rerun(folder, corpus, baseline)))
        _estimate(corpus, asked, new, old, max_rollouts)
        return regress.compare(asked, new, old, alpha=alpha, max_rollouts=max_rollouts, watch=watch)


def _rerun(folder: Path, corpus: Corpus, policy: str) -> Rerun:
    """A policy that rolls out; says when the conditions are no longer those of the corpus."""
    from vlafuzz.regression.regress import Rerun
    from vlafuzz.triage import scene_runner as runner

    changed: dict[str, None] = {}

    def make(run: Manifest) -> SimulatorSceneRunner:
        made = runner.SimulatorSceneRunner(folder, run, policy)
        # That a corpus is older than this commit is no news, nor that another policy's spec is another.
        known = {"commit"} | ({"spec", "source"} if policy != run.policy else set())
        changed.update(dict.fromkeys(name for name in made.changed if name not in known))
        if made.renderer is not None and corpus.renderer not in (None, made.renderer):
            changed["renderer"] = None
        return made

    made = Rerun(policy, corpus.runs, make)
    if changed:
        hint = f"`--baseline {corpus.policy}` runs both under the same"
        _note(
            f"{policy} runs under other conditions than the corpus: its {', '.join(changed)} differ; {hint}"
        )
    return made


def _note(text: str) -> None:
    stderr().print(f"note: {text}", soft_wrap=True)


def _estimate(corpus: Corpus, asked: list[Probe], new: Side, old: Side, most: int | None) -> None:
    """How long it may take, from what the corpus says of its own rollouts."""
    from vlafuzz.regression.regress import Recorded, most_rollouts

    sides = 1 if isinstance(old, Recorded) else 2
    rollouts = sides * most_rollouts(asked, new, old, most)
    evidence = corpus.evidence
    known = evidence.triage_rollouts + evidence.expert_rollouts
    took = f", about {rollouts * evidence.seconds / known:.0f} s at the corpus's own speed" if known else ""
    stderr().print(f"{len(asked)} scenes, at most {rollouts} rollouts{took}", soft_wrap=True)


def _print(found: Comparison, corpus: Corpus) -> None:
    rows = [_row(said, found.tally(group), len(found.of(group))) for group, said in _GROUPS.items()]
    print_rows([*rows, _row("all", found.total, len(found.compared))], title=corpus.name)
    standings = [
        {"scenes": said} | {name: _count(found.of(group), standing) for group, name in _GROUPS.items()}
        for standing, said in _STANDINGS.items()
    ]
    print_rows(standings, title="how the policy stands")
    worse = [each for each in found.compared if each.standing == "worse"]
    if worse:
        print_rows([_scene(each) for each in worse], title="got worse")
    stopped = f"stopped after {found.tried} pairs: " if found.stopped in ("worse", "hopeless") else ""
    stdout().print(f"{stopped}{found.verdict}", soft_wrap=True)


def _row(group: str, tally: Tally, scenes: int) -> Row:
    return {
        "group": group,
        "scenes": scenes,
        "baseline passed": _share(tally.baseline),
        "policy passed": _share(tally.policy),
        "worse": tally.worse,
        "better": tally.better,
    }


def _share(share: Share) -> str:
    interval = f" ({100 * share.low:.1f}–{100 * share.high:.1f} %)" if share.of else ""
    return f"{share.count} of {share.of}{interval}"


def _count(scenes: list[Compared], standing: str) -> int:
    return sum(each.standing == standing for each in scenes)


def _scene(each: Compared) -> Row:
    judged = len(each.judged)
    return {
        "scene": each.probe.scene.digest,
        "group": each.probe.group,
        "what": each.probe.what,
        "baseline passed": f"{each.baseline_passed} of {judged}",
        "policy passed": f"{each.policy_passed} of {judged}",
        "why": each.detail,
    }


def _as_json(found: Comparison, corpus: Corpus) -> dict[str, Any]:
    total = found.total
    names = ("policy", "baseline", "alarm", "verdict", "alpha", "p_value", "needed", "stopped")
    return {
        "corpus": corpus.name,
        **{name: getattr(found, name) for name in names},
        "pairs": found.tried,
        "judged": total.baseline.of,
        "groups": {group: _group(found, group) for group in _GROUPS},
        "total": asdict(total),
        "scenes": [_scene(each) | {"standing": each.standing} for each in found.compared],
    }


def _group(found: Comparison, group: Group) -> dict[str, Any]:
    scenes = found.of(group)
    standings = {name: _count(scenes, name) for name in _STANDINGS}
    return {"scenes": len(scenes), **asdict(found.tally(group)), "standings": standings}
