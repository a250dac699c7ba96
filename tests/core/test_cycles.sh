#!/bin/bash
# Files whose functions call each other in a circle cannot be read one after the other. Only the files listed here may;
# docs/architecture.md says why. Headers never include each other in a circle.
set -u
known='
autodiff/ops/binary autodiff/ops/elementwise autodiff/ops/geometry autodiff/ops/matrix autodiff/ops/reduce
autodiff/tape/backward autodiff/tape/derivatives autodiff/tape/rows
nn/minimise nn/minimise_broyden nn/minimise_curvature nn/minimise_lm nn/minimise_newton
nn/minimise_search
nn/fit_methods nn/fit_ranks nn/fit_squares nn/fit_step
elastica/elastica_branches elastica/elastica_continuation
anomaly/detector_train anomaly/detector_units
anomaly/riser anomaly/riser_motion anomaly/riser_sea
anomaly/classify/classifier_program anomaly/classify/features anomaly/classify/features_kinds anomaly/classify/features_rocket
anomaly/classify/tree anomaly/classify/tree_prune
machine/friction machine/record
machine/files/machine machine/files/terms
machine/files/model machine/files/recipe
'
# Reads lines "from to" and prints each node that lies on a circle.
on_a_circle() {
    awk '{ to[$1] = to[$1] " " $2 }
        END {
            for (start in to) {
                split("", seen); list = to[start]
                while (split(list, next_ones) > 0) {
                    list = ""
                    for (i in next_ones) if (!(next_ones[i] in seen)) { seen[next_ones[i]]; list = list to[next_ones[i]] }
                }
                if (start in seen) print start
            }
        }' | sort
}

cd "$LG_BIN_DIR/../CMakeFiles" || exit 1
objects=$(cd "$LG_TEST_DIR/.." && find src -name '*.c')
objects=$(for source in $objects; do compgen -G "liegrad*_objects.dir/$source.o"; done)
[ -n "$objects" ] || { echo "no objects in $PWD"; exit 1; }
# shellcheck disable=SC2086 # a list
# A format of columns (files/frame_*) calls the frame, which has it in its table.
found=$(nm -A $objects | sed 's|^liegrad[a-z_]*_objects.dir/src/\(.*\)\.c\.o:[ 0-9a-f]* \([A-Za-z]\) |\1 \2 |' |
    awk '$2 == "U" { uses[++n] = $1 " " $3 } $2 ~ /[TDRBC]/ { of[$3] = $1 }
        END { for (i = 1; i <= n; i++) { split(uses[i], u); if ((u[2] in of) && of[u[2]] != u[1]) print u[1], of[u[2]] } }' |
    sort -u | on_a_circle | grep -v '^files/frame')
wrong=$(comm -3 <(tr -s ' \n' '\n' <<<"$known" | sed '/^$/d' | sort) <(echo "$found"))
[ -z "$wrong" ] || printf 'on a circle, and not expected, or (left) no longer so:\n%s\n' "$wrong"

cd "$LG_TEST_DIR/../src" || exit 1
headers=$(grep -roE '^ *# *include "[^"]+"' --include='*.h' . | sed 's|^\./\(.*\):.*"\(.*\)"|\1 \2|' | on_a_circle)
[ -z "$headers" ] || printf 'headers that include each other in a circle:\n%s\n' "$headers"
[ -z "$wrong$headers" ]
