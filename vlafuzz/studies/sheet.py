"""A study on paper: markdown, and a plot of how far the subject comes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vlafuzz.studies.similar import Similarity
from vlafuzz.studies.stages import Published, Reached, Standing

# Okabe, Ito 2008: told apart with any colour vision.
_COLOURS = ("#56B4E9", "#0072B2", "#000000", "#009E73", "#E69F00")
NOTE = (
    "Shares of the scenes that were judged, with Wilson's 95 % interval. The paper's are of other subjects "
    "on other robots in another simulator: they stand beside, they do not compare."
)


def stage_rows(standings: Sequence[Standing], papers: Sequence[Published] = ()) -> list[dict[str, Any]]:
    """A row a run and stage; success has the mean of the paper's seven subjects beside it."""
    means = {(paper.task, "success"): paper.mean for paper in papers}
    return [
        {
            "task": each.task,
            "subject": each.subject,
            "confounders": each.confounders,
            "stage": stage.stage,
            "scenes": stage.count,
            "of": stage.of,
            "share": round(stage.share, 4),
            "low": round(stage.low, 4),
            "high": round(stage.high, 4),
            "published": means.get((each.task, stage.stage)),
        }
        for each in standings
        for stage in each.stages
    ]


def markdown(
    title: str, standings: Sequence[Standing], papers: Sequence[Published], similar: Sequence[Similarity] = ()
) -> str:
    """To paste."""
    parts = [f"# {title}", *(_table(standings, task) for task in _tasks(standings)), NOTE]
    if papers:
        lines = ["| VLATest's RQ1, success | mean of seven | least | most |", "|---|---|---|---|"]
        lines += [_paper_row(each) for each in papers]
        parts.append("\n".join(lines))
    if similar:
        head = "| task | subject | similar scenes | others | progress | of others | A12 | p (Holm) |"
        parts.append("\n".join([head, "|---|---|---|---|---|---|---|---|", *map(_similar_row, similar)]))
        parts.append("Similar: a confounder's name ends in the same word as the target's, such as can.")
    return "\n\n".join(parts) + "\n"


def plot(title: str, standings: Sequence[Standing], papers: Sequence[Published], path: Path) -> None:
    """Bars a stage with their intervals, a panel a task; the paper's mean success as a mark."""
    from matplotlib.figure import Figure

    tasks = _tasks(standings)
    figure = Figure(figsize=(3.2 * len(tasks) + 0.8, 3.6), layout="constrained")
    for axes, task in zip(figure.subplots(1, len(tasks), sharey=True, squeeze=False)[0], tasks, strict=True):
        its = [each for each in standings if each.task == task]
        _panel(axes, its)
        for paper in (paper for paper in papers if paper.task == task):
            last = len(its[0].stages) - 1
            axes.plot(last, paper.mean, "D", color="#D55E00", clip_on=False, label="VLATest, mean of seven")
        axes.set_title(task, fontsize=10)
    figure.axes[0].set(ylabel="share of scenes", ylim=(0, 1))
    labelled = {label: handle for axes in figure.axes for handle, label in zip(*_legend(axes), strict=True)}
    if labelled:
        figure.legend(
            labelled.values(),
            labelled.keys(),
            loc="outside lower center",
            ncols=min(5, len(labelled)),
            frameon=False,
            fontsize=8,
        )
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=150)


def _panel(axes: Any, its: Sequence[Standing]) -> None:
    """Stages side by side; within one, the runs: those of RQ2 by their number of confounders."""
    width = 0.8 / len(its)
    for number, each in enumerate(its):
        where = [place + (number - (len(its) - 1) / 2) * width for place in range(len(each.stages))]
        label = (
            each.subject if each.confounders is None else f"{each.subject}, {each.confounders} confounders"
        )
        shares = [stage.share for stage in each.stages]
        ends = [
            [max(0.0, stage.share - stage.low) for stage in each.stages],
            [max(0.0, stage.high - stage.share) for stage in each.stages],
        ]
        colour = _COLOURS[(number if each.confounders is None else each.confounders) % len(_COLOURS)]
        axes.bar(where, shares, width * 0.92, color=colour, label=label)
        axes.errorbar(where, shares, yerr=ends, fmt="none", ecolor="#777777", elinewidth=1, capsize=2)
    axes.set_xticks(range(len(its[0].stages)), [stage.stage for stage in its[0].stages])
    axes.grid(axis="y", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _legend(axes: Any) -> tuple[list[Any], list[str]]:
    handles, labels = axes.get_legend_handles_labels()
    return list(handles), list(labels)


def _table(standings: Sequence[Standing], task: str) -> str:
    its = [each for each in standings if each.task == task]
    counted = its[0].confounders is not None
    names = [stage.stage for stage in its[0].stages]
    head = [task, *(["confounders"] if counted else []), *names, "progress", "judged", "invalid", "errors"]
    lines = [_line(head), _line(["---"] * len(head))]
    for each in its:
        progress = "–" if each.progress is None else f"{each.progress:.2f}"
        cells = [each.subject, *([str(each.confounders)] if counted else []), *map(_share, each.stages)]
        lines.append(_line([*cells, progress, str(each.judged), str(each.invalid), str(each.errors)]))
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _share(stage: Reached) -> str:
    return f"{stage.share:.1%} ({stage.low:.1%}–{stage.high:.1%})" if stage.of else "–"


def _paper_row(paper: Published) -> str:
    mean = f"{paper.mean:.1%}" + (f", elsewhere {paper.as_well:.1%}" if paper.as_well else "")
    least, most = (choose(paper.subjects.items(), key=lambda item: item[1]) for choose in (min, max))
    return _line([paper.task, mean, f"{least[1]:.1%} ({least[0]})", f"{most[1]:.1%} ({most[0]})"])


def _similar_row(each: Similarity) -> str:
    values = [each.progress_similar, each.progress_other, each.a12]
    shown = ["–" if value is None else f"{value:.2f}" for value in values]
    chance = "–" if each.p is None or each.adjusted is None else f"{each.p:.3g} ({each.adjusted:.3g})"
    return _line([each.task, each.subject, str(each.similar), str(each.other), *shown, chance])


def _tasks(standings: Sequence[Standing]) -> list[str]:
    return list(dict.fromkeys(each.task for each in standings))
