# The page docs/reports/thesis.md: every row of its list is complete, its commands, options, files and plots exist, and data
# and page are what bench/thesis makes of the list. Nothing is run. Planted errors in copies have to be told.
# ctest-labels: bench/thesis docs/reports
set -u
export LC_ALL=C.UTF-8
command -v python3 >/dev/null || { echo "there is no python3"; exit 77; }
root=$(cd "$LG_TEST_DIR/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
status=0
check() { "$root/bench/thesis" --check --build "$LG_BIN_DIR/.." --items "$work/thesis.ini" --out "$work" >"$work/said" 2>&1; }
fresh() {
    mkdir -p "$work/data"
    cp "$root/bench/thesis.ini" "$root/docs/reports/thesis.md" "$work"
    cp "$root/docs/reports/data/thesis.csv" "$work/data"
}
# What is wrong, the file, the sed command that plants it, and a piece of what the check has to say.
planted() {
    fresh
    sed -i "$3" "$work/$2"
    cmp -s "$work/$2" "$root/$4/$(basename "$2")" && { echo "nothing planted: $1"; status=1; }
    check && { echo "not told: $1"; status=1; }
    grep -qF -- "$5" "$work/said" || { echo "$1: '$5' is missing in:"; head -5 "$work/said"; status=1; }
}

fresh
check || { cat "$work/said"; status=1; }
planted "a row without published numbers" thesis.ini 's/^published = 10913$//' bench 'has no `published`'
planted "a row with no chapter" thesis.ini '/^\[table 6.8\]$/,/^what/s/^chapter = 6$/chapter = 7/' bench "has no chapter"
planted "a row with nothing to show" thesis.ini '/^\[figure 6.1\]$/,/^\[section/s/^drawing = .*//' bench "has neither numbers nor"
planted "a reason of a word" thesis.ini 's/^missing = No scene .*/missing = no/' bench "is no sentence"
planted "an unknown option" thesis.ini 's/--method variational/--methodic x/' bench "there is no option --methodic"
planted "an unknown program" thesis.ini 's/^run = lg-gradcheck/run = lg-gradchecks/' bench "there is no program"
planted "an unknown command" thesis.ini 's/lg-elastica solve --/lg-elastica solves --/' bench "there is no command solves"
planted "an unknown scene" thesis.ini 's,scenes/rigid-body.yaml,scenes/no.yaml,' bench "there is no file scenes/no.yaml"
planted "a plot that is not there" thesis.ini 's/integrators-event.svg/no-event.svg/' bench "there is no plots/no-event.svg"
planted "a key that nobody reads" thesis.ini 's/^better = lower/beter = lower/' bench "unknown key beter"
planted "no comparison and no reason" thesis.ini '0,/^unlike = other data/s/^unlike = other data.*//' bench "do not both say"
planted "other data that count" thesis.ini '/^\[table 6.8\]$/,/^unlike/s/^better = unlike unlike/better = lower higher/' bench "do not both say"
planted "a word that compares nothing" thesis.ini 's/^better = again$/better = often/' bench "unknown word"
planted "a range typed into the page" thesis.md '/^| table 5.3/s/ to / up to /' docs/reports "thesis.md is not what"
planted "another command than was run" thesis.ini 's/--tol 1e-13/--tol 1e-12/' bench "was not run as it stands"
planted "a number typed into the page" thesis.md '/^| table 4.3/s/e-12/e-13/2' docs/reports "thesis.md is not what"
planted "a number typed into the data" data/thesis.csv '/^table 4.1,/s/e-05/e-06/' docs/reports/data "says otherwise"
exit $status
