"""diff: what two policies fail at, by cause. Each is rolled out where the other is certified to fail.

A cause of the first policy is fixed if the second one mostly passes in its minimal scenes, else it remains. A
cause of the second policy is new if the first one mostly passes in its scenes.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from vlafuzz.errors import StoreError, UsageError
from vlafuzz.failures.corpus.folder import is_corpus, read_corpus
from vlafuzz.failures.corpus.pairs import Change, Compared, Probe
from vlafuzz.failures.corpus.pairs import probes as probes_of
from vlafuzz.failures.corpus.regress import Comparison, compare
from vlafuzz.failures.corpus.sides import Recorded, Side
from vlafuzz.model.label import Model
from vlafuzz.model.phrasing import titled
from vlafuzz.model.scene import Scene
from vlafuzz.store.records import Manifest
from vlafuzz.store.store import Store

Standing = Literal["fixed", "remaining", "new", "not judged"]
ORDER: tuple[Standing, ...] = ("new", "remaining", "fixed", "not judged")
Watch = Callable[[int, int], None]  # rollouts done, and all


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """The certified failures of one policy on one task.

    Attributes:
        source: store or corpus, for messages.
        model: whose failures they are.
        runs: that found them; ``Probe.run`` is an index.
        causes: signature and title of each failing scene.
        probes: the failing scenes and the passing ones beside them.
    """

    source: Path
    model: Model
    runs: Sequence[Manifest]
    causes: dict[Scene, tuple[str, str]]
    probes: Sequence[Probe]


@dataclass(frozen=True, kw_only=True)
class CauseChange:
    """A cause of one of the policies, after rollouts of the other.

    Attributes:
        signature: of a certified failure; ``title``: its operators in words.
        standing: ``remaining`` where the other policy fails, too.
        scenes: minimal ones with this signature; in ``passes`` of them the other policy mostly passes.
        scene: digest of the first one.
        detail: why the other policy fails there, or could not be judged.
    """

    signature: str
    title: str
    standing: Standing
    scenes: int
    passes: int
    scene: str
    detail: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Difference:
    """Two policies by their causes: those of the first one, then those that only the second one's store has.

    Attributes:
        fixed: test of the second policy in the first one's failing scenes; ``broken``: in the passing ones
            beside them.
        new: test of the first policy in the second one's failing scenes: whether some of these are new.
    """

    first: str
    second: str
    causes: tuple[CauseChange, ...]
    fixed: Change
    broken: Change
    new: Change

    def of(self, standing: Standing) -> list[CauseChange]:
        return [cause for cause in self.causes if cause.standing == standing]

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        counts = {standing: len(self.of(standing)) for standing in ORDER}
        unjudged = f", {counts['not judged']} not judged" if counts["not judged"] else ""
        fixed = f"{counts['fixed']} fixed ({self.fixed}), {counts['remaining']} remaining"
        new = f"{counts['new']} new ({self.new})"
        if not self.fixed.of:
            fixed = "none is certified"
        if not self.new.of:
            new = f"new ones unknown, as {self.second} has no certified cause"
        beside = f"{self.broken.changed} of {self.broken.of} passing scenes broken ({self.broken})"
        return f"causes of {self.first} in {self.second}: {fixed}, {new}{unjudged}; {beside}"


def known(source: Path, run: int | None = None, label: str = "") -> Known:
    """The certified failures in a store or corpus.

    Args:
        run: only those of this run.
        label: the model; only its failures, where the runs have labels.

    Raises:
        StoreError: it has no run.
        UsageError: it has several models or tasks, or none of that label.
    """
    if is_corpus(source):
        if run is not None:
            raise UsageError(f"run {run}: {source} is a corpus, not a store", hint="leave it out")
        corpus = read_corpus(source)
        causes = {case.scene: (case.signature, case.title) for case in corpus.cases}
        probes = [probe for probe in probes_of(corpus) if probe.group != "control"]
        model = _labelled(source, corpus.tested, label)
        return Known(source=source, model=model, runs=corpus.runs, causes=causes, probes=probes)
    with Store.open(source) as store:
        return _of_store(store, run, label)


def _labelled(source: Path, model: Model, label: str) -> Model:
    """The model with the label that the user gives it, if the runs have none."""
    if label and model.label not in ("", label):
        raise UsageError(f"{source} is of {model}, not of {label}", hint="leave the label out")
    return replace(model, label=label or model.label)


def _of_store(store: Store, run: int | None, label: str) -> Known:
    runs = {begun.id: begun.manifest for begun in store.runs()}
    of = {finding.key: finding.run for finding in store.findings(run)}
    numbers = sorted(set(of.values())) or [number for number in runs if run in (None, number)]
    if label in {runs[number].named for number in numbers}:
        numbers = [number for number in numbers if runs[number].named == label]
    causes: dict[Scene, tuple[str, str]] = {}
    beside: dict[Scene, Probe] = {}
    failing: dict[Scene, Probe] = {}
    for row in store.triaged():
        if of.get(row.key) not in numbers or row.bucket != "minimal" or not (row.shrunk and row.signature):
            continue
        number, title = numbers.index(of[row.key]), titled(row.operators, row.causes)
        causes.setdefault(row.shrunk, (row.signature, title))
        failing.setdefault(row.shrunk, Probe(row.shrunk, "failing", title, number, passed=False))
        for operator, scene in row.counterparts.items():
            what = f"{row.shrunk.digest[:8]} without {operator}"
            beside.setdefault(scene, Probe(scene, "counterpart", what, number, passed=True))
    if not numbers:
        raise StoreError(f"{store.path}: has no run", hint="`vlafuzz run` begins one")
    manifests = [runs[number] for number in numbers]
    if len({(manifest.tested, manifest.task) for manifest in manifests}) > 1:
        problem = f"{store.path}: has failures of several policies or tasks"
        raise UsageError(problem, hint="name a run or a label: --run-a N, --label-a NAME, and so on")
    return Known(
        source=store.path,
        model=_labelled(store.path, manifests[0].tested, label),
        runs=manifests,
        causes=causes,
        probes=[*failing.values(), *beside.values()],
    )


def diff(
    a: Known,
    b: Known,
    first: Side,
    second: Side,
    *,
    alpha: float = 0.05,
    watch: Watch = lambda done, most: None,
) -> Difference:
    """Roll out the second policy in the scenes of the first one's failures, and the other way round.

    Args:
        a: failures of ``first``; ``b``: those of ``second``.
    """
    on_second = roll_out(a, second, alpha, watch)
    on_first = roll_out(b, first, alpha, watch)
    theirs = _changes(a, on_second, "fixed")
    known_already = {change.signature for change in theirs if change.standing == "remaining"}
    ours = [change for change in _changes(b, on_first, "new") if change.signature not in known_already]
    causes = sorted([*theirs, *ours], key=lambda change: ORDER.index(change.standing))
    return Difference(
        first=first.name,
        second=second.name,
        causes=tuple(causes),
        fixed=on_second.fixed,
        broken=on_second.broken,
        new=on_first.fixed,
    )


def roll_out(known: Known, side: Side, alpha: float, watch: Watch) -> Comparison:
    """Roll out the other policy in the scenes of known failures."""
    recorded = Recorded(f"{known.model.short} as recorded")
    return compare(
        known.probes, side, recorded, alpha=alpha, whole=True, watch=lambda now: watch(now.done, now.most)
    )


def _changes(known: Known, compared: Comparison, where_it_passes: Standing) -> list[CauseChange]:
    by_signature: dict[str, list[Compared]] = {}
    for scene in compared.of("failing"):
        by_signature.setdefault(known.causes[scene.probe.scene][0], []).append(scene)
    return [_change(known, signature, scenes, where_it_passes) for signature, scenes in by_signature.items()]


def _change(
    known: Known, signature: str, scenes: Sequence[Compared], where_it_passes: Standing
) -> CauseChange:
    judged = [scene for scene in scenes if scene.judged]
    passes = sum(scene.standing == "better" for scene in judged)
    changed: Standing = where_it_passes if 2 * passes > len(judged) else "remaining"
    first = scenes[0].probe.scene
    return CauseChange(
        signature=signature,
        title=known.causes[first][1],
        standing=changed if judged else "not judged",
        scenes=len(scenes),
        passes=passes,
        scene=first.digest,
        detail=_first(scene.detail for scene in scenes),
    )


def _first(details: Iterable[str]) -> str:
    return next(filter(None, details), "")
