"""Comparison: what strategies are judged by, with tests against a reference, as a table, sentences and a page."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean

from vlafuzz.common import statistics as stats
from vlafuzz.common.plugins import command
from vlafuzz.common.statistics import Estimate
from vlafuzz.common.text import Row, interval, percent, plural
from vlafuzz.report.tables import Table
from vlafuzz.report.view import Head, View
from vlafuzz.store.records import Manifest

ALPHA = 0.05


@dataclass(frozen=True, kw_only=True)
class Counted:
    """The counts of a run; those of triage are None without triage.

    Attributes:
        rollouts: of the search; ``triage_rollouts`` are further ones.
        triaged: failures whose triage fits into its limit.
        signatures: the causes that it certified, by name; ``causes`` is their number.
        failures: distinct failing scenes.
        probability: of a failure in a random scene; None where the strategy does not tell.
    """

    run: int
    strategy: str
    seed: int
    rollouts: int
    triage_rollouts: int | None = None
    triaged: int | None = None
    signatures: Sequence[str] = ()
    causes: int | None
    failures: int
    probability: Estimate | None


# The figures by which strategies are compared, in words, in the order in which they judge.
MEASURES = {"causes": "certified causes", "failures": "failures"}


@dataclass(frozen=True, kw_only=True)
class Pair:
    """One strategy against another in one measure; the n-th runs of both have the same seed and are a pair.

    Attributes:
        ratio: of the means, with its 95 % interval; None where undefined.
        p_holm: corrected over all ``tests`` that are shown together.
    """

    strategy: str
    other: str
    measure: str
    ratio: Estimate | None
    test: stats.SignedRank
    repeats: int
    p_holm: float = 1.0
    tests: int = 1
    verdict: str = ""


@dataclass(frozen=True, kw_only=True)
class Standing:
    """The results of a strategy over its repeats.

    Attributes:
        means: of causes and failures; None where a run lacks them.
        probability: of a failure in a random scene as one run tells it: means of the runs' estimates and of the bounds
            of their 95 % intervals.
        causes: signatures, each with the number of runs in which it was certified.
    """

    strategy: str
    means: Mapping[str, Estimate | None]
    probability: Estimate | None
    causes: Mapping[str, int]


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """The result of ``vlafuzz compare``; the JSON of ``--json``.

    Attributes:
        budget: rollouts of each run; ``triage_rollouts`` is the limit for its triage.
    """

    task: str
    policy: str
    budget: int
    triage_rollouts: int
    repeats: int
    seeds: tuple[int, ...]
    reference: str
    standings: tuple[Standing, ...]
    against: tuple[Pair, ...]
    runs: tuple[Counted, ...]
    store: str

    @property
    def title(self) -> str:
        budget = f"{self.budget} rollouts" + (f" and {self.triage_rollouts} of triage" * bool(self.triage_rollouts))
        return f"{self.task}, {self.policy}, {budget}, {plural(self.repeats, 'repeat')}"


def compare_runs(
    counted: Sequence[Counted], strategies: Sequence[str], manifest: Manifest, *, store: str, limit: int = 0
) -> Comparison:
    """Compare counted runs of a budget and a policy; those of each strategy are in the order of their seeds.

    Args:
        strategies: the others are compared with the first.
        limit: rollouts for the triage of each run.
    """
    runs = {name: [run for run in counted if run.strategy == name] for name in strategies}
    return Comparison(
        task=manifest.task,
        policy=manifest.policy,
        budget=manifest.budget,
        triage_rollouts=limit,
        repeats=len(runs[strategies[0]]),
        seeds=tuple(run.seed for run in runs[strategies[0]]),
        reference=strategies[0],
        standings=tuple(_standing(name, repeats) for name, repeats in runs.items()),
        against=tuple(against(runs, strategies[0])),
        runs=tuple(run for repeats in runs.values() for run in repeats),
        store=store,
    )


def _standing(name: str, runs: Sequence[Counted]) -> Standing:
    tells = [run.probability for run in runs if run.probability]
    bounds = [(known.value, known.low or 0.0, known.high or 0.0) for known in tells]
    return Standing(
        strategy=name,
        means={
            measure: stats.mean_estimate(values) if (values := _known(runs, measure)) else None for measure in MEASURES
        },
        probability=Estimate(*map(fmean, zip(*bounds, strict=True))) if len(tells) == len(runs) else None,
        causes=dict(Counter(cause for run in runs for cause in run.signatures).most_common()),
    )


def _known(runs: Sequence[Counted], measure: str) -> list[float] | None:
    known = [value for run in runs if (value := getattr(run, measure)) is not None]
    return known if len(known) == len(runs) else None


def against(runs: Mapping[str, Sequence[Counted]], reference: str) -> list[Pair]:
    """Compare every strategy with the reference in every measure that all runs of both have, with Holm's correction.

    Args:
        runs: by strategy, its runs in the order of their seeds.
    """
    pairs = []
    for measure in MEASURES:
        values = {name: _known(of_name, measure) for name, of_name in runs.items()}
        theirs = values[reference]
        for name, ours in values.items():
            if name == reference or ours is None or theirs is None:
                continue
            pair = Pair(
                strategy=name,
                other=reference,
                measure=measure,
                ratio=stats.mean_ratio(ours, theirs),
                test=stats.signed_rank(ours, theirs),
                repeats=len(ours),
            )
            pairs.append(pair)
    adjusted = stats.holm([pair.test.p for pair in pairs])
    pairs = [replace(pair, p_holm=p, tests=len(pairs)) for pair, p in zip(pairs, adjusted, strict=True)]
    return [replace(pair, verdict=_sentence(pair)) for pair in pairs]


def _sentence(pair: Pair) -> str:
    measure = MEASURES[pair.measure]
    size, ratio = "", pair.ratio
    if ratio and ratio.low is not None:
        size = f"{ratio.value:.2g}x ({ratio.low:.2g} to {ratio.high:.2g}), "
    size += f"more in {pair.test.more} and fewer in {pair.test.fewer} of {plural(pair.repeats, 'pair')}"
    if (least := pair.tests * stats.smallest_p(pair.repeats)) > ALPHA:
        need = stats.pairs_needed(pair.tests, ALPHA)
        few = "1 repeat is" if pair.repeats == 1 else f"{pair.repeats} repeats are"
        few += f" too few to tell, p is never below {_shown(min(1.0, least))}; {need} could"
        return f"{measure} beside {pair.other}: {few} ({size})"
    numbers = f"{size}, p {_shown(pair.p_holm)} after Holm over {pair.tests} tests"
    if pair.p_holm > ALPHA:
        return f"no difference shown from {pair.other} in {measure}: {numbers}"
    if pair.test.effect > 0:
        return f"more {measure} than {pair.other}: {numbers}"
    return f"fewer {measure} than {pair.other}: {numbers}, which is worse"


def _shown(p: float) -> str:
    return "below 0.0001" if p < 0.0001 else f"{p:.2g}"


def rows(compared: Comparison) -> list[Row]:
    """What strategies are judged by: means over the runs with 95 % intervals, a row for each strategy."""
    return [
        {
            "strategy": standing.strategy,
            **{
                name: "–" if mean is None else f"{mean.value:.3g}" if mean.low is None else str(mean)
                for name, mean in standing.means.items()
                if mean or name == "failures"
            },
            "failure probability": f"{percent(tells.value)} ({interval(tells.low or 0.0, tells.high or 0.0)})"
            if (tells := standing.probability)
            else "–",
        }
        for standing in compared.standings
    ]


def sentences(compared: Comparison) -> list[str]:
    """What the columns mean, the test results by strategy, and where triage was too short to tell."""
    limit = compared.triage_rollouts
    judged = "Nothing was triaged (--triage-rollouts 0), so that failures judge, many of which may have one cause."
    if limit:
        judged = f"Causes: distinct causes that triage of a run's failures certified, with at most {limit} rollouts."
    said = [
        f"Means over the runs, with 95% intervals. {judged} Failure probability: of random scenes, as a run tells it.",
        *(
            f"{pair.strategy}: {pair.verdict}"
            for standing in compared.standings
            for pair in compared.against
            if pair.strategy == standing.strategy
        ),
    ]
    if short := [run for run in compared.runs if run.triage_rollouts and not run.triaged]:
        runs = f"in {len(short)} of {plural(len(compared.runs), 'run')}"
        said.append(f"{runs} {limit} rollouts are too few to triage one failure: give more --triage-rollouts")
    return said


def view_of_comparison(compared: Comparison, view: View) -> View:
    """The view of its store with one card for each cause that compared runs certified, those of most runs first."""
    cards = {card.of.signature: card for card in reversed(view.causes) if card.of and card.of.bucket == "minimal"}
    found = {name: [one.causes.get(name or "", 0) for one in compared.standings] for name in cards}
    ordered = sorted(filter(lambda name: any(found[name]), cards), key=lambda name: -sum(found[name]))
    names = [standing.strategy for standing in compared.standings]
    says, *tests = sentences(compared)
    causes = tuple(
        replace(
            cards[name],
            id=f"cause-{number}",
            numbers=[
                (f"{count} of {compared.repeats}", f"runs of {strategy} certify it")
                for strategy, count in zip(names, found[name], strict=True)
            ],
            step=None,
        )
        for number, name in enumerate(ordered, start=1)
    )
    report = command("report", compared.store, "--out", "report.html", names=[compared.policy])
    return replace(
        view,
        title=f"{' and '.join(names)}: {compared.title}",
        heads=(Head("", f"{tests[0] if tests else 'One strategy, compared with none'}."),),
        causes=causes,
        failures=(),
        tables=(Table("Strategies", rows(compared), f"{says} {'; '.join(tests)}"), view.tables[-1]),
        todo=(("All causes and failures:", report),),
    )
