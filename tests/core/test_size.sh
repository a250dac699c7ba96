#!/bin/bash
# scripts/size --budget, in a copy of a part of the tree whose budgets are what the copy has: each planted fault is found and named.
set -eu
root=$LG_TEST_DIR/..
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
mkdir -p "$copy/scripts" "$copy/docs/data"
fill() { # the copy's sources
    mkdir -p "$copy/src/nn" "$copy/src/model/files" "$copy/apps"
    cp -r "$root/src/core" "$root/src/mpi" "$copy/src"
    cp "$root/src/model/files/any.c" "$copy/src/model/files" # lists the kinds of models, which scripts/size reads
    cp -r "$root/apps/lg-fit" "$copy/apps"
}
fill
cp "$root/scripts/size" "$copy/scripts"
cd "$copy"
size=scripts/size csv=docs/data/budget.csv
fail() { echo "$1"; sed 's/^/    /' said; exit 1; }
passes() { "$size" --budget >said 2>&1 || fail "$1: rejected"; }
fails() { # WHAT SENTENCE: the command fails, and says this
    ! "$size" --budget >said 2>&1 || fail "$1: accepted"
    grep -q -- "$2" said || fail "$1: the message lacks '$2'"
}
# Budgets as large as you like, which --lower brings down to what there is.
sed -E 's/,[0-9]+,[0-9]+$/,9999999,99999999/' "$root/$csv" >"$csv"
"$size" --budget --lower >said 2>&1 || fail "--lower: rejected"
cp "$csv" exact.csv
passes "budgets that are used up"
everything() { find src apps share -type f ! -name '*.h5' ! -name '*.pyc' 2>/dev/null -exec cat {} + | wc -l; }
[ "$(awk -F, 'NR > 1 { lines += $2 } END { print lines }' "$csv")" = "$(everything)" ] ||
    fail "the lines of $csv are not all lines of src and apps"
[ "$("$size" | sed -n '1s/ *\([0-9]*\)  lines.*/\1/p')" = "$(everything)" ] ||
    fail "the first line of scripts/size is not all lines of src and apps"

# A file of 50 lines counts in every room, whatever its suffix.
planted=() over=
plant() { # FILE
    mkdir -p "${1%/*}"
    yes text | head -50 >"$1"
    planted+=("$1")
}
while IFS=, read -r room _; do
    plant "${room##* }/planted.gp"
    over+="${over:+, }$room (50)"
done < <(tail -n +2 exact.csv)
fails "a planted file in each room" "lines are $((50 * ${#planted[@]})) above the budget; rooms above theirs: $over$"
rm "${planted[@]}"
planted=()
for suffix in .c .h .inc .py .sh .in .def .template ""; do plant "src/nn/planted$suffix"; done
fails "planted files of all kinds" "lines are 450 above the budget; rooms above theirs: src/nn (450)$"
rm "${planted[@]}"
printf 'no newline' >src/nn/planted.py
fails "a last line without a newline" "1 above the budget"
rm src/nn/planted.py

# Tokens: lines that are packed, with as many lines as before.
line=$(grep -n '^    return' src/core/text.c | head -1 | cut -d: -f1)
sed -i "${line}s/\$/ return; return;/" src/core/text.c
fails "packed lines" "4 above the budget; rooms above theirs: src/core + src/kernels (4)$"
cp "$root/src/core/text.c" src/core

# One room may be above its budget while another is below; --lower then writes both, and otherwise nothing.
printf 'int x;\n' >src/nn/planted.c
"$size" --budget --lower >said 2>&1 && fail "--lower: accepted too many lines"
cmp -s "$csv" exact.csv || fail "--lower wrote budgets of a tree that is too large"
rm src/mpi/mpi.c
passes "a room above its budget, another below"
"$size" --budget --lower >said 2>&1 || fail "--lower: rejected"
grep -q '^src/mpi,0,0$' "$csv" || fail "--lower did not lower"
cp "$root/src/mpi/mpi.c" src/mpi
fails "a file that came back after --lower" "src/mpi ("
rm src/nn/planted.c
cp exact.csv "$csv"

mkdir src/planted
touch src/planted/a.c
fails "a folder without a row" "src/planted/a.c lies in no room"
rm -r src/planted

# What the table shows, and its limits.
printf '%s\n' '/* 10 */ // ;;' 'int a = ";;"[0]; int b;' 'for (;;) {' '}' '#define M \' '\' '\' '\' '\' '\' '\' '\' '\' '\' '\' 'x' >src/mpi/planted.h
printf '%s\n' 'static inline int f(void) {' '    return 0;' '}' 'static inline int g(void) { return 1; }' '/* clang-format off */' >>src/mpi/planted.h
printf '%s\n' '1, 2.5e-3, {-4}' 'a 5' >src/mpi/planted.csv
before=$(awk -F, '$1 == "src/mpi" { print $2 + 23, $3 + 46 }' exact.csv)
"$size" --budget >said 2>&1 || true
awk '$NF == "src/mpi" { print $1, $2 }' said | grep -qx "$before" || fail "lines and tokens of the planted header are not $before"
[ "$(awk '$NF == "src/mpi" { print $5, $6, $7, $8 }' said)" = "1 1 4 1" ] || fail "joined, macros, inline, numbers: not 1 1 4 1"
rm src/mpi/planted.*
marks=$(cat $(find src apps -name '*.[ch]') | grep -c "clang-format off") || true
for number in $(seq "$marks" 2); do echo "/* clang-format off $number */" >>src/core/text.c; done
fails "a third clang-format off" '"clang-format off" occurs 3 times; 2 are allowed'
cp "$root/src/core/text.c" src/core
python3 -c 'import re, sys
for name in sys.argv[1:]:
    text = open(name).read()
    open(name, "w").write(re.sub(r"(?s)/[*].*?[*]/", "", text))' $(find src apps -name '*.c')
fails "comments removed" "at least 13.0 % are due"
rm -r src apps
fill

# A generated file is not counted if its test names it.
mkdir -p tests/nn
seq -f '/* %g */' 50 >src/nn/planted.c
echo '/* writes planted.c */' >tests/nn/test_planted.c
sed -i "s:^GENERATED = {:GENERATED = {\"src/nn/planted.c\"\: \"tests/nn/test_planted.c\", :" "$size"
passes "a generated file"
echo '/* another file */' >tests/nn/test_planted.c
fails "a generated file that its test does not name" "src/nn/planted.c is not counted, but tests/nn/test_planted.c does not name it"
rm tests/nn/test_planted.c
fails "a generated file without its test" "src/nn/planted.c is not counted, but tests/nn/test_planted.c does not name it"
rm src/nn/planted.c
cp "$root/scripts/size" scripts

# Budgets only go down: compared with every committed table.
command -v git >/dev/null || { echo "no git: budgets are not compared with earlier ones"; exit 0; }
git init -q . && git add "$csv"
git -c user.name=t -c user.email=t@t commit -qm "budgets"
passes "committed budgets"
awk -F, -v OFS=, '$1 == "src/nn" { $2 += 50 } { print }' exact.csv >"$csv"
fails "a budget that went up" "and budgets only go down"
