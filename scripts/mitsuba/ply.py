"""Triangles as PLY files, which Mitsuba and Blender read."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def write_ply(path: Path, points: np.ndarray, triangles: np.ndarray, normals: np.ndarray | None = None) -> None:
    """Writes vertices [v, 3], with normals of their own where there are any, and triangles [m, 3]."""
    names = ["x", "y", "z", *(() if normals is None else ("nx", "ny", "nz"))]
    values = np.concatenate([points] if normals is None else [points, normals], axis=1).astype("<f4")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(values)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header"]
    faces = np.zeros(len(triangles), [("sides", "u1"), ("corners", "<i4", 3)])
    faces["sides"], faces["corners"] = 3, triangles
    path.write_bytes(("\n".join(header) + "\n").encode() + values.tobytes() + faces.tobytes())
