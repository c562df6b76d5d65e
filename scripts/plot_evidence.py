#!/usr/bin/env python3
"""The charts of docs/results.md, from the figures in its tables."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

OUT = Path(__file__).parent.parent / "docs" / "pictures"
WORLDS = ("dense", "middling", "sparse", "very sparse")
# Planted faults at 300 rollouts (seeds 30-59): ratio of `causes` to random, with its 95 % interval.
ATTRIBUTION = ((1.05, 0.96, 1.14), (1.22, 1.11, 1.33), (1.32, 1.15, 1.51), (1.9, 1.5, 2.4))
TRIAGE = ((5.1, 3.8, 6.8), (8.4, 6.0, 11.7), (11, 6.8, 18), (14, 7.8, 27))
# Rows of lists that are true, percent, by the rate of failures by chance.
TRUE_ROWS = ((0, 93, 86, 97), (10, 97, 89, 99), (20, 100, 91, 100), (40, 92, 74, 98))


def faults() -> None:
    figure, axes = plt.subplots(figsize=(7, 3))
    for offset, rows, label in (
        (0.12, ATTRIBUTION, "random, same attribution"),
        (-0.12, TRIAGE, "random, then triage"),
    ):
        places = [len(WORLDS) - index + offset for index in range(len(WORLDS))]
        middle = [row[0] for row in rows]
        spread = [[row[0] - row[1] for row in rows], [row[2] - row[0] for row in rows]]
        axes.errorbar(middle, places, xerr=spread, fmt="o", capsize=3, label=f"compared with {label}")
    axes.axvline(1, color="grey", linewidth=1)
    axes.set(
        xscale="log", xlabel="planted faults identified by the strategy causes: times as many", yticks=[4, 3, 2, 1]
    )
    axes.set_xticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
    axes.set_yticklabels([f"{world} worlds" for world in WORLDS])
    axes.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)
    figure.tight_layout()
    figure.savefig(OUT / "evidence-faults.png", dpi=110)


def true_rows() -> None:
    figure, axes = plt.subplots(figsize=(7, 2.2))
    rates, middle, low, high = zip(*TRUE_ROWS, strict=True)
    spread = [
        [m - one for m, one in zip(middle, low, strict=True)],
        [one - m for m, one in zip(middle, high, strict=True)],
    ]
    axes.errorbar(middle, rates, xerr=spread, fmt="o", capsize=3)
    axes.set(xlim=(50, 100), ylim=(-10, 50), xlabel="rows of the list that are true, %", yticks=rates)
    axes.set_yticklabels([f"{rate} % fail by chance" for rate in rates])
    figure.tight_layout()
    figure.savefig(OUT / "evidence-chance.png", dpi=110)


if __name__ == "__main__":
    faults()
    true_rows()
