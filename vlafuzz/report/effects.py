"""Effects: how often a policy fails in random scenes, by the values of what the operators vary."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vlafuzz.common.statistics import Share, holm
from vlafuzz.common.text import plural
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene, amount
from vlafuzz.model.space import Space
from vlafuzz.report.tables import Table
from vlafuzz.search.base import RANDOM
from vlafuzz.store.records import Run, Trial
from vlafuzz.store.store import Store

ENOUGH = 40  # random scenes, ten in each quarter of a range
QUARTERS = 4
FEWEST = 5  # scenes with one of several options; rarer ones are left out
ALPHA = 0.05  # of all effects together
SHOWN = 6
# Nine of ten: of the 100 rollouts of a usual run at most ten pass, too few to compare the quarters of more
# than a few ranges.
MOSTLY, TEN = 0.9, 10
Value = float | str


@dataclass(frozen=True)
class Bin:
    """The random scenes with some values of a quantity, and how many of them failed."""

    values: str
    failed: Share


@dataclass(frozen=True, kw_only=True)
class Effect:
    """A quantity by whose values failure rates differ.

    Attributes:
        bins: quarters of the scenes, from low to high values; of options those that are frequent enough.
        p: that the rates would differ so much by chance (chi-square), corrected over all quantities (Holm).
    """

    operator: str
    quantity: str
    bins: tuple[Bin, ...]
    p: float

    @property
    def name(self) -> str:
        return f"{self.operator}, {self.quantity}" if self.quantity else self.operator


@dataclass(frozen=True)
class Effects:
    """What random scenes show: ``found`` are the effects that are more than chance, the strongest first.

    Attributes:
        failed: of all random scenes.
        tested: the number of quantities.
    """

    failed: Share
    tested: int
    found: tuple[Effect, ...]

    @property
    def says(self) -> str:
        """The result in a sentence."""
        failed = f"{self.failed.count} of {plural(self.failed.of, 'random scene')} failed"
        if not self.tested:
            few = f"at least {ENOUGH} are needed to compare values"
            return f"{failed}: {few if self.failed.of < ENOUGH else 'there is nothing to compare'}."
        return (
            f"{failed}. {len(self.found)} of {self.tested} quantities make a "
            f"difference beyond chance{f', the strongest {SHOWN} are shown' * (len(self.found) > SHOWN)}."
        )

    @property
    def advice(self) -> str:
        """What to do where nearly all random scenes fail, so that hardly any is left to compare with."""
        if self.failed.of < TEN or self.failed.share < MOSTLY:
            return ""
        return (
            f"{self.failed.count} of {self.failed.of} random scenes fail: hardly any passes to compare with. "
            "To go on, vary one or two operators (--vary light,camera-position), narrow the ranges in a file "
            "(--operators; `vlafuzz list operators` lists them), or train the policy on demonstrations of "
            "the failures (`vlafuzz export --format lerobot`)."
        )

    @property
    def table(self) -> Table:
        """The strongest effects, one row a bin."""
        rows = [
            {
                "varies": effect.name if number == 0 else "",
                "values": part.values,
                "failed": f"{part.failed.count} of {part.failed.of}",
                "rate": str(part.failed),
            }
            for effect in self.found[:SHOWN]
            for number, part in enumerate(effect.bins)
        ]
        return Table("Failure rate by value, in random scenes", rows, self.says)


def effects_of(store: Store, run: Run, space: Space) -> Effects | None:
    """The effects in the random scenes of a run and of comparable ones in its store; None without any."""
    trials = list(random_trials(store, run))
    if not trials:
        return None
    failures = [trial.outcome.verdict is Verdict.FAILED for trial in trials]
    overall = Share.of_counts(sum(failures), len(failures))
    if overall.of < ENOUGH:
        return Effects(overall, 0, ())
    scenes = [trial.scene for trial in trials]
    effects = [
        effect
        for (operator, quantity, path), values in quantities(space, scenes).items()
        if (effect := _effect(operator, quantity, path, values, failures))
    ]
    adjusted = holm([effect.p for effect in effects])
    effects = [replace(effect, p=p) for effect, p in zip(effects, adjusted, strict=True)]
    found = sorted((effect for effect in effects if effect.p <= ALPHA), key=lambda effect: effect.p)
    return Effects(overall, len(effects), tuple(found))


def random_trials(store: Store, run: Run) -> Iterator[Trial]:
    """The judged random scenes of a run and of those that differ in search and seed only, each once."""
    seen: set[str] = set()
    for other in store.runs():
        if not other.manifest.comparable(run.manifest):
            continue
        drawn = draws(store, other)
        for trial in store.trials(other.id):
            if drawn(trial) and trial.outcome.verdict >= Verdict.PASSED and trial.scene.digest not in seen:
                seen.add(trial.scene.digest)
                yield trial


def draws(store: Store, run: Run) -> Callable[[Trial], bool]:
    """Tells whether a trial of a run is a random draw, whose choice depended on no outcome."""
    if run.manifest.strategy == RANDOM:
        return lambda trial: True
    attribution = store.causes(run.id)
    drawn = set(attribution.at_random) if attribution else set[int]()
    return lambda trial: trial.proposal in drawn


def quantities(space: Space, scenes: Sequence[Scene]) -> Mapping[tuple[str, str, str], Sequence[Value | None]]:
    """The value in each scene of what varies, by operator, name in words, and path or derived name.

    Confounders are told by number and nearness, displacements by what is derived of them.
    """
    keys = dict.fromkeys((operator, name, name) for scene in scenes for operator, name in space.derived(scene))
    told = {operator for operator, _, _ in keys}
    genes = []
    for gene in space.genes:
        if gene.operator not in told and not gene.slot.startswith("confounders"):
            *_, slot, name = ("", *gene.path.split("."))
            owner = f" of object {int(slot) + 1}" if slot.isdigit() and slot != "0" else ""
            quantity = "" if name in ("object", "confounders", "instruction", gene.operator) else name
            genes.append((gene.operator, f"{quantity}{owner}".strip(), gene.path))
    found = {key: [value_in(space, scene, key[0], key[2]) for scene in scenes] for key in (*genes, *keys)}
    return {key: values for key, values in found.items() if len({*values} - {None}) > 1}


def value_in(space: Space, scene: Scene, operator: str, quantity: str) -> Value | None:
    """A number, or the name of an option in words; see ``Space.quantity``."""
    value = space.quantity(scene, operator, quantity)
    return value if value is None or isinstance(value, (int, float)) else str(value).replace("_", " ")


def _effect(
    operator: str, quantity: str, path: str, values: Iterable[Value | None], failures: Iterable[bool]
) -> Effect | None:
    from scipy.stats import chi2_contingency

    varied = [(value, failed) for value, failed in zip(values, failures, strict=True) if value is not None]
    distinct = {value for value, _ in varied}
    options = len(distinct) <= QUARTERS or any(isinstance(value, str) for value in distinct)
    groups = (_options if options else _quarters)(path, varied)
    bins = [Bin(name, Share.of_counts(sum(of), len(of))) for name, of in groups if len(of) >= FEWEST]
    table = np.array([(one.failed.count, one.failed.of - one.failed.count) for one in bins])
    if len(bins) < 2 or not table.sum(axis=0).all():
        return None
    chance = float(chi2_contingency(table).pvalue)
    return Effect(operator=operator, quantity=quantity, bins=tuple(bins), p=chance)


def _options(path: str, varied: Sequence[tuple[Value, bool]]) -> Iterator[tuple[str, list[bool]]]:
    """Groups of equal values: numbers in order, names by how often the policy fails."""
    groups: defaultdict[Value, list[bool]] = defaultdict(list)
    for value, failed in varied:
        groups[value].append(failed)
    numbers = all(isinstance(value, (int, float)) for value in groups)
    ordered = sorted(groups) if numbers else sorted(groups, key=lambda value: -np.mean(groups[value]))
    return ((amount(path, value), groups[value]) for value in ordered)


def _quarters(path: str, varied: Sequence[tuple[Value, bool]]) -> Iterator[tuple[str, list[bool]]]:
    """Groups of about equal size; equal values are in one."""
    values = np.array([value for value, _ in varied], dtype=float)
    inner = np.unique(np.quantile(values, np.linspace(0, 1, QUARTERS + 1)[1:-1], method="lower"))
    groups = np.searchsorted(inner, values)
    for group in np.unique(groups):
        inside = values[groups == group]
        failed = [failed for (_, failed), where in zip(varied, groups, strict=True) if where == group]
        yield f"{amount(path, inside.min())} to {amount(path, inside.max())}", failed
