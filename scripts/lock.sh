#!/usr/bin/env bash
# Writes the two requirement locks: exact versions and hashes, one version of each package for
# Python 3.11 to 3.14 on every platform. Which index serves them is the machine's own setting.
# Usage: scripts/lock.sh [--upgrade] [--upgrade-package NAME]
set -euo pipefail
cd "$(dirname "$0")/.."

# A local folder of wheels would put its own files, or its path, into the lock.
unset PIP_FIND_LINKS UV_FIND_LINKS
export UV_NO_CONFIG=1

python="${PYTHON:-python3}"
if [[ ! -x .venv-lock/bin/uv ]]; then
    "$python" -m venv .venv-lock
    .venv-lock/bin/python -m pip install --quiet "uv==0.13.9"
fi

compile() {
    local output=$1
    shift
    .venv-lock/bin/uv pip compile pyproject.toml --group build "$@" \
        --universal --python-version 3.11 --fork-strategy fewest --generate-hashes \
        --no-emit-index-url --no-emit-find-links --no-header --no-annotate --quiet \
        --output-file "$output" >/dev/null
    if grep -nE ':/{2}|^-' "$output"; then
        echo "$output: an address or an option has come into the lock" >&2
        exit 1
    fi
}

compile requirements/dev.txt --extra dev --extra docs --extra explore --extra verify --extra web "${@}"
# The main lock takes its versions from the development lock, so the two never disagree.
compile requirements/main.txt --constraint requirements/dev.txt "${@}"
