#!/bin/bash
# Uses the recipe apps/rotor/rotor.c, which a user adds as one file and one row in the list of recipes. A model is
# trained, resumed, searched, judged, predicted and exported, and a wrong sign in the recipe must be found.
# ctest-labels: apps/lg-learn apps/common src/model src/settings
set -u
export LC_ALL=C
status=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
learn=$LG_BIN_DIR/../tests/rotor/lg-learn planted=$LG_BIN_DIR/../tests/planted/lg-learn
[ -x "$learn" ] || exit 77
fail() { echo "$*"; status=1; }
number() { sed -n "s/.*\"$1\": \([^,}]*\).*/\1/p"; }
below() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a != "" && a == a + 0 && a < b) }' || fail "$3: $1 is not below $2"; }

# pairs: pairs of states of H = (px^2 + pa^2)/2 + x^2/2 + (1 + x/2) (1 - cos a), 0.1 s apart, by 100 leapfrog steps.
pairs() {
    awk -v n="$1" -v seed="$2" '
        function fx() { return -x - (1 - cos(a))/2 }
        function fa() { return -(1 + x/2)*sin(a) }
        BEGIN {
            srand(seed); print "x,a,px,pa,x2,a2,px2,pa2"
            for (i = 0; i < n; i++) {
                x = 2*rand() - 1; a = 6.28*rand(); px = 2*rand() - 1; pa = 2*rand() - 1
                printf "%.12g,%.12g,%.12g,%.12g", x, a, px, pa
                for (k = 0; k < 100; k++) {
                    px += 5e-4*fx(); pa += 5e-4*fa(); x += 1e-3*px; a += 1e-3*pa; px += 5e-4*fx(); pa += 5e-4*fa()
                }
                printf ",%.12g,%.12g,%.12g,%.12g\n", x, a, px, pa
            }
        }'
}
pairs 200 1 >train.csv
pairs 100 2 >test.csv
awk -F, -v OFS=, 'NR > 1 { for (i = 1; i <= 8; i++) $i += 0.1*(rand() - 0.5) } 1' train.csv >noisy.csv

"$learn" list | grep -q '^rotor ' || fail "list: no rotor"
way="--recipe rotor --method ssbroyden --epochs 300"
# shellcheck disable=SC2086 # words are split on purpose
{
    loss=$("$learn" train train.csv $way --json --out m.h5 | number loss)
    below "$loss" 1e-7 "train: the loss"
    "$learn" train train.csv $way --stop-after 100 --checkpoint half.h5 --out r.h5 >/dev/null 2>&1
    "$learn" train train.csv --recipe rotor --resume half.h5 --json --out r.h5 | grep -q "\"loss\": $loss" || fail "resume: other bits"
    below "$("$learn" train train.csv --recipe rotor --method lm --epochs 100 --json --out lm.h5 | number loss)" 1e-7 "lm: the loss"
    noisy="train noisy.csv --recipe rotor --method lbfgs --epochs 1000 --json"
    below "$("$learn" $noisy --out noisy.h5 | number loss)" "$("$learn" $noisy --prior 0.1 --out prior.h5 | number loss)" "prior: the loss"
    "$learn" train train.csv --recipe rotor --size auto --epochs 20 --method lbfgs --out s.h5 >/dev/null 2>sizes || fail "size"
    grep -q 'size auto: [0-9]*, of [0-9]* widths' sizes || fail "size: no race"
    "$planted" train train.csv $way --out p.h5 >/dev/null || fail "planted: the training"
}
below "$("$learn" evaluate m.h5 test.csv --json | number loss)" 1e-6 "evaluate"

# A message about an option names it, and ends with the same hint as a message about the form of the command line.
head -n 2 train.csv >one.csv
"$learn" train one.csv --recipe rotor --validation-fraction 0.5 --out one.h5 2>&1 |
    grep -q -e '--validation-fraction: needs at least 2 samples' || fail "a validation part of one pair"
hint() { "$learn" "$@" 2>&1 | tr '\n' ' ' | grep -o 'Try .*'; }
[ -n "$(hint predict)" ] && [ "$(hint predict m.h5)" = "$(hint predict)" ] || fail "two hints: $(hint predict m.h5) $(hint predict)"

printf 'ranges:\n  hidden: { choice: ["8", "16"] }\n  epochs: { integer: [20, 60] }\nfixed: { method: lbfgs }\n' >ranges.yaml
"$learn" search ranges.yaml train.csv --recipe rotor --trials 4 --out trials.csv | grep -q 'best: trial' || fail "search"
sed -n 2p trials.csv | tr , '\n' | sort | uniq -d | grep . && fail "search: two columns of one name"

# For the first of two states 0.1 s apart the model must predict the second, and its energy must be constant.
IFS=, read -r x a px pa x2 a2 px2 pa2 < <(sed -n 2p test.csv)
"$learn" predict m.h5 --initial "$x,$a,$px,$pa" --t-end 0.1 --points 2 --out flow.csv >/dev/null || fail "predict"
tail -n 1 flow.csv | awk -F, -v x="$x2" -v a="$a2" -v p="$px2" -v q="$pa2" '
    { d = ($2 - x)^2 + ($3 - a)^2 + ($4 - p)^2 + ($5 - q)^2; exit !(d < 1e-5) }' || fail "predict: $(tail -n 1 flow.csv)"

# drift MODEL: the change of the learned energy in five seconds, computed by a program without this recipe.
drift() {
    local end
    "$LG_BIN_DIR/lg-learn" predict "$1" --initial "$x,$a,$px,$pa" --t-end 5 --out flow.csv --json >begin.json || fail "predict: $1"
    end=$(tail -n 1 flow.csv)
    "$LG_BIN_DIR/lg-learn" predict "$1" --initial "${end#*,}" --json >end.json || fail "predict: the end"
    cat begin.json end.json | sed 's/.*"value": \[\([^]]*\).*/\1/' | awk '{ v[NR] = $1 } END { print (v[1] - v[2])^2 }'
}
below "$(drift m.h5)" 1e-16 "the energy changes"
below 1e-4 "$(drift p.h5)" "planted: the energy stays"
"$LG_BIN_DIR/lg-learn" evaluate m.h5 test.csv 2>&1 | grep -q 'no recipe' || fail "evaluate by a program that has no such recipe"

"$LG_BIN_DIR/lg-export" m.h5 --out exported --name rotor >/dev/null || fail "export"
if command -v make >/dev/null && command -v cc >/dev/null; then
    make -s -C exported test >log 2>&1 || fail "the exported code fails: $(tail -n 3 log)"
fi
exit $status
