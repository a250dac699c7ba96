# scripts/slow: five runs in a row run every slow test once, and each of them runs some.
set -eu
slow=$LG_TEST_DIR/../scripts/slow build=$LG_BIN_DIR/..
all=$(ctest --test-dir "$build" -N -L slow -LE study | sed -n 's/^ *Test *#[0-9]*: //p' | sort)
[ "$(wc -l <<<"$all")" -ge 5 ] || { echo "too few slow tests: $all"; exit 1; }
for first in 0 1 7 1234; do
    found=
    for k in 0 1 2 3 4; do
        part=$(bash "$slow" "$build" $((first + k)) | sed 's/^^(//; s/)\$$//' | tr '|' '\n')
        [ -n "$part" ] || { echo "run $((first + k)) runs no slow test"; exit 1; }
        found+=$part$'\n'
    done
    diff <(echo "$all") <(sed '/^$/d' <<<"$found" | sort) || { echo "runs from $first on: not every slow test ran once"; exit 1; }
done
