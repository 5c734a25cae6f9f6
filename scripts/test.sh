#!/usr/bin/env bash
# Lints the tree and runs all tests; arguments go to pytest (for instance: scripts/test.sh -m "not slow" -x).
set -euo pipefail

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
"$root/scripts/setup.sh" test
cd "$root"
.venv/bin/python -m ruff check
exec .venv/bin/python -m pytest "$@"
