# scripts/golden.txt has a command of every program and verb, but for the lines "# no row: PROGRAM VERB - reason"
# (regular expressions), and of every export target and kind of model, as the programs list them.
# ctest-labels: apps/common scripts/golden.txt
# shellcheck disable=SC2086 # words are split on purpose
set -u
export LC_ALL=C
list=$LG_TEST_DIR/../scripts/golden.txt
rows=$(grep -v '^#' "$list")
status=0

# verbs PROGRAM: its commands.
verbs() { "$LG_BIN_DIR/$1" --help | awk '/^Commands:/ { on = 1; next } on && /^$/ { exit } on && /^  [a-z]/ { print $1 }'; }

# need PATTERN WHAT: a row has the pattern.
need() { grep -Eq -- "$1" <<<"$rows" || { echo "scripts/golden.txt: there is no row of $2"; status=1; }; }

for program in $(cd "$LG_BIN_DIR" && echo lg-*); do
    need "(^|[ ;(])$program " "$program"
    for verb in $(verbs "$program"); do
        left=$(sed -nE 's/^# no row: (.*) - .+/\1/p' "$list" | while read -r pattern; do [[ "$program $verb" =~ ^$pattern$ ]] && echo out; done)
        [ -n "$left" ] || need "(^|[ ;(])$program $verb( |\$)" "$program $verb"
    done
done

# Options that choose a kind: a row has each of the names in the message about a name that is not known.
while read -r command option; do
    words=$("$LG_BIN_DIR/"${command//,/ } $option '?' 2>&1 | tr '\n' ' ' | sed -nE 's/.* is not one of ([a-z0-9_, -]*)( Try.*)?$/\1/p')
    [ -n "$words" ] || { echo "${command//,/ } $option '?' does not list names"; status=1; }
    for word in ${words//,/ }; do
        need "${command%%,*} .*$option ([^ ]*[{,])?$word([,} ]|\$)" "${command%%,*} $option $word"
    done
done <<'END'
lg-export,absent.h5,--out,absent --target
lg-learn,train,absent.h5,--out,absent --recipe
lg-anomaly,train,absent.h5,--out,absent --method
lg-elastica,train,absent.h5,--out,absent --network
lg-hamiltonian,train,absent.h5,--out,absent --potential
lg-hamiltonian,train,absent.h5,--out,absent --symmetry
lg-fit,train,absent.h5,--out,absent --network
lg-fit,train,absent.h5,--out,absent --activation
lg-control,certify,absent.h5 --lyapunov
END
exit $status
