#!/bin/bash
# Numbers have a decimal point, and names their letters, whatever the locale of the process is: German has a decimal comma, and in
# Turkish i and I are different letters. Suites of the library run in a process that called setlocale, as an embedding program
# does. Programs write the same bytes under each locale. The locales are compiled here, so that none must be installed.
# ctest-labels: src/core src/settings src/files apps/common
set -u
unset LC_ALL
[ -e /usr/share/i18n/locales/tr_TR ] && command -v localedef >/dev/null ||
    { echo "localedef or its tables are missing (Debian: locales): the locales are not tested"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
export LOCPATH=$work/locales
mkdir locales
localedef -i de_DE -f UTF-8 locales/de_DE.UTF-8 && localedef -i tr_TR -f ISO-8859-9 locales/tr_TR.ISO-8859-9 || exit 1
[ "$(LC_ALL=de_DE.UTF-8 printf '%.1f' 1,5)" = 1,5 ] || { echo "the German locale has no decimal comma here"; exit 1; }

status=0
fail() { echo "$*"; status=1; }

# ---- the library ----

while read -r room suite claim; do
    for locale in de_DE.UTF-8 tr_TR.ISO-8859-9; do
        said=$(LG_TEST_LOCALE=$locale "$LG_BIN_DIR/../tests/tests_$room" "$suite" ${claim:+"$claim"} 2>&1) ||
            fail "$suite $claim in a process with the locale $locale: $(tail -n 20 <<<"$said")"
    done
done <<'END'
core test_core
files test_numbers_and_hashes
files test_other_machines
settings test_hyperparameters
settings test_yaml
settings test_search_files the table of trials*
datasets test_tables
mechanics test_scene_files the files in scenes/*
machine test_machine_files
machine test_machine_entries
control test_policy a task with a fault*
END

# The library must format and read real numbers by lg_format and lg_real. This finds statements that do not.
found=$(find "$LG_TEST_DIR/../src" -name '*.[ch]' ! -path '*/code/*' ! -path '*/core/decimal.c' -exec awk 'BEGIN { RS = ";" }
    /[^a-z_](strto(d|f|ld)|atof|vsn?printf)\(/ || /[^a-z_](s|sn|f|d)printf\(.*%[-+#0]*[0-9*]*([.][0-9*]+)?[lL]?[aAeEfFgG]/ {
        gsub(/[ \n]+/, " "); print FILENAME ":" $0 }' {} +)
[ -z "$found" ] || fail "these follow the locale: $found"

# ---- programs ----

printf '%s\n' 'a,b,y' >table.csv
for i in $(seq 40); do echo "0.$i,$((i * i % 7)).5e-1,$((i * i % 17)).25"; done >>table.csv
"$LG_BIN_DIR/lg-fit" train table.csv --epochs 3 --out fit.h5 >said 2>&1 || fail "$(cat said)"
cat >scene.yaml <<'END'
system: pendulum-chain
form: lagrangian
masses: [1.5, 0.5]
lengths: [1.25, 0.75]
gravity: 9.81
initial: { q: [[0.6, 0, 0.8], [0, 0.6, 0.8]], omega: [[0, 1.5, 0], [1.5, 0, 0]] }
END
for locale in C de_DE.UTF-8 tr_TR.ISO-8859-9; do
    mkdir "$locale"
    (
        cd "$locale" || exit 1
        export LC_ALL=$locale SOURCE_DATE_EPOCH=0
        cp ../table.csv ../scene.yaml .
        "$LG_BIN_DIR/lg-fit" train table.csv --method adam --epochs 3 --lr 1.5e-3 --hidden 4 --plot fit.svg --out own.h5
        "$LG_BIN_DIR/lg-fit" predict ../fit.h5 table.csv --out predicted.csv
        "$LG_BIN_DIR/lg-export" ../fit.h5 --name line --out c
        "$LG_BIN_DIR/lg-export" ../fit.h5 --name line --target onnx --out onnx
        "$LG_BIN_DIR/lg-simulate" scene.yaml --t-end 0.5 --plot run.svg --json | sed "s/\"seconds\": [^,]*,//"
        "$LG_BIN_DIR/lg-fit" train table.csv --method adam --lr 1,5e-3 --out no.h5
        rm own.h5 # has the time that the training took
    ) >"$locale/said" 2>&1
    sed -i '/^seconds /d' "$locale/said"
done
for locale in de_DE.UTF-8 tr_TR.ISO-8859-9; do
    diff -r C "$locale" >"$locale.differences" || fail "under $locale programs wrote other bytes: $(head -n 20 "$locale.differences")"
done
[ ! -e C/no.h5 ] || fail "a decimal comma was taken for a number"
for file in fit.svg predicted.csv c onnx run.svg; do [ -e "C/$file" ] || fail "no $file was written: $(cat C/said)"; done
exit $status
