"""Certify: fresh rollouts show that a shrunk scene mostly fails, and that it takes each operator left."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from vlafuzz.evidence import Rate
from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.triage.oracle import FEWEST, MOST_TO_CERTIFY, ONE_HALF, Answer, Oracle
from vlafuzz.triage.path import CONFOUNDERS, GROUPS, Path, deviating, free_genes
from vlafuzz.triage.reference import Reference

SCENES = 4  # a scene takes at most the rollouts that are left, divided by this: others are to be tried, too


@dataclass(frozen=True, kw_only=True)
class Shrunk:
    """A failing scene after shrinking.

    Attributes:
        lost: the stage that it loses.
        operators: those left, the confounders' as one.
        rate: of the scene; ``rates``: of the counterparts.
        counterparts: by operator, the scene without it, in which the policy mostly passes.
        unresolved: operators left that have no counterpart, with what the scene without them does.
        reference: the scene that it was shrunk to; None for the nominal one.
    """

    scene: Scene
    lost: str
    operators: tuple[str, ...]
    rate: Rate
    counterparts: Mapping[str, Scene] = field(default_factory=dict)
    rates: Mapping[str, Rate] = field(default_factory=dict)
    unresolved: Mapping[str, str] = field(default_factory=dict)
    reference: Scene | None = None

    @property
    def firm(self) -> bool:
        """Whether the scene is shown to fail mostly."""
        return self.rate.low > ONE_HALF

    @property
    def blocked(self) -> bool:
        """Whether an operator is left only because the scene without it is not fair."""
        return Answer.UNFAIR.value in self.unresolved.values()

    @property
    def minimal(self) -> bool:
        """Whether it fails mostly, and every operator left is shown to be necessary."""
        return self.firm and bool(self.operators) and not self.unresolved

    @property
    def problem(self) -> str:
        """Why it is not shown to be minimal."""
        if not self.firm:
            rate = self.rate
            return (
                f"what is left of it is not shown to fail mostly: {rate.failures} of {rate.rollouts} rollouts"
            )
        return "; ".join(f"without {name} the scene {outcome}" for name, outcome in self.unresolved.items())


def certify(way: Sequence[Scene], oracle: Oracle, space: SearchSpace, reference: Reference) -> Shrunk:
    """The simplest scene on the way from a finding that holds when it is tested anew.

    A scene that does not mostly fail was shrunk too far, on the strength of lucky rollouts: its values are
    taken back towards the finding's, then its operators; so they are where an object is in the way of a fair
    counterpart. No scene takes all rollouts, unless none of them holds soon: then the one that fails most
    often does. A counterpart that mostly fails takes the scene's place.

    Args:
        way: from the finding to the simplest failing scene, as ``shrink`` returns it.
    """
    certifier = _Certifier(oracle, space, reference)
    shrunk = likeliest = certifier.test(way[-1])
    for scene in certifier.backwards(way):
        if (shrunk.firm and not shrunk.blocked) or not oracle.room:
            break
        other = certifier.test(scene)
        if other.firm and (not shrunk.firm or not other.blocked):
            shrunk = other
        likeliest = max(likeliest, other, key=_share)
    if not shrunk.firm and oracle.room:
        shrunk = certifier.test(likeliest.scene, MOST_TO_CERTIFY)
    while shrunk.firm and (simpler := certifier.simpler(shrunk)):
        shrunk = simpler
    return shrunk


def certify_one(scene: Scene, oracle: Oracle, space: SearchSpace, reference: Reference) -> Shrunk:
    """The evidence for one scene, as ``certify`` gives it for the first that it tries."""
    return _Certifier(oracle, space, reference).test(scene)


@dataclass(frozen=True)
class _Certifier:
    oracle: Oracle
    space: SearchSpace
    reference: Reference

    def test(self, scene: Scene, most: int | None = None) -> Shrunk:
        """The evidence for a scene, with that for its counterparts where it holds.

        Args:
            most: rollouts in the scene; None for a share of those that are left.
        """
        most = most or max(FEWEST, self.oracle.room // SCENES)
        ((answer, rate),) = self.oracle.certify([scene], most=most)
        left = tuple(deviating(self.space, scene, self.reference.scene))
        start = self.reference.scene
        shrunk = Shrunk(scene=scene, lost=self.oracle.lost(scene), operators=left, rate=rate, reference=start)
        if answer is not Answer.FAILS:
            return shrunk
        without = [self._without(scene, name) for name in left]
        tests = dict(zip(left, self.oracle.certify(without, self.reference.stages), strict=True))
        passing = {name: test.rate for name, test in tests.items() if test.answer is Answer.PASSES}
        return replace(
            shrunk,
            counterparts={name: self._without(scene, name) for name in passing},
            rates=passing,
            unresolved={
                name: self._outcome(self._without(scene, name), test.answer)
                for name, test in tests.items()
                if name not in passing
            },
        )

    def simpler(self, shrunk: Shrunk) -> Shrunk | None:
        """The evidence for a scene with one operator less that mostly fails, too."""
        for name in shrunk.unresolved if len(shrunk.operators) > 1 else ():
            scene = self._without(shrunk.scene, name)
            if self.oracle.certify([scene])[0].answer is Answer.FAILS:
                return self.test(scene)
        return None

    def backwards(self, way: Sequence[Scene]) -> Iterator[Scene]:
        """Scenes from the last to the first: larger values of the operators left, then more operators."""
        last, finding = way[-1], way[0]
        left = deviating(self.space, last, self.reference.scene)
        dropped = [operator for name, several in GROUPS.items() if name not in left for operator in several]
        whole = self.space.reset(finding, dropped, self.reference.scene)
        operators = [operator for name in left if name != CONFOUNDERS for operator in GROUPS[name]]
        path = Path(self.space, whole, free_genes(self.space, whole, operators, last), last)
        if path.length > 1:
            yield path.at(path.length // 2)
        yield whole
        yield from reversed(way[:-1])

    def _without(self, scene: Scene, name: str) -> Scene:
        return self.space.reset(scene, GROUPS[name], self.reference.scene)

    def _outcome(self, scene: Scene, answer: Answer) -> str:
        """What a scene does that is not shown to pass, to complete "the scene …"."""
        if answer is Answer.FAILS:
            return f"fails at {self.oracle.lost(scene, self.reference.stages)}"
        return str(answer.value)


def _share(shrunk: Shrunk) -> float:
    return shrunk.rate.failures / max(shrunk.rate.rollouts, 1)
