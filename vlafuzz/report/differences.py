"""The view of two policies: which causes are fixed, which remain, and which are new."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace

from vlafuzz.common.text import plural
from vlafuzz.failures.corpus.diff import ORDER, CauseChange, Difference, Standing
from vlafuzz.failures.corpus.tables import difference_rows
from vlafuzz.report.tables import Table
from vlafuzz.report.view import Card, Head, View

MEANS: Mapping[Standing, str] = {
    "new": "It is a cause of {second}, and {first} is shown to pass there more often.",
    "remaining": "Both policies mostly fail there.",
    "fixed": "It is a cause of {first}, and {second} is shown to pass there more often.",
    "unclear": "It is a cause of one policy. The other mostly passes there, but is not shown to pass more often.",
    "not judged": "No rollout there could be judged.",
}


def view_of_difference(first: View, second: View, result: Difference) -> View:
    """A card for each cause, new ones first, among the scenes of both stores or corpora, which have these views.

    What both call alike has the name of its store or corpus behind it.
    """
    views = (first,) if first.source == second.source else (first, second)
    names = Counter(name for of in views for name in {one.name for one in of.heads} | {one.title for one in of.plots})

    def named(name: str, view: View) -> str:
        return f"{name}, {view.source}" if names[name] > 1 else name

    plots = {plot: replace(plot, title=named(plot.title, view)) for view in views for plot in view.plots}
    heads = [head._replace(name=named(head.name, view)) for view in views for head in view.heads]
    cards = (replace(card, plot=card.plot and plots.get(card.plot)) for card in _cards(result, first, second))
    counts = [f"{len(found)} {standing}" for standing in ORDER if (found := result.of(standing))]
    says = f"Causes of failure in {result.second}, compared with {result.first}: {', '.join(counts)}."
    title = f"{result.first} → {result.second}"
    return View(
        title=title,
        source=f"{first.source}, {second.source}",
        heads=(Head(title, says), *heads),
        causes=tuple(cards),
        plots=tuple(plots.values()),
        runs=tuple(run for view in views for run in view.runs),
        tables=(Table("Causes of both policies", difference_rows(result), f"{result.verdict}."),),
    )


def _cards(result: Difference, first: View, second: View) -> Iterator[Card]:
    """What the rollouts of both policies showed, on the card that the cause has by itself."""
    for number, change in enumerate(result.causes, start=1):
        cards = {card.of.scene.digest: card for card in (second if change.of_second else first).cards if card.of}
        card = cards[change.scene]
        yield replace(
            card,
            id=f"cause-{number}",
            badge=(change.standing, MEANS[change.standing].format(first=result.first, second=result.second)),
            mark=change.standing.replace(" ", "-"),
            numbers=list(_numbers(change, result)),
            step=None,
        )


def _numbers(change: CauseChange, result: Difference) -> Iterator[tuple[str, str]]:
    if change.rollouts:
        before, after = change.failures
        told = f"of {plural(change.rollouts, 'rollout')} fail: {result.first}, then {result.second}"
        yield f"{before} → {after}", told
        yield f"{change.p_value:.2g}", "probability of so large a difference if both failed there as often"
