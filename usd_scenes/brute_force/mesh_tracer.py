"""Plain photons in double precision through moving triangles: both Fresnel branches, no differentials.

Each photon has a time of its own. Kernels run as one thread that loops over its photons, so that one stack of pending
branches and plain sums serve; threads each launch their own (the call releases Python's lock).
"""

from __future__ import annotations

import numpy as np
import warp as wp

from .bvh import Geometry, Hit, Surfaces, first_hit, geometric_normal, shading_normal
from .description import DIFFUSE, MIRROR, Camera, Light, Scene, between
from .emission import ONE, ZERO, Emission, Pending, emission_of, first_ray
from .sobol import direction_numbers

wp.config.log_level = wp.LOG_WARNING

# What still goes round after so many is counted as lost. Interpolated normals trap light, because they do not undo on
# leaving what they did on entering: .00014 of it in a ball and .0016 in a torus, with 1024 surfaces as with 128.
MOST_SURFACES = wp.constant(128)
# Each surface puts one branch aside, and one is followed.
STACK = 144
# A branch that carries less than this share of its photon goes on by roulette, with this share. Glass sends some .08 of
# the light such ways, so that roulette adds .008 of the variance of counting whole photons, and halves the rays.
ROULETTE = wp.constant(wp.float64(0.1))
FAR = wp.constant(wp.float64(1.0e6))

# Rows of the account before one a mesh: flux that meets something specular first; that never does (direct light, and
# what passes by); that leaves the scene afterwards; taken by mirrors; given up; put in (or taken out) by roulette.
SENT, DIRECT, ESCAPED, ABSORBED, LOST, ROULETTE_GAIN, RAYS, MESHES = range(8)


@wp.struct
class View:
    """The camera: eye at the opening of the shutter and its ``motion`` until it closes; ``right`` and ``up`` over the
    side of a pixel, ``forward`` unit, pixels, a pixel's area; whether the view is ``clear``."""

    eye: wp.vec3d
    motion: wp.vec3d
    right: wp.vec3d
    up: wp.vec3d
    forward: wp.vec3d
    width: wp.int32
    height: wp.int32
    pixel_area: wp.float64
    clear: wp.int32


@wp.func
def reflectance(cos_i: wp.float64, cos_t: wp.float64, eta: wp.float64) -> wp.float64:
    """Fresnel reflectance of unpolarised light, ``eta`` being the index before over that behind."""
    across = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    along = (eta * cos_t - cos_i) / (eta * cos_t + cos_i)
    return wp.float64(0.5) * (across * across + along * along)


@wp.func
def reflected(w: wp.vec3d, n: wp.vec3d) -> wp.vec3d:
    return wp.normalize(w - wp.float64(2.0) * wp.dot(w, n) * n)


@wp.func
def cos_refracted(cos_i: wp.float64, eta: wp.float64) -> wp.float64:
    """Cosine of refraction; negative where light is totally reflected."""
    square = ONE - eta * eta * (ONE - cos_i * cos_i)
    if square <= ZERO:
        return -ONE
    return wp.sqrt(square)


@wp.func
def refracted(w: wp.vec3d, n: wp.vec3d, cos_t: wp.float64, eta: wp.float64) -> wp.vec3d:
    return wp.normalize(eta * (w - wp.dot(w, n) * n) - cos_t * n)


@wp.func
def interaction_normal(w: wp.vec3d, facing: wp.vec3d, shading: wp.vec3d, eta: wp.float64, mirror: bool) -> wp.vec3d:
    """The shading normal, or the geometric one where a branch would leave on the wrong side of the triangle.

    Both normals are turned by the side of the triangle that is met, so that ``facing`` is against the ray.
    """
    cos_i = -wp.dot(w, shading)
    if cos_i <= ZERO:
        return facing
    if wp.dot(reflected(w, shading), facing) <= ZERO:
        return facing
    if not mirror:
        cos_t = cos_refracted(cos_i, eta)
        if cos_t > ZERO:
            if wp.dot(refracted(w, shading, cos_t, eta), facing) >= ZERO:
                return facing
    return shading


@wp.func
def deposit(
    surfaces: Surfaces,
    view: View,
    hit: Hit,
    x: wp.vec3d,
    ray: Pending,
    picture: wp.array2d(dtype=wp.float64),
):
    """Adds a photon's share of the mean irradiance of the pixel that sees where it landed, if one does.

    A pixel of area A sees A / |n·v| of the surface, so that its mean irradiance is Σ Φ |n·v| / A; with interpolated
    normals irradiance goes by |ω·n_s| in place of |ω·n_g|.
    """
    offset = x - view.eye - ray.s * view.motion
    column = wp.int32(wp.floor(wp.dot(offset, view.right) + wp.float64(0.5) * wp.float64(view.width)))
    row = wp.int32(wp.floor(wp.float64(0.5) * wp.float64(view.height) - wp.dot(offset, view.up)))
    depth = wp.dot(offset, view.forward)
    if depth > ZERO and column >= 0 and column < view.width and row >= 0 and row < view.height:
        n_g = geometric_normal(surfaces, hit.triangle, ray.s)
        seen = wp.dot(n_g, view.forward)
        lit = wp.dot(n_g, ray.w)
        visible = seen * lit > ZERO
        if visible and view.clear == 0:
            visible = first_hit(surfaces, x, -view.forward, ray.s, hit.triangle, depth).triangle < 0
        if visible:
            weight = wp.abs(wp.dot(shading_normal(surfaces, hit, ray.s, n_g), ray.w) / lit * seen)
            picture[row, column] = picture[row, column] + ray.flux * weight / view.pixel_area


