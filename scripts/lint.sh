#!/usr/bin/env bash
# lint.sh: ruff on the Python, clang-format and clang-tidy (where installed) on the C.
set -uo pipefail
cd "$(dirname "$0")/.."
failed=0
.venv/bin/python -m ruff check . || failed=1
.venv/bin/python -m ruff format --check . || failed=1
mapfile -t c_files < <(find csrc benchmarks -name '*.[ch]' | sort)
if command -v clang-format >/dev/null; then
    clang-format --dry-run --Werror "${c_files[@]}" || failed=1
else
    echo 'lint: clang-format is not installed, layout of the C not checked' >&2
fi
if command -v clang-tidy >/dev/null; then
    mapfile -t includes < <(.venv/bin/python -c 'import numpy, sysconfig
print("-isystem", numpy.get_include(), "-isystem", sysconfig.get_path("include"), sep="\n")')
    mapfile -t units < <(find csrc benchmarks -name '*.c' | sort)
    clang-tidy --quiet "${units[@]}" -- -std=c11 -D_POSIX_C_SOURCE=200809L -Icsrc \
        -isystem build/glad/include "${includes[@]}" 2>/dev/null || failed=1
else
    echo 'lint: clang-tidy is not installed, the C not analysed' >&2
fi
exit $failed
