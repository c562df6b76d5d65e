"""``vlafuzz report`` in the terminal."""

import shlex
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from vlafuzz.cli.output import print_json, print_list, stdout
from vlafuzz.common.plugins import trust_flag
from vlafuzz.common.text import plural
from vlafuzz.report.view import Card, View

FEW = 3  # operators of an untriaged finding that are shown with their values
_DIGITS = 12


def print_findings(source: Path, view: View, evidence: str | None, limit: int, *, json: bool) -> None:
    """Print what a store or corpus has: causes first, the strongest first, then other failures by evidence.

    A cause is the stronger the more random scenes fail for it; those that are not confirmed come last. Failures that
    hardly differ from one that is listed, or only add operators to it, are counted with it.
    """
    from vlafuzz.failures.corpus.controls import CONTROLS
    from vlafuzz.failures.corpus.export import forecast
    from vlafuzz.store.store import Store

    if json:
        print_json(_rows(source, view, evidence))
        return
    cards = [card for card in view.cards if evidence in (None, card.bucket)]
    shown = cards[: limit or None]
    mixed = len({(run.model, run.task) for run in view.runs}) > 1
    said = [] if shown else ["no failures" + (f" with evidence {evidence}" if evidence else "")]
    print_list([_lines(card, mixed) for card in shown], title=_title(cards, view))
    if len(shown) < len(cards):
        said.append(f"{len(cards) - len(shown)} more: --limit 0 shows all of them")
    if shown:
        said.append(f"see number 1: {shown[0].replay}")
    said += [f"{text} {line}" for text, line in view.todo]
    minimal = sum(card.bucket == "minimal" for card in cards)
    if minimal and not view.todo and source.is_file():
        needs = trust_flag(*(run.policy for run in view.runs))
        keep = shlex.join(["vlafuzz", "export", str(source), "--minimal", "--out", "corpus", *needs])
        with Store.open(source) as store:
            takes = forecast(store, minimal, CONTROLS, workers=1)
        said.append(f"keep the minimal ones as a corpus, for vlafuzz regress{takes}: {keep}")
    for text in said:
        stdout().print(text, soft_wrap=True)


def _title(cards: Sequence[Card], view: View) -> str:
    failures = sum(len(card.findings) + len(card.alike) for card in cards)
    apart = f", {failures - len(cards)} of them like another" if len(cards) < failures else ""
    return f"{plural(failures, 'failure')}{apart}, the strongest causes first: {view.title}"


def _lines(card: Card, mixed: bool) -> list[str]:
    """The lines of a card: each value that is not nominal, the evidence, and in a mixed store whose it is."""
    values = [f"{part.operator}: {part.range}" for part in card.deviations]
    if card.bucket == "observed" and len(values) > FEW:
        values = [f"{len(card.operators)} operators not nominal"]
    several = f" · {len(card.findings)} failures" if len(card.findings) > 1 else ""
    several += f" · {len(card.alike)} more alike" if card.alike else ""
    whose = f"{card.run.short} on {card.scene.task} · " if mixed else ""
    evidence = f"{whose}loses {card.lost_stage} · {card.bucket}: {card.detail}{several}"
    return [*(values or [card.title]), f"{evidence} · {card.scene.digest[:_DIGITS]}"]


def _rows(source: Path, view: View, evidence: str | None) -> list[dict[str, Any]]:
    """The findings as ``StoredFinding``, one each, in the order of the cards that show them."""
    from vlafuzz.stored import StoredResults, finding_of

    if source.is_file():
        ranks = {
            (digest, card.run.policy, card.run.named): rank
            for rank, card in enumerate(view.cards)
            for digest in (*card.findings, *card.alike)
        }
        rows = sorted(StoredResults(source).findings(), key=lambda row: ranks[row.found, row.policy, row.label])
    else:
        rows = [finding_of(card) for card in view.cards]
    return [asdict(row) for row in rows if evidence in (None, row.evidence)]
