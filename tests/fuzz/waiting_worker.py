"""A process that waits, works for ever, or works now and then and ends."""

import sys
import time

WAITS, WORKS, ENDS = range(3)


def main(kind: int) -> None:
    until = time.monotonic() + (60.0 if kind != ENDS else 3.0)
    while time.monotonic() < until:
        if kind != WORKS:
            time.sleep(0.05)
        if kind != WAITS:
            work = time.process_time() + 0.01
            while time.process_time() < work:
                pass


if __name__ == "__main__":
    main(int(sys.argv[1]))
