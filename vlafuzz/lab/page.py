"""The page of a comparison: the strategies in numbers, and each certified cause with the runs that found it."""

from dataclasses import replace

from vlafuzz.common.plugins import command
from vlafuzz.lab.comparison import Comparison, rows, sentences
from vlafuzz.report.tables import Table
from vlafuzz.report.view import Head, View


def view_of_comparison(compared: Comparison, view: View) -> View:
    """The view of its store with one card for each certified cause, those of most runs first."""
    cards = {card.of.signature: card for card in reversed(view.causes) if card.of and card.of.bucket == "minimal"}
    found = {name: [one.causes.get(name or "", 0) for one in compared.standings] for name in cards}
    ordered = sorted(cards, key=lambda name: -sum(found[name]))
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
        todo=(("Films of these causes, and all failures:", report),),
    )
