"""Cards: causes, and failures without one, as an engineer reads them."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf, isfinite
from pathlib import Path

from vlafuzz.common.plugins import command
from vlafuzz.common.text import interval, percent, plural
from vlafuzz.errors import SceneError
from vlafuzz.failures.causes import SOLVERS, CauseList, ListedCause
from vlafuzz.failures.described import DescribedFailure
from vlafuzz.failures.regions import Band, bands_of
from vlafuzz.model import Scene
from vlafuzz.model.space import spoken
from vlafuzz.report.plots import Axis, Plot
from vlafuzz.report.view import Card, Strip

SAID = 2  # causes in a sentence
OFF = 0.05  # of an axis: less is no deviation that one would draw


def told(
    found: CauseList | None, causes: Sequence[ListedCause], failed: int, judged: int, *, going_on: bool = False
) -> str:
    """Say in a sentence what fails: when, if causes are known, else how many of the scenes that were judged.

    Args:
        going_on: the run is not over, so that causes may follow.
    """
    if causes:
        return sentence(causes)
    if found and found.probability and failed:  # most scenes were chosen: their count would contradict that estimate
        return "No cause is known yet." if going_on else f"No cause was found{found.nominal}."
    if going_on:
        return f"{failed} of {plural(judged, 'scene')} failed so far; no cause is known yet."
    if not judged:
        return "No scene was judged."
    if not failed:
        return f"Never failed in {plural(judged, 'scene')}."
    why = f"no cause was found{found.nominal}" if found else "nothing has looked for causes yet"
    return f"Fails in {failed} of {plural(judged, 'scene')} that were tried; {why}."


def evidence(rollouts: int, found: CauseList | None) -> str:
    """How many rollouts there were, those of triage included, and how many causes are certified."""
    causes = found.causes if found else ()
    certified = f", {sum(one.bucket == 'minimal' for one in causes)} of {plural(len(causes), 'cause')} certified"
    return plural(rollouts + (found.rollouts if found else 0), "rollout") + certified * bool(causes)


def sentence(causes: Sequence[ListedCause]) -> str:
    """A sentence such as ``Fails when the camera tilts down, or it is dark``; of certified causes, if any."""
    certain = [cause for cause in causes if cause.bucket == "minimal"]
    if not (told := certain or [cause for cause in causes if cause.bucket != "flaky"]):
        return "Fails, but no suspected cause held when its scene was repeated."
    titles = list({cause.signature or cause.title: cause.title for cause in reversed(told)}.values())[::-1]
    more = f", and for {plural(len(titles) - SAID, 'other cause')}" if len(titles) > SAID else ""
    return f"{'Fails' if certain else 'Probably fails'} when {', or '.join(titles[:SAID])}{more}."


def card_of(
    source: Path,
    name: str,
    of: DescribedFailure | None,
    plot: Plot | None,
    cause: ListedCause | None = None,
    failures: str = "",
    more: Sequence[DescribedFailure] = (),
) -> Card:
    """The card of a failure, or of a cause with the failure that shows it and ``more``; ``failures``: all, in words."""
    title = cause.title if cause else of.title if of else ""
    certified = of is not None and of.bucket == "minimal"
    ranged = certified and not (cause and cause.mechanism)  # a mechanism's range is that of its quantity
    bands = bands_of(plot.space, of.scene, of.causes) if plot and of and ranged else ()
    return Card(
        id=name,
        title=f"{title[:1].upper()}{title[1:]}",
        of=of,
        more=[digest for one in more for digest in one.found],
        badge=_badge(of, cause),
        mark=of.bucket if of else "none",
        numbers=list(_numbers(of, cause, failures)) if cause else (),
        strips=[*_of_quantity(of, plot, cause), *_strips(of, plot, bands)] if plot and of else (),
        step=_step(source, of) if of else None,
        neighbours=list(_neighbours(of, plot)) if of and plot else (),
        plot=plot,
        bands=bands,
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


def _numbers(of: DescribedFailure | None, cause: ListedCause, failures: str) -> Iterator[tuple[str, str]]:
    if cause.share:
        yield percent(cause.share.value), f"of random scenes fail for this cause ({interval(*cause.share[1:])})"
    if of and of.rate:
        rate, counts = percent(of.rate.share), f"{of.rate.failures} of {of.rate.rollouts} rollouts fail with it"
        if of.counterpart_rates:
            without = min(of.counterpart_rates.values(), key=lambda one: one.share)
            rate += f" → {percent(without.share)}"
            counts += f", {without.failures} of {without.rollouts} without it"
        yield rate, counts
    if cause.recovers:
        steps, _, rollouts = str(cause.recovers).partition(" (")
        yield steps, f"from the end of the event until the policy makes progress again ({rollouts}"
    if failures:
        yield str(cause.failures), f"of {failures} explained"


def _strips(of: DescribedFailure, plot: Plot, bands: Sequence[Band]) -> Iterator[Strip]:
    """The axes on which ranges fail; of an operator without a range, those on which the scene is off."""
    if of.bucket != "minimal":
        return
    bounded = {band.operator for band in bands}
    for axis, value in zip(plot.axes, plot.values(of.scene), strict=True):
        fails = [band for band in bands if (band.operator, band.quantity) == (axis.operator, axis.quantity)]
        if value is None or axis.options or axis.operator not in of.operators:
            continue
        if fails or (axis.operator not in bounded and abs(axis.share(value) - axis.share(axis.nominal)) > OFF):
            yield Strip(axis, value, fails)


def _of_quantity(of: DescribedFailure, plot: Plot, cause: ListedCause | None) -> Iterator[Strip]:
    """The axis of the quantity of a mechanism, as far as random scenes reach on it."""
    mechanism, space = cause.mechanism if cause else None, plot.space
    if mechanism is None or mechanism.quantity not in space.quantities:
        return
    name, at, quantity = mechanism.quantity, mechanism.threshold, space.quantities[mechanism.quantity]
    shown = (of.scene, space.nominal(like=of.scene), *(scene for scene, _, random in plot.scenes if random))
    here, usual, *others = (space.measured(scene)[name] for scene in shown)
    if isfinite(here) and isfinite(usual):
        known = [here, usual, at, *filter(isfinite, others)]
        start, _, end = quantity.above.partition("≥ {}")
        sides = (quantity.below.partition("{}")[2], end) if "≥" in quantity.below else None
        axis = Axis(operator="", quantity=name, name=start + "…" + end * (not sides), unit=quantity.unit, sides=sides)
        fails = Band("", name, at if mechanism.above else -inf, inf if mechanism.above else at)
        yield Strip(replace(axis, low=min(known), high=max(known), nominal=usual), here, [fails])


def _step(source: Path, of: DescribedFailure) -> tuple[str, str]:
    names = [of.run.policy, of.run.task]
    if of.bucket == "observed":
        return "Find out whether it holds:", command("triage", source, "--limit", 5, names=names)
    if of.bucket == "minimal" and source.is_file():
        keep = command("export", source, "--minimal", "--out", "corpus", names=names)
        return "Keep it, to test the next checkpoint:", keep
    return "Look at it again:", of.replay


def _neighbours(of: DescribedFailure, plot: Plot) -> Iterator[tuple[str, Scene]]:
    """Scenes in which the policy should pass: the reference or nominal one, then each without a part of the cause."""
    if of.reference is not None:
        yield "passing neighbour", of.reference
    else:
        with suppress(SceneError):  # an imported scene
            yield "nominal", plot.space.nominal(like=of.scene)
    rates = {operator: rate.share for operator, rate in of.counterpart_rates.items()}
    for operator in sorted(of.counterparts, key=lambda name: rates.get(name, 1.0)):
        yield f"without {spoken(operator)}", of.counterparts[operator]
