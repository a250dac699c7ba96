#!/bin/bash
# Searches with --sampler tpe and grid: resumed, by several jobs, and by tasks.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PATH=$LG_BIN_DIR:$PATH
cd "$work"
. "$LG_TEST_DIR/apps/sweeps.sh"

make_sweeps
lg-elastica generate --case right-end --count 30 --intervals 8 --out data.h5 >made 2>&1
sed -i 's/epochs: 20/epochs: 3/' ranges.yaml
search="lg-elastica search ranges.yaml data.h5 --threads 1 --sampler tpe"
values() { sed 1d "$1" | awk -F, '{print $1, $7, $8, $9}'; }

$search --trials 18 --out whole.csv >/dev/null
lg-elastica search ranges.yaml data.h5 --threads 1 --trials 18 --out random.csv >/dev/null
diff <(values whole.csv | head -11) <(values random.csv | head -11) || fail "the first 10 trials are not random"
! diff <(values whole.csv | sed 1,11d) <(values random.csv | sed 1,11d) >/dev/null || fail "later trials are random"

# Stopped and continued anywhere; a search at random is continued by tpe.
for first in 4 12; do
    rm -f t.csv
    $search --trials $first --out t.csv >/dev/null
    $search --trials 18 --out t.csv --resume >/dev/null
    same_table whole.csv t.csv || fail "continued after $first trials: another table"
done
lg-elastica search ranges.yaml data.h5 --threads 1 --trials 10 --out t.csv >/dev/null
$search --trials 18 --out t.csv --resume >/dev/null
same_table whole.csv t.csv || fail "a search at random, continued by tpe, has another table"

# With jobs the table depends on their number alone.
for out in a b; do $search --trials 18 --jobs 3 --out $out.csv >/dev/null; done
same_table a.csv b.csv || fail "3 jobs give two tables"
[ "$(sed 1,2d a.csv | wc -l)" = 18 ] || fail "3 jobs did not do all trials"
diff <(values a.csv | head -11) <(values whole.csv | head -11) || fail "jobs: the first trials"

# Tasks do not wait for each other.
$search --trials 18 --out m.csv --task 1/2 >/dev/null
$search --trials 18 --out m.csv --task 0/2 >/dev/null
$search --trials 18 --out m.csv --merge >/dev/null
[ "$(sed 1,2d m.csv | wc -l)" = 18 ] || fail "2 tasks did not do all trials"

# A grid has each combination once, in the order of nested loops: 3 depths and 3 widths leave 2 rates of 20 trials.
grid="lg-elastica search ranges.yaml data.h5 --threads 1 --sampler grid"
points() { sed 1,2d "$1" | cut -d, -f7-9; }
$grid --trials 20 --out grid.csv >/dev/null 2>err
grep -q "the grid has 18 points, and 18 trials are made" err || fail "a smaller grid: $(cat err)"
for lr in 0.0001 0.10000000000000001; do for layers in 1 2 3; do for hidden in 8 16 24; do
    echo "$lr,$layers,$hidden"
done; done; done >expected
diff expected <(points grid.csv) || fail "a grid has other points"
$grid --trials 18 --jobs 3 --out t.csv >/dev/null
same_table grid.csv t.csv || fail "3 jobs give another grid"
for i in 1 0; do $grid --trials 20 --out t3.csv --task $i/2 >/dev/null 2>&1; done
$grid --trials 20 --out t3.csv --merge >/dev/null 2>&1
same_table grid.csv t3.csv || fail "2 tasks give another grid"
head -n 9 grid.csv >t.csv
$grid --trials 20 --out t.csv --continue >/dev/null 2>&1
same_table grid.csv t.csv || fail "a grid that is continued has another table"

# A grid that is larger than the trials is begun, and ended later; other levels are another grid.
$grid --trials 5 --out t.csv >/dev/null 2>err
grep -q "the grid has 9 points, and 5 trials are made" err || fail "a larger grid: $(cat err)"
points t.csv >five
$grid --trials 17 --out t.csv --continue >/dev/null 2>&1
[ "$(points t.csv | sort -u | wc -l)" = 9 ] || fail "a grid in two parts has not 9 points"
diff five <(points t.csv | head -n 5) || fail "the second part changes the first"
code=0
$grid --trials 20 --out t.csv --continue >/dev/null 2>err || code=$?
[ $code = 2 ] && grep -q "trial 0 has other values than --sampler grid gives it with --trials 20" err || fail "other levels: $code $(cat err)"
$search --trials 12 --out t.csv --continue >/dev/null
[ "$(points t.csv | wc -l)" = 12 ] || fail "tpe does not continue a grid"

# The names of the option come from the table.
code=0
lg-elastica search ranges.yaml data.h5 --sampler nothing --out n.csv 2>err || code=$?
[ $code = 2 ] && grep -q 'random' err && grep -q 'tpe' err && grep -q 'grid' err || fail "a wrong sampler: $code $(cat err)"
lg-elastica search --help | grep -A4 -e "--sampler" | grep -q tpe || fail "--help does not list the samplers"
lg-elastica search --help | tr -s '\n ' '  ' >help
for name in random tpe grid; do grep -q "With --sampler $name [a-z]" help || fail "--help does not describe $name"; done
