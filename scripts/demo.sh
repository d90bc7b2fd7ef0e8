#!/usr/bin/env bash
# demo.sh: renders real terrain at low sun into ./demo and says where the pictures are.
# Pictures that are newer than all they are made from are kept.
set -euo pipefail
cd "$(dirname "$0")/.."
summary=demo/summary.json

if [ -e "$summary" ] && [ -z "$(find csm csrc shaders scripts/demo.sh -newer "$summary" \
    -not -name '*.pyc' -type f -print -quit)" ]; then
    echo "Nothing has changed since these were made (rm -r demo to make them again)."
else
    .venv/bin/csm render demo --truth --out demo
fi
echo
echo "Pictures, arrays and numbers are in $PWD/demo:"
ls demo
