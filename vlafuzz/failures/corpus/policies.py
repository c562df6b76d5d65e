"""Policies compared with a baseline in the scenes of a corpus; the baseline is rolled out only if needed."""

from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path

from vlafuzz.common.deadline import Deadline
from vlafuzz.common.plugins import check_trusted
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import PrerequisiteError, StoreError, UsageError
from vlafuzz.failures.corpus import diff, regress
from vlafuzz.failures.corpus.controls import MILDER
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.diff import Difference, Known
from vlafuzz.failures.corpus.pairs import Probe, probes
from vlafuzz.failures.corpus.regress import Comparison, Recorded, Rerun, Side, rollouts_of
from vlafuzz.failures.corpus.sign_test import power_of
from vlafuzz.model.conditions import Model
from vlafuzz.rollouts import scene_runner
from vlafuzz.store.records import Manifest
from vlafuzz.worlds import no_pictures


def compare_policies(
    folder: Path,
    corpus: Corpus,
    policy: str,
    baseline: str | None = None,
    *,
    label: str = "",
    alpha: float = 0.05,
    nights: int = 1,
    max_rollouts: int | None = None,
    whole: bool = False,
    deadline: Deadline | None = None,
    watch: Watch = SILENT,
) -> Comparison:
    """Compare a policy with a baseline, scene by scene; see ``regress.compare``.

    Without a ``baseline``, these are the recorded outcomes of the corpus's own policy.

    Args:
        folder: of the corpus, for messages.
        label: which model the policy is.
        alpha: bound on the probability of a false alarm in as many ``nights``, each of which has a comparison in the
            controls of this corpus.
    """
    scenes = _probes(folder, corpus)
    model, alpha = Model(policy, label), alpha / nights
    _check_baseline(baseline, model)
    _check_power(corpus, scenes[:max_rollouts], baseline, alpha, watch)
    most = rollouts_of(scenes, max_rollouts)

    with ExitStack() as stack:
        new = stack.enter_context(closing(_rerun(folder, corpus, model, watch)))
        old = _baseline(folder, corpus, baseline, stack, watch)
        controls = sum(probe.group == "control" for probe in scenes)
        watch.note(
            f"{controls} controls and {len(scenes) - controls} other scenes, "
            f"at most {most if baseline is None else 2 * most} rollouts"
        )
        return regress.compare(
            scenes, new, old, alpha=alpha, max_rollouts=max_rollouts, whole=whole, deadline=deadline, watch=watch
        )


def diff_policies(
    a: Path,
    b: Path,
    policy_a: str | None = None,
    policy_b: str | None = None,
    *,
    label_a: str = "",
    label_b: str = "",
    run_a: int | None = None,
    run_b: int | None = None,
    alpha: float = 0.05,
    watch: Watch = SILENT,
) -> Difference:
    """Compare two policies by the certified causes of two stores or corpora; see ``diff.diff``.

    Args:
        policy_a: name of the policy of ``a`` now; None for that in ``a``; ``policy_b`` likewise.
        label_a: which model that is, or which of the models in ``a``; ``label_b`` likewise.

    Raises:
        UsageError: both are the same model, at one address, on different tasks, or one has several.
        StoreError: none of them has a certified cause.
    """
    first, second = diff.known(a, run_a, label_a), diff.known(b, run_b, label_b)
    if not (first.causes or second.causes):
        raise StoreError(f"{a} and {b}: neither has a certified cause", hint="`vlafuzz triage` certifies some")
    one, other = _two_models(first, second, policy_a, policy_b)
    rollouts = sum(2 * sum(tested.repeats) for tested in (first, second))
    watch.note(f"{len(first.causes)} and {len(second.causes)} certified failures, {rollouts} rollouts")

    with ExitStack() as stack:

        def side(model: Model, tested: Known) -> Side:
            make = partial(scene_runner.SimulatorSceneRunner, tested.source, policy=model.policy)
            return stack.enter_context(closing(Rerun(model.short, tested.runs, make)))

        in_a, in_b = ((side(one, tested), side(other, tested)) for tested in (first, second))
        return diff.diff(first, second, in_a, in_b, alpha=alpha, watch=watch)


def _two_models(first: Known, second: Known, policy_a: str | None, policy_b: str | None) -> tuple[Model, Model]:
    """The models of ``diff_policies`` under their names of now, once they are found to be comparable."""
    one = replace(first.model, policy=policy_a or first.model.policy)
    other = replace(second.model, policy=policy_b or second.model.policy)
    if one == other:
        hint = "name another one: --policy-a, --policy-b; or --label-a, --label-b for models at one address"
        raise UsageError(f"{first.source} and {second.source} are both of the policy {one}", hint=hint)
    if one.replaces(other):
        problem = f"{one.which or one} and {other.which or other} cannot both answer at {one.address}"
        raise UsageError(problem, hint="serve one of them elsewhere: --policy-a or --policy-b names it there")
    if first.runs[0].task != second.runs[0].task:
        problem = f"of different tasks, {first.runs[0].task} and {second.runs[0].task}"
        raise UsageError(f"{first.source} and {second.source} are {problem}", hint="give stores of one task")
    for model, own in ((one, policy_a), (other, policy_b)):
        if own is None:
            check_trusted(model.policy)
    return one, other


def _check_baseline(name: str | None, model: Model) -> None:
    """Raise a UsageError if a baseline would have to answer where another model does."""
    if name and (baseline := Model(name)).replaces(model):
        problem = f"--baseline {baseline} cannot answer where {model.which} does"
        raise UsageError(problem, hint="leave it out for the outcomes that a corpus with controls records")


def still(folder: Path, corpus: Corpus, compared: Comparison, policy: str) -> bytes | None:
    """JPEG of the first scene in which only the policy failed; None without one, or where nothing renders."""
    worse = (scene.probe for scene in compared.compared if any(pair.worse for pair in scene.pairs))
    probe = next(worse, None)
    if probe is None or no_pictures(probe.scene.task):
        return None
    with closing(scene_runner.SimulatorSceneRunner(folder, corpus.runs[probe.run], policy)) as runner:
        film = runner.film(probe.scene)
    return film.still if film else None


def _probes(folder: Path, corpus: Corpus) -> list[Probe]:
    """The scenes of a corpus, controls first; a UsageError if it has none of these."""
    if not corpus.controls:
        message = f"{folder}: has no controls, scenes that no outcome selected"
        raise UsageError(message, hint="`vlafuzz export STORE --minimal` writes corpora with controls")
    return probes(corpus)


def _check_power(corpus: Corpus, scenes: Sequence[Probe], baseline: str | None, alpha: float, watch: Watch) -> None:
    """Say what loss could be noticed.

    Raises:
        PrerequisiteError: no alarm is possible.
    """
    power = power_of([probe.passed for probe in scenes if probe.group == "control"], alpha)
    if baseline:
        watch.note(f"if {baseline} passes where {corpus.policy} did: {power}")
    elif power.possible:
        watch.note(str(power))
    elif len(scenes) < len(corpus.controls):
        hint = f"a higher --max-rollouts: the corpus has {len(corpus.controls)} controls"
        raise PrerequisiteError(str(power), hint=hint)
    else:
        raise PrerequisiteError(str(power), hint=f"export a corpus with more passing controls: {MILDER}")


def _baseline(folder: Path, corpus: Corpus, name: str | None, stack: ExitStack, watch: Watch) -> Side:
    """A policy that is rolled out, or the recorded outcomes of the corpus's own."""
    if name is None:
        return Recorded(f"{corpus.tested.short} as recorded")
    return stack.enter_context(closing(_rerun(folder, corpus, Model(name), watch)))


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
