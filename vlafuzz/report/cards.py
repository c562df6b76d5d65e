"""Cards: causes, and failures without one, as an engineer reads them."""

import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from vlafuzz.common.plugins import trust_flag
from vlafuzz.common.text import interval, percent, plural
from vlafuzz.errors import SceneError
from vlafuzz.failures.causes import SOLVERS, ListedCause
from vlafuzz.failures.described import DescribedFailure
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import spoken
from vlafuzz.report.plots import Axis, Band, Plot
from vlafuzz.report.view import Card, Number, Strip

SAID = 2  # causes in a sentence
OFF = 0.05  # of an axis: less is no deviation that one would draw


def cards_of(
    source: Path,
    causes: Iterable[tuple[ListedCause, DescribedFailure | None, int]],
    others: Iterable[DescribedFailure],
    plots: Mapping[DescribedFailure, Plot],
) -> tuple[Card, ...]:
    """One card for each cause, then one for each failure that shows none.

    Args:
        source: the store or corpus.
        causes: each with the failure that shows it, and the number of failures of its run.
        plots: the scenes among which a failure is.
    """
    cards = [
        _card(source, f"cause-{number}", of, plots, cause, failures)
        for number, (cause, of, failures) in enumerate(causes, start=1)
    ]
    return (*cards, *(_card(source, f"failure-{number}", of, plots) for number, of in enumerate(others, start=1)))


def sentence(causes: Sequence[ListedCause]) -> str:
    """A sentence such as ``Fails when the camera tilts down by at least 4.2°, or the light is at least × 6``.

    Of causes of which some are certified only those.
    """
    certain = [cause for cause in causes if cause.bucket == "minimal"]
    told = certain or [cause for cause in causes if cause.bucket != "flaky"] or list(causes)
    titles = list({cause.signature or cause.title: cause.title for cause in reversed(told)}.values())[::-1]
    more = f", and for {plural(len(titles) - SAID, 'other cause')}" if len(titles) > SAID else ""
    return f"{'Fails' if certain else 'Probably fails'} when {', or '.join(titles[:SAID])}{more}."


def _card(
    source: Path,
    name: str,
    of: DescribedFailure | None,
    plots: Mapping[DescribedFailure, Plot],
    cause: ListedCause | None = None,
    failures: int = 0,
) -> Card:
    title = cause.title if cause else of.title if of else ""
    plot = plots.get(of) if of else None
    bands = plot.bands(of) if plot and of else {}
    return Card(
        id=name,
        title=f"{title[:1].upper()}{title[1:]}",
        of=of,
        cause=cause,
        badge=_badge(of, cause),
        numbers=tuple(_numbers(of, cause, failures)) if cause or (of and of.bucket == "minimal") else (),
        strips=tuple(_strips(of, plot, bands)) if plot and of else (),
        step=_step(source, of),
        neighbours=tuple(_neighbours(of, plot)) if of and plot else (),
        plot=plot,
        bands=tuple(band for several in bands.values() for band in several),
    )


def _badge(of: DescribedFailure | None, cause: ListedCause | None) -> tuple[str, str]:
    """How well it is shown, in a word, and in a sentence."""
    if of is None:
        return "seen", f"{cause.detail if cause else ''}."
    solved = f" The {SOLVERS[of.witness.solver]} solves the same scene." if of.witness else ""
    detail = f"{of.detail[:1].upper()}{of.detail[1:]}.{solved}"
    rollouts = of.rate.rollouts if of.rate else of.repeats
    words = {
        "minimal": "certified",
        "witnessed": f"repeated {rollouts} times",
        "unproven": "not shown to be solvable",
        "flaky": f"not confirmed in {rollouts} repeats",
        "observed": "seen once",
    }
    more = {
        "minimal": "It fails more often than without any part of it, with 95 % confidence.",
        "unproven": "The expert fails in this scene, too: it may be impossible.",
    }
    return words[of.bucket], f"{detail} {more.get(of.bucket, '')}".strip()


def _numbers(of: DescribedFailure | None, cause: ListedCause | None, failures: int) -> Iterator[Number]:
    if cause and cause.share:
        yield Number(percent(cause.share.value), f"of random scenes fail for this cause ({interval(*cause.share[1:])})")
    if of and of.rate:
        without = min(of.counterpart_rates.values(), key=lambda rate: rate.share, default=None)
        compared = f" → {percent(without.share)}" if without else ""
        counts = f"{of.rate.failures} of {of.rate.rollouts} rollouts fail with it"
        than = f", {without.failures} of {without.rollouts} without it" if without else ""
        yield Number(f"{percent(of.rate.share)}{compared}", f"{counts}{than}")
    if cause and failures:
        yield Number(str(cause.failures), f"of {plural(failures, 'failure')} explained")


def _strips(of: DescribedFailure, plot: Plot, bands: Mapping[str, Sequence[Band]]) -> Iterator[Strip]:
    """The axes on which ranges fail; of what is certified without a range, those on which the scene is off."""
    for axis, value in zip(plot.axes, plot.values(of.scene), strict=True):
        if value is None or axis.options or axis.operator not in of.operators:
            continue
        fails = bands.get(axis.operator, ())
        off = of.bucket == "minimal" and abs(axis.share(value) - axis.share(axis.nominal)) > OFF
        if fails[0].axis == axis.id if fails else off:
            yield _strip(axis, value, fails)


def _strip(axis: Axis, value: float, fails: Sequence[Band]) -> Strip:
    ranges = " and ".join(f"{axis.says(band.low)} to {axis.says(band.high)}" for band in fails)
    says = f"{axis.name}: fails from {ranges}" if fails else f"{axis.name}: {axis.says(value)} in this scene"
    return Strip(
        axis.name,
        axis.says(axis.low),
        axis.says(axis.high),
        axis.share(axis.nominal),
        tuple((axis.share(band.low), axis.share(band.high)) for band in fails),
        axis.share(value),
        f"{says}; nominal {axis.says(axis.nominal)}, range {axis.says(axis.low)} to {axis.says(axis.high)}",
    )


def _step(source: Path, of: DescribedFailure | None) -> tuple[str, str] | None:
    """What to do next, and the command."""
    if of is None:
        return None
    trust = trust_flag(of.run.policy)
    if of.bucket == "observed":
        return "Find out whether it holds:", shlex.join(["vlafuzz", "triage", str(source), "--limit", "5", *trust])
    if of.bucket == "minimal" and source.is_file():
        keep = ["vlafuzz", "export", str(source), "--minimal", "--out", "corpus", *trust]
        return "Keep it, to test the next checkpoint:", shlex.join(keep)
    return "Look at it again:", of.replay


def _neighbours(of: DescribedFailure, plot: Plot) -> Iterator[tuple[str, Scene]]:
    """Scenes in which the policy should pass: the reference or nominal one, then each without a part of the cause."""
    if of.reference is not None:
        yield "passing neighbour", of.reference
    else:
        with suppress(SceneError):  # an imported scene
            yield "nominal", plot.space.nominal(like=of.scene)
    for operator in sorted(
        of.counterparts, key=lambda name: of.counterpart_rates[name].share if name in of.counterpart_rates else 1
    ):
        yield f"without {spoken(operator)}", of.counterparts[operator]
