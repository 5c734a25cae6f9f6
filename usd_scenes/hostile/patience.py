"""When a process that works on a case hangs, on a machine however busy."""

from __future__ import annotations

import os
from pathlib import Path

# Part of the processor that what does something takes at least.
LEAST_WORK = 0.01


class Patience:
    """Waits for a process by what it takes of processors, and not by the clock, which a busy machine makes run away.

    Args:
        process: Its number.
        seconds: Of processor time that it may take before it is done.
    """

    def __init__(self, process: int, seconds: float) -> None:
        self.seconds, self._process = seconds, process
        self.renew()

    def renew(self) -> None:
        """Begins anew: something is done."""
        self._began = self._looked = processor_seconds(self._process)

    def ended(self) -> bool:
        """Whether it hangs, asked after each ``seconds`` by the clock in which it has not ended.

        It has taken all that it may, or next to nothing since this was asked before.
        """
        spent = processor_seconds(self._process)
        worked = spent - self._looked > LEAST_WORK * self.seconds
        self._looked = spent
        return not worked or spent - self._began >= self.seconds


def processor_seconds(process: int) -> float:
    """What a process has taken of processors; 0 where it is gone, or the system does not say."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
