"""Camera rays with their time column, and how large a pixel is on a surface."""

from __future__ import annotations

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.beam import Beam
from tpdwarp.scene.description import CameraAtShutter
from tpdwarp.scene.normalization import Normalization
from tpdwarp.view.sampling import part_count


@wp.struct
class Camera:
    """A camera in the tracer's units; motions are over the whole shutter. ``planes`` clip, in the camera's frame."""

    orthographic: int
    position: wp.vec3
    right: wp.vec3
    up: wp.vec3
    back: wp.vec3
    position_motion: wp.vec3
    right_motion: wp.vec3
    up_motion: wp.vec3
    back_motion: wp.vec3
    corner: wp.vec2
    pixel: wp.vec2
    near: float
    far: float
    lens_radius: float
    focus_distance: float
    planes: wp.array(dtype=wp.vec4)


def camera_of(
    camera: CameraAtShutter, width: int, height: int, normalization: Normalization, launcher: Launcher | None = None
) -> Camera:
    """The kernel's view of ``camera`` for an image of ``width`` × ``height`` pixels.

    Args:
        launcher: The device, for rays; without, the camera has no clipping planes.
    """
    scale = normalization.scale
    unit = scale if camera.orthographic else 1.0
    left, right, bottom, top = (unit * edge for edge in camera.window)
    out = Camera()
    out.orthographic = int(camera.orthographic)
    out.position = wp.vec3(*normalization.points(camera.position[None])[0].astype(float))
    out.right, out.up, out.back = (wp.vec3(*axis) for axis in camera.axes)
    out.position_motion = wp.vec3(*(camera.position_motion * scale))
    out.right_motion, out.up_motion, out.back_motion = (wp.vec3(*axis) for axis in camera.axes_motion)
    out.corner = wp.vec2(left, top)
    out.pixel = wp.vec2((right - left) / width, (top - bottom) / height)
    out.near, out.far = camera.near * scale, min(camera.far * scale, 1.0e6)
    out.lens_radius, out.focus_distance = camera.lens_radius * scale, camera.focus_distance * scale
    if launcher is not None and len(camera.clipping_planes):
        planes = camera.clipping_planes * (1.0, 1.0, 1.0, scale)
        out.planes = launcher.array(planes.astype(np.float32), wp.vec4)
    return out


def pixel_size(camera: Camera | None, samples: int) -> PixelSize:
    """What a query stands for: a pixel, or with many samples a part of it; nothing where nothing looks.

    Averaged over the parallelogram that it sees on a plane, light there is that of the pixel, however few samples look
    at it. Through glass that parallelogram is assumed to be what it would be without.
    """
    size = PixelSize()
    if camera is not None:
        parts = float(part_count(samples))
        size.eye, size.back, size.orthographic = camera.position, wp.normalize(camera.back), camera.orthographic
        size.right = wp.normalize(camera.right) * (camera.pixel[0] / parts)
        size.up = wp.normalize(camera.up) * (camera.pixel[1] / parts)
    return size


@wp.func
def in_sides(size: PixelSize, x: wp.vec3, displacement: wp.vec3) -> wp.vec2:
    """A displacement from x on a surface, along rows and columns of the image, in sides of what queries stand for."""
    view = -size.back
    depth = float(1.0)
    w = view
    if size.orthographic == 0:
        depth = wp.abs(wp.dot(x - size.eye, view))
        w = wp.normalize(x - size.eye)
    # Seen along the view, a displacement in the plane of the image has the same place.
    flat = displacement - w * (wp.dot(displacement, view) / wp.max(wp.abs(wp.dot(w, view)), 1.0e-30))
    return wp.vec2(
        wp.dot(flat, size.right) / (depth * wp.length_sq(size.right)),
        wp.dot(flat, size.up) / (depth * wp.length_sq(size.up)),
    )


@wp.func
def camera_ray(camera: Camera, film: wp.vec2, time: float) -> Beam:
    """The beam through ``film`` (pixels, from the upper left) at ``time`` in the shutter (−½ … ½)."""
    beam = Beam()
    x = camera.corner[0] + film[0] * camera.pixel[0]
    y = camera.corner[1] - film[1] * camera.pixel[1]
    right = wp.normalize(camera.right + time * camera.right_motion)
    up = wp.normalize(camera.up + time * camera.up_motion)
    back = wp.normalize(camera.back + time * camera.back_motion)
    right_rate = _axis_rate(camera.right, camera.right_motion, time)
    up_rate = _axis_rate(camera.up, camera.up_motion, time)
    back_rate = _axis_rate(camera.back, camera.back_motion, time)
    beam.x = camera.position + time * camera.position_motion
    beam.dxdt = camera.position_motion
    if camera.orthographic == 1:
        beam.x += x * right + y * up
        beam.dxdt += x * right_rate + y * up_rate
        beam.w = -back
        beam.dwdt = -back_rate
    else:
        d = x * right + y * up - back
        length = wp.length(d)
        beam.w = d / length
        rate = (x * right_rate + y * up_rate - back_rate) / length
        beam.dwdt = rate - beam.w * wp.dot(beam.w, rate)
    return beam


@wp.func
def through_lens(camera: Camera, beam: Beam, time: float, radius: float, angle: float) -> Beam:
    """The beam of :func:`camera_ray` through another point of a thin lens, to the same point in its plane of focus.

    Args:
        radius, angle: Where on the lens, in its radius and from its right [rad].
    """
    out = beam
    right = wp.normalize(camera.right + time * camera.right_motion)
    up = wp.normalize(camera.up + time * camera.up_motion)
    back = wp.normalize(camera.back + time * camera.back_motion)
    place = camera.lens_radius * radius * (wp.cos(angle) * right + wp.sin(angle) * up)
    reach = -camera.focus_distance / wp.dot(beam.w, back)
    d = reach * beam.w - place
    length = wp.length(d)
    out.x = beam.x + place
    out.w = d / length
    # What is sharp moves as it does through the middle of the lens.
    rate = (reach / length) * beam.dwdt
    out.dwdt = rate - out.w * wp.dot(out.w, rate)
    return out


@wp.func
def kept_by_planes(camera: Camera, x: wp.vec3, w: wp.vec3, time: float, start: float, end: float) -> wp.vec2:
    """The part of [start, end] along x + λω that no clipping plane cuts off; its end lies before its start for none."""
    right = wp.normalize(camera.right + time * camera.right_motion)
    up = wp.normalize(camera.up + time * camera.up_motion)
    back = wp.normalize(camera.back + time * camera.back_motion)
    d = x - (camera.position + time * camera.position_motion)
    first = float(start)
    last = float(end)
    for k in range(camera.planes.shape[0]):
        plane = camera.planes[k]
        n = plane[0] * right + plane[1] * up + plane[2] * back
        height = wp.dot(n, d) + plane[3]
        slope = wp.dot(n, w)
        if slope > 0.0:
            first = wp.max(first, -height / slope)
        elif slope < 0.0:
            last = wp.min(last, -height / slope)
        elif height < 0.0:
            last = first - 1.0
    return wp.vec2(first, last)


@wp.func
def _axis_rate(axis: wp.vec3, motion: wp.vec3, time: float) -> wp.vec3:
    """Change over the shutter of the unit axis along ``axis + time · motion``."""
    now = axis + time * motion
    length = wp.length(now)
    unit = now / length
    return (motion - unit * wp.dot(unit, motion)) / length
