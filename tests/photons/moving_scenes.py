"""Small animated scenes, each with one thing to get right about light in motion."""

from __future__ import annotations

import numpy as np

from tpdwarp.scene.description import Material, MeshAtShutter, SceneAtShutter

from .shapes import (
    MIRROR,
    ball,
    cylinder,
    floor,
    glass,
    moving,
    prism,
    quad,
    ripples,
    turning,
    upside_down,
)
from .traced import lamp, scene_of, sun, turning_sun

GRID = np.linspace(-1, 1, 25)


def walls() -> list[MeshAtShutter]:
    """A floor and four walls, open at the top."""
    sides = [((3, 0, 3), (0, 3, 0), (0, 0, 3)), ((0, 3, 3), (0, 0, 3), (3, 0, 0))]
    made = [floor(half=3.0)]
    for number, (centre, u, v) in enumerate(sides):
        made.append(upside_down(quad(f"/wall{number}", centre, u, v, floor().materials[0])))
        made.append(quad(f"/wall{number + 2}", tuple(-c if c == max(centre[:2]) else c for c in centre), u, v,
                         floor().materials[0]))
    return made


def wave(smooth: bool, *lights) -> SceneAtShutter:
    water = ripples(GRID, GRID, 1.0, 0.04, glass(1.33), smooth)
    return scene_of([water, floor()], *(lights or (sun((0.2, 0.1, -1)),)))


def turning_prism() -> SceneAtShutter:
    body = turning(prism("/prism", (0.1, 0, 1), 0.5, 0.8, glass()), (0.1, 1, 0.2), 0.15, (0, 0, 1))
    return scene_of([body, *walls()], sun((0.3, 0.05, -1)))


def turning_cylinder() -> SceneAtShutter:
    body = turning(cylinder("/cylinder", (0, 0, 1), 0.4, 0.9, 48, glass()), (0.3, 0.1, 1), 0.12, (0.2, 0, 1))
    ground = [moving(wall, (0.02, 0.01, 0.03)) for wall in walls()]
    return scene_of([body, *ground], sun())


def flying_ball(material: Material, *, cells: int = 10, smooth: bool = True) -> SceneAtShutter:
    body = moving(ball("/ball", (0, 0, 1.2), 0.5, cells, material, smooth), (0.12, -0.05, 0.08))
    return scene_of([body, *walls()], sun())


def mirrors_in_a_row() -> SceneAtShutter:
    first = turning(ball("/ball", (0, 0, 1.2), 0.5, 10, MIRROR), (1, 0.3, 0), 0.1, (0, 0, 1.8))
    plate = quad("/plate", (1.6, 0, 1.6), (0, 0.8, 0), (-0.3, 0, 1.2), MIRROR)
    return scene_of([first, turning(plate, (0, 1, 0.2), -0.08, (1.6, 0, 0)), *walls()], sun())


def several_in_a_row() -> SceneAtShutter:
    water = ripples(GRID, GRID, 2.0, 0.03, glass(1.33), True)
    body = turning(ball("/ball", (0, 0, 1.1), 0.45, 10, glass()), (0, 0.4, 1), 0.2, (0.3, 0, 1.1))
    ground = turning(floor(half=3.0), (1, 0.5, 0), 0.06, (0.5, 0, 0))
    return scene_of([water, body, ground], sun((0.05, 0.1, -1)))


def moving_receiver() -> SceneAtShutter:
    ground = turning(floor(half=3.0), (1, 0.5, 0.3), 0.08, (0.5, 0.2, -0.3))
    return scene_of([ripples(GRID, GRID, 1.0, 0.04, glass(1.33), True), ground], sun((0.2, 0.1, -1)))


SCENES = {
    "smooth water": lambda: wave(True),
    "faceted water": lambda: wave(False),
    "a turning prism": turning_prism,
    "a turning cylinder": turning_cylinder,
    "a flying glass ball": lambda: flying_ball(glass()),
    "a flying faceted ball": lambda: flying_ball(glass(), smooth=False),
    "a flying mirror ball": lambda: flying_ball(MIRROR),
    "two moving mirrors": mirrors_in_a_row,
    "water, a glass ball and a turning floor": several_in_a_row,
    "a moving lamp over water": lambda: wave(True, lamp((0.3, 0.1, 3), (0.15, -0.1, 0.2))),
    "a turning sun over water": lambda: wave(True, turning_sun((0.2, 0.1, -1), (0.3, 0.05, -1))),
    "a moving receiver": moving_receiver,
}
