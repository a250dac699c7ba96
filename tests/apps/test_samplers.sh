#!/bin/bash
# Searches with --sampler tpe: resumed, by several jobs, and by tasks.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PATH=$LG_BIN_DIR:$PATH
cd "$work"
. "$LG_TEST_DIR/apps/sweeps.sh"

make_sweeps
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

# The names of the option come from the table.
code=0
lg-elastica search ranges.yaml data.h5 --sampler nothing --out n.csv 2>err || code=$?
[ $code = 2 ] && grep -q 'random' err && grep -q 'tpe' err || fail "a wrong sampler: $code $(cat err)"
lg-elastica search --help | grep -A4 -e "--sampler" | grep -q tpe || fail "--help does not list the samplers"
