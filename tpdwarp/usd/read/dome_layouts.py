"""Pictures of domes in the layouts that USD names, brought to latitude and longitude.

Of every layout the dome's +z axis is in the middle and +y is up. A reflecting ball is seen along −z from afar, with x
to the right; the angular map is turned as it is. A vertical cross is seen from inside, as latitude and longitude are.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

# A cross of four faces by three.
CROSS_ASPECT = 0.75
# Places in a pixel, along each side, that its value is the mean of: a ball's picture is finer in its middle.
PLACES = 3
# Of each face of a vertical cross: its row and column, and the directions of its middle, right and top.
FACES = (
    (0, 1, (0, 1, 0), (-1, 0, 0), (0, 0, -1)),
    (1, 0, (1, 0, 0), (0, 0, 1), (0, 1, 0)),
    (1, 1, (0, 0, 1), (-1, 0, 0), (0, 1, 0)),
    (1, 2, (-1, 0, 0), (0, 0, -1), (0, 1, 0)),
    (2, 1, (0, -1, 0), (-1, 0, 0), (0, 0, 1)),
    (3, 1, (0, 0, -1), (-1, 0, 0), (0, -1, 0)),
)


def layout_of(named: str, picture: np.ndarray) -> str:
    """The layout of a picture [h, w, 3] by its dome's token; what is automatic is told by its sides."""
    if named not in ("", "automatic"):
        return named
    height, width = picture.shape[:2]
    return "cubeMapVerticalCross" if width == CROSS_ASPECT * height else "latlong"


def as_latlong(picture: np.ndarray, layout: str) -> np.ndarray | None:
    """A picture [h, w, 3] by latitude and longitude, [h / 2, h, 3]; None where the layout is not known.

    Rows go from +y down, columns from +180° down, where +z is at 0° and +x at 90°.
    """
    if layout == "latlong":
        return picture
    if layout not in LAYOUTS:
        return None
    rows = max(2, len(picture) // 2)
    total = np.zeros((rows, 2 * rows, 3))
    offsets = (np.arange(PLACES) + 0.5) / PLACES
    for down in offsets:
        for right in offsets:
            latitude = np.pi * (0.5 - (np.arange(rows)[:, None] + down) / rows)
            longitude = np.pi * (1.0 - (np.arange(2 * rows) + right) / rows)
            directions = np.stack(
                [
                    np.cos(latitude) * np.sin(longitude),
                    np.broadcast_to(np.sin(latitude), (rows, 2 * rows)),
                    np.cos(latitude) * np.cos(longitude),
                ],
                axis=-1,
            )
            total += LAYOUTS[layout](picture, directions)
    return total / PLACES**2


def _on_ball(picture: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """What a ball of mirrors shows of the directions: half way to them lie its normals."""
    halves = directions + np.array([0.0, 0.0, 1.0])
    lengths = np.linalg.norm(halves, axis=-1)
    # Of what is behind the ball the whole rim is a picture.
    normals = np.where(lengths[..., None] > 1e-9, halves / np.maximum(lengths, 1e-9)[..., None], (1.0, 0.0, 0.0))
    return _on_disc(picture, normals[..., 0], normals[..., 1])


def _on_angular_map(picture: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """What an angular map shows of the directions: as far from its middle as their angle from +z."""
    across = np.hypot(directions[..., 0], directions[..., 1])
    radius = np.arctan2(across, directions[..., 2]) / np.pi / np.maximum(across, 1e-12)
    return _on_disc(picture, directions[..., 0] * radius, directions[..., 1] * radius)


def _on_disc(picture: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A picture at places −1 … 1 to the right and up; half a pixel inside of its circle, beyond which is no light."""
    height, width = picture.shape[:2]
    inside = 1.0 - 1.0 / min(height, width)
    radius = np.maximum(np.hypot(x, y) / inside, 1.0)
    return _between(picture, 0.5 * (1.0 + x / radius) * width - 0.5, 0.5 * (1.0 - y / radius) * height - 0.5)


def _on_cross(picture: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """What a cube that is unfolded shows of the directions."""
    side = min(picture.shape[0] // 4, picture.shape[1] // 3)
    found = np.zeros(directions.shape)
    best = np.max(np.abs(directions), axis=-1)
    for row, column, middle, right, top in FACES:
        along = directions @ np.array(middle, float)
        here = along >= best * (1.0 - 1e-12)
        face = picture[row * side : (row + 1) * side, column * side : (column + 1) * side]
        u, v = (directions[here] @ np.array(axis, float) / along[here] for axis in (right, top))
        found[here] = _between(face, 0.5 * (1.0 + u) * side - 0.5, 0.5 * (1.0 - v) * side - 0.5)
    return found


def _between(picture: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A picture at places in pixels, whose middles are whole numbers: linear between them, held beyond."""
    height, width = picture.shape[:2]
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    left, above = np.floor(x).astype(int), np.floor(y).astype(int)
    s, t = (x - left)[..., None], (y - above)[..., None]
    right, below = np.minimum(left + 1, width - 1), np.minimum(above + 1, height - 1)
    upper = (1 - s) * picture[above, left] + s * picture[above, right]
    lower = (1 - s) * picture[below, left] + s * picture[below, right]
    return (1 - t) * upper + t * lower


LAYOUTS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "mirroredBall": _on_ball,
    "angular": _on_angular_map,
    "cubeMapVerticalCross": _on_cross,
}
