#!/usr/bin/env bash
# Installs the Debian packages that some tests use when they find them. Nothing depends on them:
# where they cannot be installed this says so, and those tests skip.
set -uo pipefail

# package -> the program it brings
declare -A program=(
    [chromium]=chromium [calculix-ccx]=ccx [postgresql]=postgres [octave]=octave-cli [valgrind]=valgrind
)
# package -> the shared library it brings, which the reader of solids (gmsh) loads
declare -A library=(
    [libglu1-mesa]=libGLU.so.1 [libxcursor1]=libXcursor.so.1 [libxft2]=libXft.so.2
    [libxinerama1]=libXinerama.so.1
)
# Debian keeps the programs of a server of PostgreSQL out of the search path, by version.
for folder in /usr/lib/postgresql/*/bin; do
    [[ -d $folder ]] && PATH=$PATH:$folder
done
missing=()
for package in "${!program[@]}"; do
    command -v "${program[$package]}" >/dev/null || missing+=("$package")
done
known=$(ldconfig -p 2>/dev/null || true)
for package in "${!library[@]}"; do
    [[ $known == *"${library[$package]}"* ]] || missing+=("$package")
done
[[ ${#missing[@]} -eq 0 ]] && exit 0

skip() {
    echo "debian-packages: ${missing[*]} not installed ($1); tests that use it will skip"
    exit 0
}
command -v apt-get >/dev/null || skip "no apt-get here"
[[ $(id -u) -eq 0 ]] || skip "not root"
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
trap 'rm -f "$log"' EXIT
{ apt-get update && apt-get install --yes --no-install-recommends "${missing[@]}"; } \
    >"$log" 2>&1 </dev/null || { tail -n 3 "$log"; skip "apt-get failed"; }
echo "debian-packages: installed ${missing[*]}"