@wp.func
def put_aside(
    stack: wp.array(dtype=Pending),
    pending: int,
    branch: Pending,
    faintest: wp.float64,
    random: wp.uint32,
    account: wp.array(dtype=wp.float64),
) -> int:
    """Puts a branch on the stack, by roulette if it is fainter than ``faintest``; how many lie there then."""
    if branch.flux < faintest:
        before = branch.flux
        branch.flux = ZERO
        if wp.float64(wp.randf(random)) * faintest < before:
            branch.flux = faintest
        account[ROULETTE_GAIN] = account[ROULETTE_GAIN] + branch.flux - before
    if branch.flux > ZERO:
        stack[pending] = branch
        return pending + 1
    return pending


@wp.func
def scatter(
    surfaces: Surfaces,
    ray: Pending,
    hit: Hit,
    x: wp.vec3d,
    mesh: int,
    stack: wp.array(dtype=Pending),
    pending: int,
    faintest: wp.float64,
    random: wp.uint32,
    account: wp.array(dtype=wp.float64),
) -> int:
    """Puts the branches that leave a specular surface at ``x`` on the stack; how many lie there then."""
    mirror = surfaces.interaction[mesh] == MIRROR
    n_g = geometric_normal(surfaces, hit.triangle, ray.s)
    n_s = shading_normal(surfaces, hit, ray.s, n_g)
    eta = ONE / surfaces.ior[mesh]
    if wp.dot(ray.w, n_g) > ZERO:
        n_g = -n_g
        n_s = -n_s
        eta = surfaces.ior[mesh]
    n = interaction_normal(ray.w, n_g, n_s, eta, mirror)
    cos_i = -wp.dot(ray.w, n)
    cos_t = cos_refracted(cos_i, eta)
    back = Pending()
    back.x = x
    back.w = reflected(ray.w, n)
    back.s = ray.s
    back.left = hit.triangle
    back.surfaces = ray.surfaces + 1
    if mirror:
        back.flux = ray.flux * surfaces.tint[mesh]
        account[ABSORBED] = account[ABSORBED] + ray.flux - back.flux
        return put_aside(stack, pending, back, faintest, random, account)
    back.flux = ray.flux
    if cos_t < ZERO:
        return put_aside(stack, pending, back, faintest, random, account)
    back.flux = ray.flux * reflectance(cos_i, cos_t, eta)
    through = Pending()
    through.x = x
    through.w = refracted(ray.w, n, cos_t, eta)
    through.s = ray.s
    through.left = hit.triangle
    through.surfaces = ray.surfaces + 1
    through.flux = ray.flux - back.flux
    reflections = put_aside(stack, pending, back, faintest, random, account)
    return put_aside(stack, reflections, through, faintest, random, account)


@wp.kernel(enable_backward=False)
def trace(
    surfaces: Surfaces,
    emission: Emission,
    view: View,
    directions: wp.array2d(dtype=wp.uint32),
    count: int,
    stack: wp.array(dtype=Pending),
    picture: wp.array2d(dtype=wp.float64),
    account: wp.array(dtype=wp.float64),
):
    """Sends ``count`` photons of one light and follows each until all of its flux has gone somewhere."""
    random = wp.rand_init(emission.seed, 3)
    for photon in range(count):
        ray = first_ray(emission, directions, photon)
        faintest = ROULETTE * ray.flux
        stack[0] = ray
        pending = wp.int32(1)
        if ray.flux <= ZERO:
            pending = 0
        while pending > 0:
            pending -= 1
            ray = stack[pending]
            account[RAYS] = account[RAYS] + ONE
            hit = first_hit(surfaces, ray.x, ray.w, ray.s, ray.left, FAR)
            mesh = wp.int32(-1)
            kind = wp.int32(-1)
            if hit.triangle >= 0:
                mesh = surfaces.mesh_of[hit.triangle]
                kind = surfaces.interaction[mesh]
            x = ray.x + hit.distance * ray.w
            if ray.surfaces == 0:
                if mesh < 0 or kind == DIFFUSE:
                    account[DIRECT] = account[DIRECT] + ray.flux
                else:
                    account[SENT] = account[SENT] + ray.flux
            elif mesh < 0:
                account[ESCAPED] = account[ESCAPED] + ray.flux
            elif kind == DIFFUSE:
                account[MESHES + mesh] = account[MESHES + mesh] + ray.flux
                deposit(surfaces, view, hit, x, ray, picture)
            if kind > DIFFUSE:
                if ray.surfaces < MOST_SURFACES and pending + 2 <= stack.shape[0]:
                    # The state of the random numbers is copied into functions; each draw of the photon needs its own.
                    draw = wp.rand_init(wp.randi(random), photon)
                    pending = scatter(surfaces, ray, hit, x, mesh, stack, pending, faintest, draw, account)
                else:
                    account[LOST] = account[LOST] + ray.flux


