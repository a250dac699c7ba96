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

suites=(core/test_core files/test_numbers_and_hashes files/test_locale settings/test_hyperparameters settings/test_yaml_edit
    datasets/test_tables autodiff/test_program_c_text)
for suite in "${suites[@]}"; do
    for locale in de_DE.UTF-8 tr_TR.ISO-8859-9; do
        said=$(LG_TEST_LOCALE=$locale "$LG_BIN_DIR/../tests/tests_${suite%/*}" "${suite#*/}" 2>&1) ||
            fail "$suite in a process with the locale $locale: $(tail -n 20 <<<"$said")"
    done
done

# ---- programs ----

printf '%s\n' 'a,b,y' >table.csv
for i in $(seq 40); do echo "0.$i,1.5e-1,$((i * i % 17)).25"; done >>table.csv
cat >scene.yaml <<'END'
system: chain
masses: [1.5, 0.5]
lengths: [1.25, 0.75]
gravity: 9.81
END
for locale in C de_DE.UTF-8 tr_TR.ISO-8859-9; do
    mkdir "$locale"
    (
        cd "$locale" || exit 1
        export LC_ALL=$locale SOURCE_DATE_EPOCH=0
        cp ../table.csv ../scene.yaml .
        "$LG_BIN_DIR/lg-fit" train table.csv --epochs 3 --lr 1.5e-3 --hidden 4 --plot fit.svg --json --out fit.h5
        "$LG_BIN_DIR/lg-fit" predict fit.h5 table.csv --out predicted.csv
        "$LG_BIN_DIR/lg-export" fit.h5 --name fit --out c
        "$LG_BIN_DIR/lg-export" scene.yaml --name scene --target onnx --out onnx
        "$LG_BIN_DIR/lg-simulate" scene.yaml --t-end 0.5 --dt 0.125 --csv run.csv --plot run.svg
        "$LG_BIN_DIR/lg-fit" train table.csv --lr 1,5e-3 --out no.h5
    ) >"$locale/said" 2>&1
done
for locale in de_DE.UTF-8 tr_TR.ISO-8859-9; do
    diff -r C "$locale" >"$locale.differences" || fail "under $locale programs wrote other bytes: $(head -n 20 "$locale.differences")"
done
for file in fit.svg predicted.csv run.svg c onnx; do [ -e "C/$file" ] || fail "no $file was written: $(cat C/said)"; done
exit $status
