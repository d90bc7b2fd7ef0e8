#!/usr/bin/env bash
# demo.sh: renders real terrain at low sun into ./demo, shows the numbers, says where the pictures
# are. Pictures that are newer than all they are made from are kept.
set -euo pipefail
cd "$(dirname "$0")/.."
numbers=demo/numbers.txt

if [ -e "$numbers" ] && [ -z "$(find csm csrc shaders scripts/demo.sh -newer "$numbers" \
    -not -name '*.pyc' -type f -print -quit)" ]; then
    cat "$numbers"
    echo
    echo "Nothing has changed since these were made (rm -r demo to make them again)."
else
    # Thirteen kilometres in one view: logarithmic splits keep the texels small near the eye.
    mkdir -p build
    .venv/bin/csm render demo --set split=logarithmic --truth --out demo | tee build/numbers.txt
    mv build/numbers.txt "$numbers"
fi
echo
echo "Pictures, arrays and numbers are in $PWD/demo:"
ls demo
