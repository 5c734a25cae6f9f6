"""Dome lights: their picture and how they are turned."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom, UsdLux

from tpdwarp.errors import InputError
from tpdwarp.scene.description import DomeAtShutter, Shutter
from tpdwarp.usd.read.coordinate_frames import frame_over
from tpdwarp.usd.read.dome_layouts import as_latlong, layout_of
from tpdwarp.usd.read.lights import Light
from tpdwarp.usd.read.materials.textures import picture_of
from tpdwarp.usd.read.numbered_files import file_at
from tpdwarp.usd.read.values import text_at

KINDS = (UsdLux.DomeLight, UsdLux.DomeLight_1)
# Pictures are brought down to so many rows. Chosen, not derived: .35°, which is finer than the sun.
MOST_ROWS = 512
# Rows of a dome without a picture.
PLAIN_ROWS = 32
# From axes whose pole is y to those whose pole is z.
TO_Z_POLE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def is_dome(prim: Usd.Prim) -> bool:
    """Whether a prim is a dome light."""
    return any(prim.IsA(kind) for kind in KINDS)


class Dome(Light):
    """A dome light; its :meth:`power` is the radiance that its picture is multiplied by.

    The pole of a DomeLight is its y axis; that of a DomeLight_1 is as it says, by default the stage's up axis.
    """

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)
        self._last: DomeAtShutter | None = None
        self._laid_out: dict[tuple[str, str], np.ndarray | None] = {}
        self._last_of: tuple[object, ...] = ()
        if self.links.limited:
            self._warnings(self.path, "light linking of a dome is ignored: it shines on everything")
        if self.prim.GetRelationship("portals").GetTargets():
            self._warnings(self.path, "the portals of a dome are not used: it is sampled as a whole")

    @property
    def kind_name(self) -> str:
        return "dome"

    def at(self, shutter: Shutter) -> DomeAtShutter | None:
        """The dome over ``shutter``, as it stands in the middle; None where it is invisible, dark or, which is said, is
        turned by no finite transform.
        """
        power = self._mean_power(shutter)
        if not any(power):
            return None
        try:
            _, axes, _, turns = frame_over(self.prim, shutter, self._transforms, self._animation, self._warnings)
        except InputError as error:
            self._leave_out(error)
            return None
        if np.any(turns):
            self._warnings(self.path, "a dome that turns is held at mid shutter")
        picture = self._picture(shutter.frame)
        # The same dome is the same object, whose directions need not be chosen again.
        made_of = power, axes.tobytes(), id(picture)
        if made_of != self._last_of:
            plain = np.ones((PLAIN_ROWS, 2 * PLAIN_ROWS, 3))
            radiance = np.asarray((plain if picture is None else picture) * power, np.float32)
            self._last, self._last_of = DomeAtShutter(self.path, radiance, self._pole() @ axes), made_of
        return self._last

    def _factor(self, frame: float) -> float:
        return 1.0

    def _pole(self) -> np.ndarray:
        axis = self.prim.GetAttribute("poleAxis")
        pole = text_at(axis) if axis else "Y"
        if pole == "scene":
            pole = str(UsdGeom.GetStageUpAxis(self.prim.GetStage()))
        return TO_Z_POLE if pole == "Z" else np.eye(3)

    def _picture(self, frame: float) -> np.ndarray | None:
        """The dome's picture, shape [h, w, 3]; None for a dome of one colour."""
        attribute = self._input("texture:file")
        path = file_at(attribute, frame)
        if not path:
            return None
        named = text_at(self._input("texture:format"), frame) or ""
        if (path, named) not in self._laid_out:
            self._laid_out = {(path, named): self._read(path, named)}
        return self._laid_out[path, named]

    def _read(self, path: str, named: str) -> np.ndarray | None:
        """A picture by latitude and longitude; None where it cannot be read, which is said."""
        picture = picture_of(path, MOST_ROWS)
        if picture is None:
            self._warnings(f"{self.path}.inputs:texture:file", "cannot be read: the dome has one colour")
            return None
        layout = layout_of(named, picture)
        if layout == "latlong":
            return picture
        # Half as many rows are left of it.
        found = as_latlong(picture_of(path, 2 * MOST_ROWS), layout)
        if found is None:
            self._warnings(self.path, f"a picture laid out as {layout} is not read: the dome has one colour")
        return found
