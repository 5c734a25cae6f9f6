"""Sheets: tiles joined in one picture with their captions, and the file that keeps all captions and numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tpdwarp.io.images import encoded_picture, with_text

DOCS = Path(__file__).resolve().parents[2] / "docs" / "figures"
CAPTIONS = "README.md"
HEADING = "# Figures\n\nThe paper's figures as this program draws them. `scripts/figures/all.py` makes them anew.\n"
TEXT_SIZE = 12
LINE_HEIGHT = 16
GAP = 6


@dataclass(frozen=True, eq=False)
class Tile:
    """One picture of a sheet.

    Attributes:
        pixels: Values as they are stored, uint8, shape [h, w, 3]; all tiles of a sheet have one shape.
        lines: Its caption, written beneath it.
    """

    pixels: np.ndarray
    lines: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Figure:
    """One figure.

    Attributes:
        number: As in the paper.
        title: What it shows.
        rows: Its tiles, row by row.
        text: What is to be seen, and the numbers, as Markdown.
    """

    number: int
    title: str
    rows: Sequence[Sequence[Tile]]
    text: str

    @property
    def file_name(self) -> str:
        return f"fig{self.number}.png"


def grey(values: np.ndarray, black: float, white: float) -> np.ndarray:
    """Values [h, w] as a grey picture, uint8 [h, w, 3], evenly from ``black`` to ``white``."""
    codes = np.rint(255 * np.clip((values - black) / (white - black), 0, 1)).astype(np.uint8)
    return np.repeat(codes[..., None], 3, axis=2)


def sheet(rows: Sequence[Sequence[Tile]]) -> np.ndarray:
    """Tiles side by side with their captions beneath, uint8 [h, w, 3]; shorter rows end in black."""
    height, width, _ = rows[0][0].pixels.shape
    below = LINE_HEIGHT * max(len(tile.lines) for row in rows for tile in row) + GAP
    columns = max(map(len, rows))
    picture = np.zeros((len(rows) * (height + below), columns * (width + GAP) - GAP, 3), np.uint8)
    text = []
    for row, tiles in enumerate(rows):
        for column, tile in enumerate(tiles):
            top, left = row * (height + below), column * (width + GAP)
            picture[top : top + height, left : left + width] = tile.pixels
            text += [
                (left + 2, top + height + LINE_HEIGHT * (number + 1) - 3, line)
                for number, line in enumerate(tile.lines)
            ]
    return with_text(picture, text, TEXT_SIZE)


def publish(figure: Figure, folder: Path = DOCS) -> Path:
    """Writes the figure's picture, and its section of the captions file in place of an older one."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / figure.file_name
    path.write_bytes(encoded_picture(sheet(figure.rows), ".png"))
    captions = folder / CAPTIONS
    old = captions.read_text(encoding="utf-8") if captions.exists() else HEADING
    captions.write_text(with_section(old, figure), encoding="utf-8")
    return path


def with_section(captions: str, figure: Figure) -> str:
    """The captions file with the section of ``figure`` replaced or added, in order of number."""
    head, *parts = re.split(r"(?m)^(?=## Fig\. \d+)", captions)
    sections = {int(part.split()[2].rstrip(":")): part.strip() for part in parts}
    alternative = f"Fig. {figure.number}"
    sections[figure.number] = (
        f"## Fig. {figure.number}: {figure.title}\n\n![{alternative}]({figure.file_name})\n\n{figure.text.strip()}"
    )
    return "\n\n".join([head.strip(), *(sections[number] for number in sorted(sections))]) + "\n"
