"""Policies compared with a baseline in the scenes of a corpus; the baseline is rolled out only if needed."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path

from vlafuzz.deadline import Deadline
from vlafuzz.errors import StoreError, UsageError
from vlafuzz.plugins import check_trusted
from vlafuzz.regression import bisect, diff, regress
from vlafuzz.regression.answers import Answers
from vlafuzz.regression.bisect import Bisection
from vlafuzz.regression.controls import CONTROLS, draw
from vlafuzz.regression.corpus import Corpus
from vlafuzz.regression.diff import Difference
from vlafuzz.regression.pace import Pace
from vlafuzz.regression.pairs import Probe, probes
from vlafuzz.regression.regress import Comparison, Recorded, Rerun, Side
from vlafuzz.renderer import probe_once
from vlafuzz.store.records import Manifest
from vlafuzz.triage import scene_runner
from vlafuzz.watch import SILENT, Watch
from vlafuzz.worlds import stored_space


def compare_policies(
    folder: Path,
    corpus: Corpus,
    policy: str,
    baseline: str | None = None,
    *,
    alpha: float = 0.05,
    max_rollouts: int | None = None,
    whole: bool = False,
    deadline: Deadline | None = None,
    watch: Watch = SILENT,
) -> Comparison:
    """Compare a policy with a baseline, scene by scene; see ``regress.compare``.

    Without a ``baseline``, these are the recorded outcomes of the corpus's own policy. For a corpus without
    controls some are drawn, and that policy is rolled out, too. ``folder`` is the corpus's, for messages.
    """
    scenes, baseline = _scenes(folder, corpus, baseline, watch)
    pace = Pace(watch.note, regress.most_rollouts(scenes, max_rollouts))

    def progress(now: regress.Progress) -> None:
        watch.progress(f"rollouts, {now.worse} worse, {now.better} better", now.done, now.most)
        pace.step()

    with ExitStack() as stack:
        new = stack.enter_context(closing(_rerun(folder, corpus, policy, watch)))
        old = _baseline(folder, corpus, baseline, stack, watch)
        watch.note(_most(scenes, old, max_rollouts))
        return regress.compare(
            scenes,
            new,
            old,
            alpha=alpha,
            max_rollouts=max_rollouts,
            whole=whole,
            deadline=deadline,
            watch=progress,
        )


def diff_policies(
    a: Path,
    b: Path,
    policy_a: str | None = None,
    policy_b: str | None = None,
    *,
    run_a: int | None = None,
    run_b: int | None = None,
    alpha: float = 0.05,
    watch: Watch = SILENT,
) -> Difference:
    """Compare two policies by the certified causes of two stores or corpora; see ``diff.diff``.

    Args:
        policy_a: name of the policy of ``a`` now; None for that in ``a``; ``policy_b`` likewise.

    Raises:
        UsageError: both are the same policy, on different tasks, or one has several.
        StoreError: none of them has a certified cause.
    """
    first, second = diff.known(a, run_a), diff.known(b, run_b)
    if not (first.causes or second.causes):
        raise StoreError(
            f"{a} and {b}: neither has a certified cause", hint="`vlafuzz triage` certifies some"
        )
    names = policy_a or first.policy, policy_b or second.policy
    if names[0] == names[1]:
        hint = "name another one: --policy-a, --policy-b"
        raise UsageError(f"{a} and {b} are both of the policy {names[0]}", hint=hint)
    if first.runs[0].task != second.runs[0].task:
        tasks = f"{first.runs[0].task} and {second.runs[0].task}"
        raise UsageError(f"{a} and {b} are of different tasks, {tasks}", hint="give stores of one task")
    for name, own in zip(names, (policy_a, policy_b), strict=True):
        if own is None:
            check_trusted(name)
    rollouts = sum(regress.most_rollouts(one.probes, None) for one in (first, second))
    watch.note(f"{len(first.causes)} and {len(second.causes)} certified failures, {rollouts} rollouts")
    with ExitStack() as stack:
        sides = [
            stack.enter_context(closing(Rerun(name, tested.runs, partial(_runner, tested.source, name))))
            for name, tested in zip(names, (second, first), strict=True)
        ]
        return diff.diff(
            first,
            second,
            *sides,
            alpha=alpha,
            watch=lambda done, most: watch.progress("rollouts where the other policy fails", done, most),
        )


def _runner(source: Path, policy: str, run: Manifest) -> scene_runner.SimulatorSceneRunner:
    return scene_runner.SimulatorSceneRunner(source, run, policy)


def bisect_checkpoints(
    folder: Path,
    corpus: Corpus,
    checkpoints: Sequence[str],
    baseline: str | None = None,
    *,
    alpha: float = 0.05,
    error: float = 0.05,
    comparisons: int | None = None,
    answers: Path | None = None,
    watch: Watch = SILENT,
) -> Bisection:
    """Find out which of several policies, in the order of their training, broke; see ``bisect.bisect``.

    Without a ``baseline``, it is the recorded outcomes of the corpus's own policy. Only one checkpoint is
    open at a time. ``answers`` is a file that keeps their outcomes by name, see ``Answers``.
    """
    bisect.check_checkpoints(checkpoints)
    scenes, baseline = _scenes(folder, corpus, baseline, watch)
    controls = [probe for probe in scenes if probe.group == "control"]
    known, most = Answers(answers), comparisons or bisect.most_comparisons(len(checkpoints))
    pace = Pace(watch.note, most * len(controls))
    watch.note(
        f"{len(checkpoints)} checkpoints: at most {most} comparisons of at most {len(controls)} rollouts each"
        f"{f'; {len(known)} outcomes are known already' if len(known) else ''}"
    )

    def progress(checkpoint: str, done: int, most: int) -> None:
        watch.progress(f"rollouts of {checkpoint}", done, most)
        pace.step()

    @contextmanager
    def opened(name: str) -> Iterator[Side]:
        noting = watch if name == checkpoints[-1] else SILENT  # the first one: the others' notes are the same
        with closing(_rerun(folder, corpus, name, noting)) as side:
            yield known.of(side)

    with ExitStack() as stack:
        return bisect.bisect(
            controls,
            checkpoints,
            opened,
            known.of(_baseline(folder, corpus, baseline, stack, watch)) if baseline else _recorded(corpus),
            alpha=alpha,
            error=error,
            comparisons=most,
            watch=progress,
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
        return _recorded(corpus)
    return stack.enter_context(closing(_rerun(folder, corpus, name, watch)))


def _recorded(corpus: Corpus) -> Recorded:
    return Recorded(f"{corpus.policy} as recorded")


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


def _most(scenes: Sequence[Probe], old: Side, most: int | None) -> str:
    """How many scenes and rollouts there are; the first of them tell how long that takes."""
    sides = 1 if isinstance(old, Recorded) else 2
    rollouts = sides * regress.most_rollouts(scenes, most)
    controls = sum(probe.group == "control" for probe in scenes)
    others = len(scenes) - controls
    return f"{controls} controls and {others} other scenes, at most {rollouts} rollouts"