@wp.kernel(enable_backward=False)
def look(
    surfaces: Surfaces,
    view: View,
    s: wp.float64,
    across: int,
    seen: wp.array2d(dtype=wp.int32),
):
    """Marks the diffuse mesh that all ``across``² rays of each pixel see first; −2 where they differ or see another.

    ``seen`` is −1 before the first look, and kept over looks at other instants.
    """
    eye = view.eye + s * view.motion
    for row in range(view.height):
        for column in range(view.width):
            step = ONE / wp.float64(across)
            # Sides of a pixel, as lengths.
            side = wp.sqrt(view.pixel_area)
            right = view.right * (side * side)
            up = view.up * (side * side)
            for sample in range(across * across):
                a = wp.float64(column) + (wp.float64(sample % across) + wp.float64(0.5)) * step
                b = wp.float64(row) + (wp.float64(sample // across) + wp.float64(0.5)) * step
                a -= wp.float64(0.5) * wp.float64(view.width)
                b = wp.float64(0.5) * wp.float64(view.height) - b
                hit = first_hit(surfaces, eye + a * right + b * up, view.forward, s, -1, FAR)
                mesh = wp.int32(-2)
                if hit.triangle >= 0:
                    mesh = surfaces.mesh_of[hit.triangle]
                    if surfaces.interaction[mesh] != DIFFUSE:
                        mesh = -2
                if seen[row, column] == -1:
                    seen[row, column] = mesh
                elif seen[row, column] != mesh:
                    seen[row, column] = -2


def _view_of(camera: Camera, clear: bool) -> View:
    view = View()
    eye = between(camera.position, 0.0)
    view.eye = wp.vec3d(*eye)
    view.motion = wp.vec3d(*(between(camera.position, 1.0) - eye))
    view.right = wp.vec3d(*(camera.axes[0] / camera.pixel))
    view.up = wp.vec3d(*(camera.axes[1] / camera.pixel))
    view.forward = wp.vec3d(*(-camera.axes[2]))
    view.width, view.height = camera.width, camera.height
    view.pixel_area = camera.pixel**2
    view.clear = int(clear)
    return view


class Tracer:
    """Traces photons of a scene over one part of the shutter after another and sums them; for use by one thread.

    Args:
        scene: What to trace.

    Attributes:
        picture: Σ Φ |n·v| |ω·n_s| / (|ω·n_g| A) of each pixel, shape [height, width]; irradiance times parts.
        account: Flux by ``SENT`` ... ``ROULETTE_GAIN``, rays, then flux on each mesh as a receiver; W times parts.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._view = _view_of(scene.camera, scene.view_is_clear)
        self._geometry = Geometry(scene.meshes)
        self._directions = wp.array(direction_numbers(), dtype=wp.uint32, device="cpu")
        self._stack = wp.zeros(STACK, dtype=Pending, device="cpu")
        self._part = (0.0, 1.0)
        self.picture = np.zeros((scene.camera.height, scene.camera.width))
        self.account = np.zeros(MESHES + len(scene.meshes))
        self._sums = [
            wp.array(values, dtype=wp.float64, device="cpu", copy=False) for values in (self.picture, self.account)
        ]

    def open(self, start: float, end: float) -> None:
        """Goes to the part of the shutter from ``start`` to ``end``, within 0 ... 1."""
        self._part = (start, end)
        self._geometry.open(start, end)

    def send(self, light: Light, count: int, seed: int) -> None:
        """Sends ``count`` photons of ``light``, along the sequence of ``seed``."""
        start, end = self._part
        emission = emission_of(light, self._scene.meshes, start, end, count, seed)
        inputs = [self._geometry.surfaces, emission, self._view, self._directions, count, self._stack, *self._sums]
        wp.launch(trace, dim=1, inputs=inputs, device="cpu")

    def look(self, s: float, seen: np.ndarray, across: int) -> None:
        """Marks which diffuse mesh each pixel sees at time ``s`` in ``seen`` [height, width] int32 (see ``look``)."""
        self.open(s, s)
        shared = wp.array(seen, dtype=wp.int32, device="cpu", copy=False)
        wp.launch(look, dim=1, inputs=[self._geometry.surfaces, self._view, s, across, shared], device="cpu")


def load() -> None:
    """Compiles the kernels, which threads must find compiled."""
    wp.load_module(device="cpu")
