"""Whether a process may have the memory without which libraries crash."""

from __future__ import annotations

import sys

from tpdwarp.errors import InputError

# Libraries with two threads reserve 1.9 GB before the first photon (they ran with 2.1 GB and crashed with 1.8).
LEAST_ADDRESS_SPACE = 2 << 30


def check_address_space() -> None:
    """Refuses a limit on addresses in which libraries end the process without a word.

    Raises:
        InputError: That is so.
    """
    if sys.platform == "win32":
        return
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < LEAST_ADDRESS_SPACE:
        raise InputError(f"{limit / 2**30:.1f} GB of address space are too few (allow 2 GB or more: ulimit -v)")
