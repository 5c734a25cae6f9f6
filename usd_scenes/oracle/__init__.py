"""An independent oracle in float64 NumPy: what the renderer's numbers are compared with, sharing none of its code.

Only the dataclasses of ``tpdwarp.scene.description`` are imported, so that a scene written once can be given to both.

Tracing through moving geometry, at any time (:mod:`.tracer`, :mod:`.surfaces`)::

    water = TriangleMesh("/water", points=lambda t: rest + velocity * t, triangles=faces, normals=normals_at,
                         interaction=Interaction.DIELECTRIC, ior=1.33)
    floor = Plane("/floor", point=(0, 0, 0), normal=(0, 0, 1))
    path = trace([water, floor], origins, directions, t=0.5, choices="auto")
    path.positions, path.directions, path.throughput, path.landed, path.surfaces, path.barycentrics

Differentials of a footprint by finite differences (:mod:`.differences`): u, v in whatever unit ``emit`` uses, time over
the whole exposure, the photon riding on the first specular surface (``"surface"``) or on the light (``"light"``)::

    found = finite_differences([water, floor], parallel_beam(corner, step_u, step_v, down), u, v,
                               Shutter(1, 1, 2), anchor="surface")
    beam = beam_around(origins, directions, dxdu, dxdv, domegadu, domegadv)       # rays known by their columns only
    found = finite_differences([water, floor], beam, zeros, zeros, shutter)
    found.dxdu, found.dxdv, found.dxdt, found.domegadt, found.dxdt_relative, found.errors

A scene of the renderer as a scene of the oracle (:mod:`.description`)::

    surfaces = surfaces_of(scene_at_shutter)           # moves linearly through the shutter, as USD interpolates

Closed forms of optics and of moving optics (:mod:`.closed_forms`)::

    interface_displacement(speed=0.1, theta_i=0.5, n_i=1.0, n_t=1.33)

The caustic of a travelling sinusoid, exactly averaged over pixel columns and time (:mod:`.caustic_1d`)::

    irradiance_average(np.linspace(0, 1.3, 65), Wave(), open=0, close=1, times=64, motion="smooth")      # [64]

Footprint kernels by brute-force quadrature (:mod:`.kernels`)::

    footprint_weight("epanechnikov", "shutter", offsets, dxdu, dxdv, dxdt)                     # [n], 1/area
"""

from .caustic_1d import Wave, irradiance, irradiance_average
from .description import surfaces_of
from .differences import Differentials, finite_differences
from .emission import beam_around, central_beam, parallel_beam
from .kernels import footprint_weight, shutter_kernel, static_kernel, swept_kernel
from .surfaces import Ellipsoid, HeightField, Plane, TriangleMesh
from .tracer import Path, trace

__all__ = [
    "Differentials",
    "Ellipsoid",
    "HeightField",
    "Path",
    "Plane",
    "TriangleMesh",
    "Wave",
    "beam_around",
    "central_beam",
    "finite_differences",
    "footprint_weight",
    "irradiance",
    "irradiance_average",
    "parallel_beam",
    "shutter_kernel",
    "static_kernel",
    "surfaces_of",
    "swept_kernel",
    "trace",
]
