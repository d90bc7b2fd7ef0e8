#!/usr/bin/env bash
# set_up.sh [EXTRA]: makes this checkout runnable on a fresh Debian or Ubuntu machine.
#
# Compiler, Python headers, GL libraries and Xvfb (apt-get, only what is missing), a virtual
# environment in .venv, the package in it as an editable install with EXTRA (default: test).
# Stamps in .venv remember what was done, so a second run takes a fraction of a second.
# PYTHON=path chooses the interpreter for a new .venv.
set -euo pipefail
cd "$(dirname "$0")/.."
extra=${1:-test}
export PIP_DISABLE_PIP_VERSION_CHECK=1 DEBIAN_FRONTEND=noninteractive

say() { printf 'set-up: %s\n' "$*" >&2; }
die() { say "$*"; exit 1; }

# ---------------------------------------------------------------------------------- interpreter

usable() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }
venv_works() { usable .venv/bin/python && .venv/bin/python -c 'import pip' 2>/dev/null; }

has_headers() {
    "$1" -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))'
}

has_venv() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }

# Prints the interpreter to build with: one that lacks nothing, else one of the distribution, to
# which apt-get can add what it lacks. Version managers leave shims that fail: every one is tried.
find_python() {
    local name path fallback=
    for name in ${PYTHON:-python3.13 python3.12 python3.11 python3}; do
        for path in $(type -aP "$name"); do
            usable "$path" || continue
            if has_headers "$path" && has_venv "$path"; then
                echo "$path"
                return
            fi
            [[ $path != /usr/bin/* && $path != /bin/* ]] || fallback=${fallback:-$path}
        done
    done
    echo "$fallback"
}

# ------------------------------------------------------------------------------ system packages

as_root=()
can_install() {
    command -v apt-get >/dev/null || return 1
    [ "$(id -u)" -ne 0 ] || return 0
    command -v sudo >/dev/null || return 1
    [ -t 0 ] || sudo -n true 2>/dev/null || return 1
    as_root=(sudo)
}

lists_fresh=
apt_install() {
    if [ -z "$lists_fresh" ]; then
        "${as_root[@]}" apt-get update -qq || say "apt-get update failed; going on with old lists"
        lists_fresh=1
    fi
    "${as_root[@]}" apt-get install -qq -y --no-install-recommends "$@" >/dev/null
}

has_library() { grep -qF "$1" <<<"$libraries"; }
has_file() { compgen -G "$1" >/dev/null; }

# Sets `needed` (nothing works without) and `useful` (one back end, or its tests).
find_missing() {
    local libraries version
    libraries=$(PATH=$PATH:/sbin:/usr/sbin ldconfig -p)
    needed=() useful=()
    echo '#include <stdio.h>' | gcc -E - >/dev/null 2>&1 || needed+=(gcc libc6-dev)
    if [ -z "$python" ]; then
        needed+=(python3 python3-dev python3-venv)
    else
        version=$("$python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
        has_headers "$python" || needed+=("$version-dev")
        venv_works || has_venv "$python" || needed+=("$version-venv")
    fi
    has_library libEGL.so.1 || needed+=(libegl1)
    has_file '/usr/lib*/dri/swrast_dri.so' || has_file '/usr/lib/*/dri/swrast_dri.so' ||
        needed+=(libgl1-mesa-dri)
    has_library libOSMesa.so || useful+=(libosmesa6)
    has_library libglfw.so.3 || useful+=(libglfw3)
    command -v xvfb-run >/dev/null || useful+=(xvfb)
    command -v xauth >/dev/null || useful+=(xauth)
}

install_missing() {
    local package
    if [ ${#needed[@]} -gt 0 ]; then
        can_install || die "missing: ${needed[*]}. Install them (as root: apt-get install" \
            "${needed[*]} ${useful[*]}) and run this again; there is no apt-get, or no root or sudo here."
        say "installing ${needed[*]}"
        apt_install "${needed[@]}" || die "apt-get could not install ${needed[*]}"
    fi
    # What could not be had is remembered, so that it is not asked for on every run.
    [ "${useful[*]}" != "$(cat .venv/.csm-without 2>/dev/null)" ] || return 0
    for package in "${useful[@]}"; do
        if can_install && apt_install "$package" 2>/dev/null; then
            say "installed $package"
        else
            say "going on without $package: its back end and its tests are left out"
            without+=("$package")
        fi
    done
}

# -------------------------------------------------------------------------- environment, package

digest() { cat "$@" | sha256sum | cut -d' ' -f1; }
done_before() { [ "$(cat ".venv/.csm-$1" 2>/dev/null)" = "$2" ]; }

install_package() {
    local packages extension
    packages=$(digest pyproject.toml)
    # shellcheck disable=SC2046 # the names in csrc have no blanks
    extension=$(digest pyproject.toml setup.py $(find csrc -type f | sort))
    if ! done_before "packages-$extra" "$packages"; then
        say "installing Python packages into .venv (a few minutes the first time)"
        .venv/bin/python -c 'import tomllib
print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"], sep="\n")' |
            .venv/bin/python -m pip install -q -r /dev/stdin
        .venv/bin/python -m pip install -qq --no-build-isolation -e ".[$extra]"
    elif ! done_before extension "$extension" || ! has_file 'csm/_core.*.so'; then
        say "building csm._core"
        .venv/bin/python setup.py -q build_ext --inplace
    fi
    echo "$packages" >".venv/.csm-packages-$extra"
    echo "$extension" >.venv/.csm-extension
}

python=.venv/bin/python
without=()
venv_works || python=$(find_python)
find_missing
install_missing
if ! venv_works; then
    python=$(find_python)
    [ -n "$python" ] || die "no Python 3.11 or newer found; PYTHON=path names one"
    say "making .venv with $python"
    "$python" -m venv --clear .venv
fi
[ ${#without[@]} -eq 0 ] || echo "${without[*]}" >.venv/.csm-without
install_package
