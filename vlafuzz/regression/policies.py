"""Policies compared with a baseline in the scenes of a corpus; the baseline is rolled out only if needed."""

from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path

from vlafuzz.conditions.stored import stored_space
from vlafuzz.plugins import check_trusted
from vlafuzz.regression import bisect, regress
from vlafuzz.regression.bisect import Bisection
from vlafuzz.regression.controls import CONTROLS, draw
from vlafuzz.regression.corpus import Corpus
from vlafuzz.regression.pairs import Probe, probes
from vlafuzz.regression.regress import Comparison, Recorded, Rerun, Side
from vlafuzz.renderer import probe_once
from vlafuzz.store.records import Manifest
from vlafuzz.triage import scene_runner
from vlafuzz.watch import SILENT, Watch


def compare_policies(
    folder: Path,
    corpus: Corpus,
    policy: str,
    baseline: str | None = None,
    *,
    alpha: float = 0.05,
    max_rollouts: int | None = None,
    whole: bool = False,
    watch: Watch = SILENT,
) -> Comparison:
    """Compare a policy with a baseline, scene by scene; see ``regress.compare``.

    Without a ``baseline``, these are the recorded outcomes of the corpus's own policy. For a corpus without
    controls some are drawn, and that policy is rolled out, too. ``folder`` is the corpus's, for messages.
    """

    def progress(now: regress.Progress) -> None:
        watch.progress(f"rollouts, {now.worse} worse, {now.better} better", now.done, now.most)

    scenes, baseline = _scenes(folder, corpus, baseline, watch)
    with ExitStack() as stack:
        new = stack.enter_context(closing(_rerun(folder, corpus, policy, watch)))
        old = _baseline(folder, corpus, baseline, stack, watch)
        watch.note(_estimate(corpus, scenes, old, max_rollouts))
        return regress.compare(
            scenes, new, old, alpha=alpha, max_rollouts=max_rollouts, whole=whole, watch=progress
        )


def bisect_checkpoints(
    folder: Path,
    corpus: Corpus,
    checkpoints: Sequence[str],
    baseline: str | None = None,
    *,
    alpha: float = 0.05,
    error: float = 0.05,
    comparisons: int | None = None,
    watch: Watch = SILENT,
) -> Bisection:
    """Find out which of several policies, in the order of their training, broke; see ``bisect.bisect``.

    Without a ``baseline``, it is the recorded outcomes of the corpus's own policy. Only one checkpoint is
    open at a time.
    """
    scenes, baseline = _scenes(folder, corpus, baseline, watch)
    controls = [probe for probe in scenes if probe.group == "control"]
    with ExitStack() as stack:
        return bisect.bisect(
            controls,
            checkpoints,
            lambda name: closing(_rerun(folder, corpus, name, watch)),
            _baseline(folder, corpus, baseline, stack, watch),
            alpha=alpha,
            error=error,
            comparisons=comparisons,
            watch=lambda checkpoint, done, most: watch.progress(f"rollouts of {checkpoint}", done, most),
        )


def still(folder: Path, corpus: Corpus, compared: Comparison, policy: str) -> bytes | None:
    """JPEG of the first scene in which only the policy failed; None without one, or where nothing renders."""
    worse = (scene.probe for scene in compared.compared if any(pair.worse for pair in scene.pairs))
    probe = next(worse, None)
    if probe is None or not probe_once().works:
        return None
    with closing(scene_runner.SimulatorSceneRunner(folder, corpus.runs[probe.run], policy)) as runner:
        film = runner.film(probe.scene)
    return film.still if film else None


def _scenes(
    folder: Path, corpus: Corpus, baseline: str | None, watch: Watch
) -> tuple[list[Probe], str | None]:
    """The scenes, controls first, and the name of the baseline; None where its outcomes are recorded."""
    scenes = probes(corpus)
    if corpus.controls:
        return scenes, baseline
    if baseline is None:
        check_trusted(corpus.policy)
    baseline = baseline or corpus.policy
    watch.note(
        f"note: the corpus has no controls; {CONTROLS} are drawn, and {baseline} is rolled out, too; "
        "`vlafuzz export` writes corpora with controls"
    )
    return [*_controls(folder, corpus.runs[0]), *scenes], baseline


def _baseline(folder: Path, corpus: Corpus, name: str | None, stack: ExitStack, watch: Watch) -> Side:
    """A policy that is rolled out, or the recorded outcomes of the corpus's own."""
    if name is None:
        return Recorded(f"{corpus.policy} as recorded")
    return stack.enter_context(closing(_rerun(folder, corpus, name, watch)))


def _controls(folder: Path, run: Manifest) -> list[Probe]:
    """Controls without recorded outcomes."""
    space = stored_space(folder, run)
    scenes = [draw(space, run.seed, number) for number in range(CONTROLS)]
    return [Probe(scene, "control", "random", 0, passed=None) for scene in scenes]


def _rerun(folder: Path, corpus: Corpus, policy: str, watch: Watch) -> Rerun:
    """A policy that is rolled out; notes conditions that differ from those of the corpus."""
    changed: dict[str, None] = {}
    places: dict[str, None] = {}

    def make(run: Manifest) -> scene_runner.SimulatorSceneRunner:
        runner = scene_runner.SimulatorSceneRunner(folder, run, policy)
        # A corpus is always older than the commit, and another policy has another spec.
        expected = {"commit"} | ({"spec", "source"} if policy != run.policy else set())
        changed.update(dict.fromkeys(name for name in runner.changed if name not in expected))
        if not run.place and runner.renderer is not None and corpus.renderer not in (None, runner.renderer):
            changed["renderer"] = None
        if runner.elsewhere:
            places[runner.elsewhere] = None
        return runner

    rerun = Rerun(policy, corpus.runs, make)
    if changed:
        watch.note(
            f"note: {policy} runs under other conditions than the corpus: its {', '.join(changed)} differ; "
            f"`--baseline {corpus.policy}` runs both under the same"
        )
    for elsewhere in places:
        watch.note(f"note: the corpus was made {elsewhere}; `--baseline {corpus.policy}` runs both here")
    return rerun


def _estimate(corpus: Corpus, scenes: Sequence[Probe], old: Side, most: int | None) -> str:
    """A forecast at the speed of the corpus's own rollouts."""
    sides = 1 if isinstance(old, Recorded) else 2
    rollouts = sides * regress.most_rollouts(scenes, most)
    evidence = corpus.evidence
    known = evidence.triage_rollouts + evidence.expert_rollouts
    took = f", about {rollouts * evidence.seconds / known:.0f} s at the corpus's own speed" if known else ""
    controls = sum(probe.group == "control" for probe in scenes)
    return f"{controls} controls and {len(scenes) - controls} other scenes, at most {rollouts} rollouts{took}"
