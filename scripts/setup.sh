#!/usr/bin/env bash
# Installs tpdwarp, editable, into .venv in the repository root, with the extras named; quiet, and at once when
# nothing has changed. PYTHON names another interpreter than python3.
#
#     scripts/setup.sh          what rendering needs
#     scripts/setup.sh test     and what the tests need
set -euo pipefail

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
extra=${1:-}
venv=$root/.venv
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore

fail() {
    echo "error: $*" >&2
    exit 2
}

usable() {
    command -v "$1" >/dev/null && "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null
}

find_python() {
    if [ -n "${PYTHON:-}" ]; then
        usable "$PYTHON" || fail "PYTHON=$PYTHON is not a Python of version 3.11 or later"
        echo "$PYTHON"
        return
    fi
    local name
    for name in python3 python3.13 python3.12 python3.11; do
        if usable "$name"; then
            echo "$name"
            return
        fi
    done
    fail "there is no Python 3.11 or later (apt install python3 python3-venv)"
}

make_venv() {
    local python
    python=$(find_python)
    # Debian keeps ensurepip, without which a virtual environment has no pip, in a package of its own.
    if "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        "$python" -m venv --clear "$venv"
    elif "$python" -m virtualenv --version >/dev/null 2>&1; then
        "$python" -m virtualenv --quiet --clear "$venv"
    elif "$python" -m pip --version >/dev/null 2>&1 && "$python" -c 'import venv' 2>/dev/null; then
        "$python" -m venv --clear --without-pip "$venv"
        "$python" -m pip --python "$venv/bin/python" install --quiet pip
    elif [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        echo "Installing Debian's python3-venv, which $python lacks" >&2
        apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq python3-venv >/dev/null ||
            fail "$python can make no virtual environments (apt install python3-venv)"
        "$python" -m venv --clear "$venv"
    else
        fail "$python can make no virtual environments (apt install python3-venv)"
    fi
}

# A clone that was moved has its old folder's name all over its environment, so the folder counts as a change.
state=$(echo "$root"; cat "$root/pyproject.toml")
stamp=$venv/installed${extra:+-$extra}
# What is installed for an extra will do without it.
for present in "$stamp"*; do
    if [ -x "$venv/bin/python" ] && [ "$(cat "$present" 2>/dev/null)" = "$state" ]; then
        exit 0
    fi
done
if ! "$venv/bin/python" -m pip --version >/dev/null 2>&1; then
    make_venv
fi
echo "Installing tpdwarp${extra:+ and what it needs to $extra} into $venv" >&2
"$venv/bin/python" -m pip install --quiet --editable "$root${extra:+[$extra]}" ||
    fail "pip could not install tpdwarp (see above; rerun $0 to try again)"
echo "$state" > "$stamp"
