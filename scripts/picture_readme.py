#!/usr/bin/env python3
"""Make README's picture: a policy that fails in a scene of a shipped corpus, and the actions that solve it.

scripts/picture_readme.py --corpus mini-put-in --case 8 --out docs/failure.jpg
"""

from __future__ import annotations

import argparse
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.report.films import RunFilms
from vlafuzz.report.view import SOLVERS

MOMENTS = 5
LINE, GAP = 26, 3  # pixels of a caption, and between frames


def moments(video: bytes) -> list[Image.Image]:
    """Frames of a film, evenly spaced from the first to the last."""
    frames = imageio.imread(video, extension=".mp4")
    chosen = np.linspace(0, len(frames) - 1, MOMENTS).round().astype(int)
    return [Image.fromarray(frames[index]) for index in chosen]


def sheet(rows: list[tuple[str, list[Image.Image]]]) -> Image.Image:
    """Rows of frames, each under its caption."""
    width, height = (length + GAP for length in rows[0][1][0].size)
    picture = Image.new("RGB", (MOMENTS * width, len(rows) * (height + LINE)), "white")
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(size=16)
    for row, (caption, frames) in enumerate(rows):
        top = row * (height + LINE)
        draw.text((4, top + 3), caption, fill="black", font=font)
        for column, frame in enumerate(frames):
            picture.paste(frame, (column * width, top + LINE))
    return picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--corpus", type=Path, default=Path("mini-put-in"))
    parser.add_argument("--case", type=int, default=8)
    parser.add_argument("--out", type=Path, default=Path("docs/failure.jpg"))
    options = parser.parse_args()
    corpus = read_corpus(options.corpus)
    case = corpus.cases[options.case]
    run, films = corpus.runs[case.run], RunFilms(options.corpus)
    failure, solution = films(run, case.scene, None), films(run, case.scene, case.witness.actions)
    films.close()
    if not (failure and failure.failed and solution and not solution.failed):
        raise SystemExit("the policy does not fail here, or the witness does not solve the scene")
    wanted = f"\N{LEFT DOUBLE QUOTATION MARK}{case.scene.instruction}\N{RIGHT DOUBLE QUOTATION MARK}"
    rows = [
        (f"{wanted}: {run.policy} fails ({case.title})", moments(failure.video)),
        (f"The same scene, solved by {SOLVERS[case.witness.solver]}", moments(solution.video)),
    ]
    sheet(rows).save(options.out, quality=85)
    print(f"{options.out}: {options.out.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
