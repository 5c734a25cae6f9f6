"""A word on frames that show nothing, once for a sequence."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tpdwarp.errors import logger
from tpdwarp.io.frame_names import frame_text


class DarkWatch:
    """Looks at each frame's picture.

    Args:
        file: The scene that is rendered.
    """

    def __init__(self, file: str) -> None:
        self._file, self._warned = file, False

    def __call__(self, frame: float, channels: Mapping[str, np.ndarray]) -> None:
        """Warns at the first frame that is black all over: because nothing is in view, or because it is not lit."""
        if self._warned or any(channels[name].any() for name in "RGB"):
            return
        self._warned = True
        seen = channels["A"].any()
        why = "no light reaches what is in view (add lights, or a dome that mirrors show)"
        if not seen:
            why = "nothing is in view (choose another camera, or none for one that frames the stage)"
        logger.warning(f"{self._file}: frame {frame_text(frame)} is black: {why}")
