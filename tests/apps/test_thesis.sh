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
# plant WHAT FILE SED MESSAGE: plants an error in a copy; `told` then runs the check, which has to say all messages planted since
# the last one. A message is a basic regular expression.
messages=()
plant() {
    [ ${#messages[@]} -gt 0 ] || fresh
    cp "$work/$2" "$work/before"
    sed -i "$3" "$work/$2"
    cmp -s "$work/$2" "$work/before" && { echo "nothing planted: $1"; status=1; }
    messages+=("$1" "$4")
}
told() {
    local i
    check && { echo "not told: ${messages[0]}"; status=1; }
    for ((i = 0; i < ${#messages[@]}; i += 2)); do
        grep -q -- "${messages[i + 1]}" "$work/said" ||
            { echo "${messages[i]}: '${messages[i + 1]}' is missing in:"; head -5 "$work/said"; status=1; }
    done
    messages=()
}

fresh
check || { cat "$work/said"; status=1; }
plant "a row without published numbers" thesis.ini 's/^published = 10913$//' 'has no `published`'
plant "a row with no chapter" thesis.ini '/^\[table 6.8\]$/,/^what/s/^chapter = 6$/chapter = 7/' "has no chapter"
plant "a row with nothing to show" thesis.ini '/^\[figure 6.1\]$/,/^\[section/s/^drawing = .*//' "has neither numbers nor"
plant "a reason of a word" thesis.ini 's/^missing = No scene .*/missing = no/' "is no sentence"
plant "an unknown option" thesis.ini 's/--method variational/--methodic x/' "there is no option --methodic"
plant "an unknown program" thesis.ini 's/^run = lg-gradcheck/run = lg-gradchecks/' "there is no program"
plant "an unknown command" thesis.ini 's/lg-elastica solve --/lg-elastica solves --/' "there is no command solves"
plant "an unknown scene" thesis.ini 's,scenes/rigid-body.yaml,scenes/no.yaml,' "there is no file scenes/no.yaml"
plant "a plot that is not there" thesis.ini 's/integrators-event.svg/no-event.svg/' "there is no plots/no-event.svg"
plant "no comparison and no reason" thesis.ini '0,/^unlike = other data/s/^unlike = other data.*//' "^figure 6.3: .* do not both say"
plant "other data that count" thesis.ini '/^\[table 6.8\]$/,/^unlike/s/^better = unlike unlike/better = lower higher/' "^table 6.8: .* do not both say"
plant "a word that compares nothing" thesis.ini 's/^better = again$/better = often/' "unknown word"
plant "another command than was run" thesis.ini 's/--tol 1e-13/--tol 1e-12/' "^table 3.1: .*was not run as it stands"
plant "a number typed into the data" data/thesis.csv '/^table 4.1,/s/e-05/e-06/' "says otherwise"
told
plant "a key that nobody reads" thesis.ini 's/^better = lower/beter = lower/' "unknown key beter"
told
plant "a range typed into the page" thesis.md '/^| table 5.3/s/ to / up to /' "thesis.md is not what"
told
plant "a number typed into the page" thesis.md '/^| table 4.3/s/e-12/e-13/2' "thesis.md is not what"
told
exit $status
