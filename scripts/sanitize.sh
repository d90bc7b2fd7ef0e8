#!/usr/bin/env bash
# sanitize.sh [PYTEST ARGUMENTS]: the tests against a build with the address and undefined-behaviour
# sanitizers, in build/sanitized; the build in use stays as it is.
set -euo pipefail
cd "$(dirname "$0")/.."
library=build/sanitized/lib
CSM_SANITIZE=1 .venv/bin/python setup.py -q build --build-base build/sanitized \
    --build-lib "$library" 2>/dev/null

display=()
[ -n "${DISPLAY:-}" ] || display=(xvfb-run -a)
# The interpreter itself is not built with the sanitizers: their runtimes come first. It keeps what
# it allocates until it ends, which is no leak of ours.
preload="$(gcc -print-file-name=libasan.so) $(gcc -print-file-name=libubsan.so)"
"${display[@]}" env LD_PRELOAD="$preload" ASAN_OPTIONS=detect_leaks=0 \
    UBSAN_OPTIONS=halt_on_error=1 PYTHONPATH="$PWD/$library:$PWD" \
    .venv/bin/python -P -m pytest -p no:cacheprovider --timeout 600 "$@"
