"""A worker for the campaign whose one case waits, works for ever, or works now and then and ends."""

import json
import sys
import time

WAITS, WORKS, ENDS = range(3)


def main(kind: int) -> None:
    told = {"seed": kind, "changes": [], "arguments": []}
    print(json.dumps(told), flush=True)
    until = time.monotonic() + (60.0 if kind != ENDS else 2.0)
    while time.monotonic() < until:
        if kind != WORKS:
            time.sleep(0.05)
        if kind != WAITS:
            work = time.process_time() + 0.01
            while time.process_time() < work:
                pass
    print(json.dumps(told | {"code": 0, "faults": [], "errors": ""}), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
