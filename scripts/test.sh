#!/usr/bin/env bash
# Lints the tree and runs the tests. Other arguments go to pytest (for instance: scripts/test.sh --quick -x -k refraction).
#
#     scripts/test.sh --quick     what takes less than a minute: algebra, kernels, footprints, reading, the order of the rooms
#     scripts/test.sh             all but what takes minutes a test
#     scripts/test.sh --long      all: also fuzzing, other processors, errors that were asked for, accumulated truths
set -euo pipefail

quick=(
    tests/footprints/test_gather.py
    tests/footprints/test_kernels.py
    tests/footprints/test_shaping.py
    tests/io
    tests/oracle/test_kernels.py
    tests/oracle/test_optics.py
    tests/photons/test_beam.py
    tests/photons/test_differentials.py
    tests/photons/test_record.py
    tests/scene/test_description.py
    tests/scene/test_normalization.py
    tests/scene/test_requirements.py
    tests/test_house.py
    tests/test_presets.py
    tests/usd/read
    --ignore=tests/usd/read/test_dialects.py
    --ignore=tests/usd/read/test_layer_limits.py
    tests/view/test_camera.py
    tests/view/test_sampling.py
)
chosen=(-m "not slow")
case ${1:-} in
--quick)
    chosen+=("${quick[@]}")
    shift
    ;;
--long)
    chosen=()
    shift
    ;;
esac

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
"$root/scripts/setup.sh" test
cd "$root"
.venv/bin/python -m ruff check
# Files share fixtures and kernels, so each is run by one process. (-n 0 runs all in this one.)
exec .venv/bin/python -m pytest -n 2 --dist loadfile ${chosen[@]+"${chosen[@]}"} "$@"
