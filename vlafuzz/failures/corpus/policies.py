"""Policies compared with a baseline in the scenes of a corpus; the baseline is rolled out only if needed."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from vlafuzz.common.deadline import Deadline
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.failures.corpus import regress
from vlafuzz.failures.corpus.bisect import Bisection
from vlafuzz.failures.corpus.controls import MILDER
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.failures.corpus.pairs import Probe, probes
from vlafuzz.failures.corpus.regress import REPEATS, Comparison, Recorded, Rerun, Side
from vlafuzz.failures.corpus.sign_test import power_of
from vlafuzz.model import Model
from vlafuzz.rollouts import scene_runner
from vlafuzz.store.records import Manifest


def compare_policies(
    folder: Path | str,
    policy: str,
    baseline: str | None = None,
    *,
    label: str = "",
    alpha: float = 0.05,
    nights: int = 1,
    whole: bool = False,
    deadline: Deadline | None = None,
    watch: Watch = SILENT,
) -> Comparison:
    """Compare a policy with a baseline, scene by scene; see ``regress.compare``.

    Without a ``baseline``, these are the recorded outcomes of the corpus's own policy.

    Args:
        folder: of the corpus.
        label: which model the policy is.
        alpha: bound on the probability of a false alarm in as many ``nights``, each of which has a comparison in the
            controls of this corpus.

    Raises:
        UsageError: the corpus has no controls, or the baseline would have to answer where the policy does.
        PrerequisiteError: no alarm is possible.
    """
    corpus, model, alpha = read_corpus(folder := Path(folder)), Model(policy, label), alpha / nights
    scenes = probes(corpus)
    controls = sum(probe.group == "control" for probe in scenes)
    most = controls + REPEATS * (len(scenes) - controls)
    with _baseline(folder, corpus, baseline, watch, model) as old:
        _check_power(corpus, scenes, baseline, alpha, watch)
        watch.note(
            f"{controls} controls and {len(scenes) - controls} other scenes, "
            f"at most {most if baseline is None else 2 * most} rollouts"
        )
        with closing(_rerun(folder, corpus, model, watch)) as new:
            compared = regress.compare(scenes, new, old, alpha=alpha, whole=whole, deadline=deadline, watch=watch)
    return replace(compared, corpus=corpus.name)


def bisect_checkpoints(
    folder: Path | str, checkpoints: Sequence[str], baseline: str | None = None, *, watch: Watch = SILENT, **given: Any
) -> Bisection:
    """Find out which of several policies, in the order of their training, broke first.

    Args:
        baseline: what the corpus recorded, unless one is named.
        given: ``alpha``, ``error``, ``comparisons`` and ``deadline`` of ``Bisection``.

    Raises:
        UsageError: as in ``compare_policies``, or there are fewer than two checkpoints, or one twice.
        PrerequisiteError: no alarm is possible, or rollouts of a checkpoint cannot be judged.
    """
    corpus = read_corpus(folder := Path(folder))
    controls = [probe for probe in probes(corpus) if probe.group == "control"]

    def opened(name: str) -> AbstractContextManager[Side]:
        # The last one is opened first; the others' notes are the same.
        return closing(_rerun(folder, corpus, Model(name), watch if name == checkpoints[-1] else SILENT))

    with _baseline(folder, corpus, baseline, watch, *map(Model, checkpoints)) as old:
        bisection = Bisection(controls, checkpoints, opened, old, watch=watch, **given)
        _check_power(corpus, controls, baseline, bisection.alpha, watch)
        return bisection.search()


def _baseline(
    folder: Path, corpus: Corpus, name: str | None, watch: Watch, *new: Model
) -> AbstractContextManager[Side]:
    """The policy of that name, or what the corpus recorded; a UsageError if new ones cannot be compared with it."""
    if not corpus.controls:
        message = f"{folder}: has no controls, scenes that no outcome selected"
        raise UsageError(message, hint="`vlafuzz export STORE --minimal` writes corpora with controls")
    if name is None:
        return nullcontext(Recorded(f"{corpus.tested.short} as recorded"))
    for model in new:
        if Model(name).replaces(model):
            problem = f"--baseline {name} cannot answer where {model.which} does"
            raise UsageError(problem, hint="leave it out for the outcomes that a corpus with controls records")
    return closing(_rerun(folder, corpus, Model(name), watch))


def _check_power(corpus: Corpus, scenes: Sequence[Probe], baseline: str | None, alpha: float, watch: Watch) -> None:
    """Say what loss could be noticed; a PrerequisiteError if no alarm is possible."""
    power = power_of([probe.passed for probe in scenes if probe.group == "control"], alpha)
    if baseline:
        watch.note(f"if {baseline} passes where {corpus.policy} did: {power}")
    elif power.possible:
        watch.note(str(power))
    else:
        raise PrerequisiteError(str(power), hint=f"export a corpus with more passing controls: {MILDER}")


def _rerun(folder: Path, corpus: Corpus, model: Model, watch: Watch) -> Rerun:
    """A policy that is rolled out; notes conditions that differ from those of the corpus."""
    changed: dict[str, None] = {}
    places: dict[str, None] = {}

    def make(run: Manifest) -> scene_runner.SimulatorSceneRunner:
        runner = scene_runner.SimulatorSceneRunner(folder, run, model.policy)
        # A corpus is always older than the commit, and another policy has another spec.
        same = model in (run.tested, Model(run.policy))
        expected = {"commit"} | (set() if same else {"spec", "source"})
        changed.update(dict.fromkeys(name for name in runner.changed if name not in expected))
        if not run.place and runner.renderer is not None and corpus.renderer not in (None, runner.renderer):
            changed["renderer"] = None
        if runner.elsewhere:
            places[runner.elsewhere] = None
        return runner

    rerun = Rerun(model.short, corpus.runs, make)
    here = "" if model.replaces(corpus.tested) else f"; `--baseline {corpus.policy}` runs both"
    if changed:
        differ = f"its {', '.join(changed)} differ{here and f'{here} under the same'}"
        watch.note(f"note: {model.short} runs under other conditions than the corpus: {differ}")
    for elsewhere in places:
        watch.note(f"note: the corpus was made {elsewhere}{here and f'{here} here'}")
    return rerun
