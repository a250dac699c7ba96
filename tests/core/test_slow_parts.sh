#!/bin/bash
# scripts/slow: any 15 consecutive runs of .ci/run have every slow suite once.
set -eu
cd "$LG_TEST_DIR/.."
build=$LG_BIN_DIR/..
all=$(ctest --test-dir "$build" -N -L '^slow$' -LE study | sed -n 's/^ *Test *#[0-9]*: //p' | sort)
round() { for number in $(seq "$1" $(($1 + 14))); do scripts/slow "$number" "$build"; done | sort; }
for begin in 0 12348; do
    [ "$(round $begin)" = "$all" ] || { echo "runs $begin to $((begin + 14)) do not have every slow suite once"; exit 1; }
done
# The list has parts from 0 to 14. The own part and `changed` have no suite in common.
while read -r name part _; do
    case $part in [0-9] | 1[0-4]) ;; *) echo "tests/slow.txt: '$name' has part '$part'"; exit 1 ;; esac
done < <(grep -v '^#' tests/slow.txt)
both=$({ scripts/slow 3 "$build"; LIEGRAD_SINCE=none scripts/slow 3 changed "$build"; } | sort)
[ "$both" = "$all" ] || { echo "part 3 and the others are not all slow suites"; exit 1; }
