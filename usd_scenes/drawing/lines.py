"""Lines over a picture: projection through an orthographic camera, and drawing with soft edges."""

from __future__ import annotations

import numpy as np

from tpdwarp.scene.description import CameraAtShutter

STEPS_A_PIXEL = 4
# Weights of the samples on a pixel add up to STEPS_A_PIXEL along a line through its centre.
COVERAGE = 1.0 / STEPS_A_PIXEL


def project(points: np.ndarray, camera: CameraAtShutter, shape: tuple[int, int]) -> np.ndarray:
    """World points, shape [..., 3], as columns and rows in a picture of ``shape`` (rows, columns), [..., 2].

    Pixel centres are at halves.

    Raises:
        ValueError: The camera is not orthographic.
    """
    if not camera.orthographic:
        raise ValueError(f"{camera.path} is not orthographic")
    left, right, bottom, top = camera.window
    x, y = np.moveaxis((points - camera.position) @ camera.axes[:2].T, -1, 0)
    rows, columns = shape
    return np.stack([(x - left) / (right - left) * columns, (top - y) / (top - bottom) * rows], axis=-1)


def draw_lines(pixels: np.ndarray, ends: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Draws lines one pixel wide, in order; what lies outside the picture is cut off.

    Args:
        pixels: The picture, uint8 [h, w, 3].
        ends: Columns and rows of both ends, shape [n, 2, 2].
        colors: Stored values 0 … 255, shape [n, 3].
    """
    height, width, _ = pixels.shape
    drawn = pixels.astype(np.float64)
    for (start, end), color in zip(ends, colors, strict=True):
        count = max(2, int(np.ceil(STEPS_A_PIXEL * np.linalg.norm(end - start))) + 1)
        places = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start) - 0.5
        corner = np.floor(places).astype(int)
        share = places - corner
        cover = np.zeros((height, width))
        for right in (0, 1):
            for down in (0, 1):
                weight = np.where(right, share[:, 0], 1 - share[:, 0]) * np.where(down, share[:, 1], 1 - share[:, 1])
                column, row = corner[:, 0] + right, corner[:, 1] + down
                inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
                np.add.at(cover, (row[inside], column[inside]), COVERAGE * weight[inside])
        touched = cover > 0
        alpha = np.minimum(cover[touched], 1.0)[:, None]
        drawn[touched] += alpha * (color - drawn[touched])
    return np.rint(drawn).astype(np.uint8)
