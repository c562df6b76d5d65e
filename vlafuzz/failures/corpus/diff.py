"""diff: what two policies fail at, by cause. Both are rolled out anew where one of them is certified to fail.

That it was certified says little about the next rollouts of a policy that fails by chance: found because it failed, it
regresses to its mean. So a cause of the first policy is fixed only if the second one is shown to pass more often in the
same jittered scenes, and one of the second policy is new likewise.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from pathlib import Path
from typing import Literal

from vlafuzz.common.plugins import check_trusted
from vlafuzz.common.statistics import sign_p
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import StoreError, UsageError
from vlafuzz.failures.corpus.pairs import Compared, Fixed, Probe
from vlafuzz.failures.corpus.regress import REPEATS, Comparison, Rerun, Side, compare
from vlafuzz.failures.listed import listing_of
from vlafuzz.model import Model, Scene
from vlafuzz.model.phrasing import titled
from vlafuzz.rollouts import scene_runner
from vlafuzz.store.records import Manifest

PAIRS = 8  # rollouts of each policy for a cause, at least; five of five or seven of eight show a change
Standing = Literal["fixed", "remaining", "new", "unclear", "not judged"]
ORDER: tuple[Standing, ...] = ("new", "remaining", "fixed", "unclear", "not judged")


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """The certified failures of one policy on one task.

    Attributes:
        source: store or corpus, for messages.
        model: whose failures they are.
        runs: that found them; ``Probe.run`` is an index.
        causes: signature of each failing scene.
        probes: the failing scenes.
    """

    source: Path
    model: Model
    runs: Sequence[Manifest]
    causes: dict[Scene, str]
    probes: Sequence[Probe]

    @property
    def repeats(self) -> list[int]:
        """How often each scene is rolled out, so that each cause is ``PAIRS`` times or more."""
        scenes = Counter(self.causes.values())
        return [max(REPEATS, ceil(PAIRS / scenes[self.causes[probe.scene]])) for probe in self.probes]


@dataclass(frozen=True, kw_only=True)
class CauseChange:
    """A cause of one of the policies, after rollouts of the other.

    Attributes:
        signature: of a certified failure; ``title``: its operators in words.
        standing: ``remaining`` where the other policy mostly fails, too; ``unclear`` where it mostly passes, but is not
            shown to do so more often than the policy whose cause it is.
        scenes: minimal ones with this signature; in ``passes`` of them the other policy mostly passes. p_value: that
        the other policy fails there as often, by the sign test over pairs of rollouts. scene: digest of the first one.
        detail: why the other policy fails there, or could not be judged.
        of_second: whether it is a cause of the second policy.
        failures: of the first policy and of the second one, each in so many ``rollouts``.
    """

    signature: str
    title: str
    standing: Standing
    scenes: int
    passes: int
    scene: str
    p_value: float = 1.0
    detail: str = ""
    of_second: bool = False
    failures: tuple[int, int] = (0, 0)
    rollouts: int = 0


@dataclass(frozen=True, eq=False, kw_only=True)
class Difference:
    """Two policies by their causes: those of the first one, then those that only the second one's store has.

    Attributes:
        fixed: test of the second policy in the first one's failing scenes.
        new: test of the first policy in the second one's failing scenes: whether some of these are new.
        asked: the names under which the policies were asked; empty if they were none.
    """

    first: str
    second: str
    causes: tuple[CauseChange, ...]
    fixed: Fixed
    new: Fixed
    asked: tuple[str, ...] = ()

    def of(self, standing: Standing) -> list[CauseChange]:
        return [cause for cause in self.causes if cause.standing == standing]

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        counts = {standing: len(self.of(standing)) for standing in ORDER}
        rest = "".join(f", {counts[standing]} {standing}" for standing in ORDER[3:] if counts[standing])
        fixed = f"{counts['fixed']} fixed ({self.fixed}), {counts['remaining']} remaining"
        new = f"{counts['new']} new ({self.new})"
        if not self.fixed.of:
            fixed = "none is certified"
        if not self.new.of:
            new = f"new ones unknown, as {self.second} has no certified cause"
        return f"causes of {self.first} in {self.second}: {fixed}, {new}{rest}"


def diff_policies(
    a: Path,
    b: Path,
    policy_a: str | None = None,
    policy_b: str | None = None,
    *,
    alpha: float = 0.05,
    watch: Watch = SILENT,
) -> Difference:
    """Compare two policies by the certified causes of two stores or corpora; see ``diff``.

    Args:
        policy_a: name of the policy of ``a`` now; None for that in ``a``; ``policy_b`` likewise.

    Raises:
        UsageError: both are the same model, at one address, on different tasks, or one has several.
        StoreError: none of them has a certified cause.
    """
    first, second = known(a), known(b)
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
        result = diff(first, second, in_a, in_b, alpha=alpha, watch=watch)
    return replace(result, asked=(one.policy, other.policy))


def _two_models(first: Known, second: Known, policy_a: str | None, policy_b: str | None) -> tuple[Model, Model]:
    """The models of ``diff_policies`` under their names of now, once they are found to be comparable."""
    one = replace(first.model, policy=policy_a or first.model.policy)
    other = replace(second.model, policy=policy_b or second.model.policy)
    if one == other:
        hint = "name another one: --policy-a, --policy-b"
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


def known(source: Path) -> Known:
    """The certified failures in a store or corpus.

    Raises:
        StoreError: it has no run.
        UsageError: it has several models or tasks.
    """
    listing = listing_of(source)
    failing = {one.run.key() for one in listing.failures}
    runs = [run for run in listing.runs if run.key() in failing] or list(listing.runs)
    if not runs:
        raise StoreError(f"{source}: has no run", hint="`vlafuzz run` begins one")
    if len({(run.tested, run.task) for run in runs}) > 1:
        problem = f"{source}: has failures of several policies or tasks"
        raise UsageError(problem, hint="give a corpus of one run")
    number = {run.key(): index for index, run in reversed(list(enumerate(runs)))}
    causes, probes = dict[Scene, str](), list[Probe]()
    for one in listing.failures:
        if one.bucket == "minimal" and one.signature and one.run.key() in number and one.scene not in causes:
            causes[one.scene] = one.signature
            title = titled(one.operators, one.causes)
            probes.append(Probe(one.scene, "failing", title, number[one.run.key()], passed=False))
    return Known(source=source, model=runs[0].tested, runs=runs, causes=causes, probes=probes)


def diff(
    a: Known, b: Known, in_a: tuple[Side, Side], in_b: tuple[Side, Side], *, alpha: float = 0.05, watch: Watch = SILENT
) -> Difference:
    """Roll out both policies in the scenes of the first one's failures, and in those of the second one's.

    Args:
        a: failures of the first policy; ``b``: those of the second one.
        in_a: the first policy and the second one, in the scenes of ``a``; ``in_b`` likewise.
        alpha: bound on the probability that a cause is called fixed, or new, if both fail there as often.
    """

    def roll_out(known: Known, other: Side, own: Side) -> Comparison:
        """Roll out the other policy and the one whose failures these are, in their scenes."""
        doing, repeats = "rollouts where one of the policies fails", known.repeats
        return compare(known.probes, other, own, alpha=alpha, repeats=repeats, whole=True, watch=watch, doing=doing)

    first, second = in_a
    on_a, on_b = roll_out(a, second, first), roll_out(b, *in_b)
    theirs = list(_changes(a, on_a, "fixed", alpha))
    known_already = {change.signature for change in theirs if change.standing == "remaining"}
    ours = [change for change in _changes(b, on_b, "new", alpha) if change.signature not in known_already]
    causes = sorted([*theirs, *ours], key=lambda change: ORDER.index(change.standing))
    return Difference(first=first.name, second=second.name, causes=tuple(causes), fixed=on_a.fixed, new=on_b.fixed)


def _changes(known: Known, compared: Comparison, where_it_passes: Standing, alpha: float) -> Iterator[CauseChange]:
    by_signature: dict[str, list[Compared]] = {}
    for scene in compared.of("failing"):
        by_signature.setdefault(known.causes[scene.probe.scene], []).append(scene)
    for signature, scenes in by_signature.items():
        pairs = [pair for scene in scenes for pair in scene.judged]
        p_value = float(sign_p(sum(pair.better for pair in pairs), sum(pair.worse for pair in pairs)))
        standing: Standing = "not judged"
        if pairs:
            passes = 2 * sum(pair.policy.passed for pair in pairs) > len(pairs)
            shown: Standing = where_it_passes if p_value <= alpha else "unclear"
            standing = shown if passes else "remaining"
        first, of_second = scenes[0].probe, where_it_passes == "new"
        own, other = (sum(not pair[side].passed for pair in pairs) for side in (0, 1))
        yield CauseChange(
            signature=signature,
            title=first.what,
            standing=standing,
            scenes=len(scenes),
            passes=sum(bool(scene.judged) and scene.passes for scene in scenes),
            scene=first.scene.digest,
            p_value=p_value,
            detail=next((scene.detail for scene in scenes if scene.detail), ""),
            of_second=of_second,
            failures=(other, own) if of_second else (own, other),
            rollouts=len(pairs),
        )
