"""Certify: show that a shrunk scene fails more often than without any of its operators.

A failure with the values of a cause that is certified already needs no search of its own.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from vlafuzz.failures.triage.oracle import Answer, Oracle
from vlafuzz.failures.triage.path import Path, deviating, directed, free_genes, start_values
from vlafuzz.failures.triage.shrink import Reference, Shrinker
from vlafuzz.model import Rate, Scene, Space
from vlafuzz.model.space import CONFOUNDERS
from vlafuzz.store.records import Triaged

# Rollouts to certify a scene, times the lead of an answer; so many times that only where there is no minimal
# scene without them.
PATIENCE, LONGER = 22, 3
SURER = (4, 6)  # rollouts that have to fail in a scene to go on from it, after earlier ones were luck


@dataclass(frozen=True, kw_only=True)
class Shrunk:
    """A failing scene after shrinking.

    Attributes:
        lost: the stage that it loses.
        operators: those left, the confounders' as one.
        rate: of the scene; ``rates``: of the counterparts.
        usual: the rate without any of the operators; None where the scene was not compared with that. firm: whether
        the scene is shown to fail more often than that, or than without each of them.
        counterparts: by operator, the scene without it, which is shown to pass more often. unresolved: operators left
        that have no counterpart, with what the scene without them does. reference: the scene that it was shrunk to;
        None for the nominal one.
    """

    scene: Scene
    lost: str
    operators: tuple[str, ...]
    rate: Rate
    usual: Rate | None = None
    firm: bool = False
    counterparts: Mapping[str, Scene] = field(default_factory=dict)
    rates: Mapping[str, Rate] = field(default_factory=dict)
    unresolved: Mapping[str, str] = field(default_factory=dict)
    reference: Scene | None = None

    @property
    def minimal(self) -> bool:
        """Whether every operator left is shown to matter."""
        return self.firm and bool(self.operators) and not self.unresolved

    @property
    def problem(self) -> str:
        """Why it is not shown to be minimal."""
        if not self.firm:
            fails = f"it fails in {self.rate.failures} of {self.rate.rollouts} rollouts"
            usual = f", and in {self.usual.failures} of {self.usual.rollouts} without them" if self.usual else ""
            return f"what is left of it is not shown to matter: {fails}{usual}"
        return "; ".join(f"without {name} the scene {outcome}" for name, outcome in self.unresolved.items())


@dataclass(frozen=True)
class Certifier:
    """Tests scenes.

    Attributes:
        subject: the space's, if what the scene is about may be why it fails: it is reset then, too.
        patience: rollouts that certify a scene at most, times the lead of an answer.
    """

    oracle: Oracle
    space: Space
    reference: Reference
    subject: Sequence[str] = ()
    patience: int = PATIENCE

    def certify(self, way: Sequence[Scene]) -> Shrunk:
        """The simplest scene on the way from a finding that holds when it is tested anew.

        A scene that is not firm was shrunk too far, on the strength of lucky rollouts: then the last one on the way
        that holds is shrunk again, with more rollouts for every step. A counterpart that is firm itself takes the
        scene's place.

        Args:
            way: from the finding to the simplest failing scene, as ``Shrinker.shrink`` returns it.
        """
        shrunk = self.simplest(self.firm(way))
        if not shrunk.minimal and self.oracle.room:
            patient = replace(self, patience=self.patience * LONGER)
            shrunk = patient.simplest(patient.test(shrunk.scene))
        return shrunk

    def firm(self, way: Sequence[Scene]) -> Shrunk:
        """The evidence for the last scene of the way, shrunk anew where that is not firm.

        Where none does, it is that for the scene that fails most often.
        """
        tried = [self.test(way[-1])]
        for sure in SURER:
            if tried[-1].firm:
                break
            start = next((scene for scene in self.backwards(way) if self.oracle.holds(scene, sure)), None)
            if start is None:
                break
            way = Shrinker(self.space, self.oracle, [start], self.reference.scene, sure, values=False).shrink()
            tried.append(self.test(way[-1]))
        return max(tried, key=lambda one: (one.firm, one.rate.share))

    def test(self, scene: Scene) -> Shrunk:
        """The evidence for a scene: against each of its operators reset, and if that does not do, all of them."""
        left = (*deviating(self.space, scene, self.reference.scene), *self.subject)
        start, stages, most = self.reference.scene, self.reference.stages, self.patience * self.oracle.lead
        lost = self.oracle.lost
        without = {name: self._without(scene, name) for name in left}
        tests = dict(zip(left, self.oracle.contrasts(scene, list(without.values()), stages, most=most), strict=True))
        firm, usual = bool(left) and all(test.answer is Answer.PASSES for test in tests.values()), None
        if not firm:
            every = [operator for name in left for operator in self.space.group(name)]
            (whole,) = self.oracle.contrasts(scene, [self.space.reset(scene, every, start)], stages, most=most)
            firm, usual = bool(left) and whole.answer is Answer.PASSES, whole.rate
        answers = {name: test.answer for name, test in tests.items() if firm}
        shown = [name for name, answer in answers.items() if answer is Answer.PASSES]
        return Shrunk(
            scene=scene,
            lost=lost(scene),
            operators=left,
            rate=self.oracle.certified(scene),
            usual=usual,
            firm=firm,
            reference=start,
            counterparts={name: without[name] for name in shown},
            rates={name: tests[name].rate for name in shown},
            unresolved={
                name: f"fails at {lost(without[name], stages)}" if answer is Answer.FAILS else str(answer.value)
                for name, answer in answers.items()
                if name not in shown
            },
        )

    def simplest(self, shrunk: Shrunk) -> Shrunk:
        """The evidence for the scene with as few operators as are firm."""
        while shrunk.firm and len(shrunk.operators) > 1:
            tested = (self.test(self._without(shrunk.scene, name)) for name in shrunk.unresolved)
            simpler = next((one for one in tested if one.firm), None)
            if simpler is None:
                break
            shrunk = simpler
        return shrunk

    def backwards(self, way: Sequence[Scene]) -> Iterator[Scene]:
        """Scenes from the last to the first: larger values of the operators left, then more operators."""
        last, finding = way[-1], way[0]
        left = deviating(self.space, last, self.reference.scene)
        groups = self.space.groups
        dropped = [operator for name in groups if name not in left for operator in groups[name]]
        whole = self.space.reset(finding, dropped, self.reference.scene)
        operators = [operator for name in left if name != CONFOUNDERS for operator in groups[name]]
        path = Path(self.space, whole, free_genes(self.space, whole, operators, last), last)
        if path.length > 1:
            yield path.at(path.length // 2)
        yield whole
        yield from reversed(way[:-1])

    def _without(self, scene: Scene, name: str) -> Scene:
        return self.space.reset(scene, self.space.group(name), self.reference.scene)


def certified(triaged: Iterable[Triaged | None]) -> list[Triaged]:
    """The first minimal finding of every signature."""
    first: dict[str, Triaged] = {}
    for result in triaged:
        if result and result.bucket == "minimal" and result.signature:
            first.setdefault(result.signature, result)
    return list(first.values())


def by_known_cause(scene: Scene, known: Sequence[Triaged], certifier: Certifier) -> Shrunk | None:
    """The evidence that a failing scene has a known cause.

    That is the scene with the values alone that the cause is about, as far from the reference as they were found: it
    fails more often than without any one of the operators, by rollouts of its own.

    Args:
        known: certified findings.

    Returns:
        None where the scene deviates as no known cause does, or that does not explain the failure.
    """
    oracle, space, reference = certifier.oracle, certifier.space, certifier.reference
    alike = (_alike(scene, one, space, reference) for one in known if space.subject not in one.operators)
    tried = list(dict.fromkeys(filter(None, alike)))
    failing = [one for one, fails in zip(tried, oracle.fails(tried), strict=True) if fails]
    if not failing:
        return None
    simplest = min(failing, key=lambda one: len(deviating(space, one, reference.scene)))
    shrinker = Shrinker(space, oracle, [simplest], reference.scene)
    shrinker.drop_confounders()
    shrunk = certifier.simplest(certifier.test(shrinker.best))
    return shrunk if shrunk.minimal else None


def _alike(scene: Scene, known: Triaged, space: Space, reference: Reference) -> Scene | None:
    """The scene with the values of a known cause alone; None where they are not off in its directions."""
    assert known.shrunk is not None
    # The paths of the values that the cause is about: of a displacement and of confounders all.
    operators = [each for name in known.operators for each in space.group(name)]
    whole = {gene.operator for gene in space.genes if gene.neutral} | set(space.groups.get(CONFOUNDERS, ()))
    kept = {gene.path for gene in free_genes(space, known.shrunk, operators, known.reference)}
    kept |= {gene.path for gene in space.genes if gene.operator in whole.intersection(operators)}
    start = start_values(space, reference.scene)
    others = {
        gene.path: start[gene.path] for gene in space.genes if gene.path not in kept and gene.operator != space.subject
    }
    alone = space.compose(space.values(scene) | others)
    same = _directions(space, alone, reference.scene) == _directions(space, known.shrunk, known.reference)
    return alone if same else None


def _directions(space: Space, scene: Scene, reference: Scene | None) -> list[str]:
    """Operators with their directions; what confounders are matters only for whether there are any."""
    left = deviating(space, scene, reference)
    others = [name for name in left if name != CONFOUNDERS]
    return directed(space, scene, others, reference) + [CONFOUNDERS] * (CONFOUNDERS in left)
