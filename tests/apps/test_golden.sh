# scripts/golden.txt has a command of every program and verb, and one with --plot if it draws, but for the lines
# "# no row: PROGRAM VERB [--plot] - reason" (regular expressions), of the executable under its own name, of every word of the options below, system, kind of
# coordinate, term, potential, hold and controller as the programs list them, and of every family of Hamiltonians.
# ctest-labels: apps/ src/machine/ src/hamiltonian/ src/mechanics/ scripts/golden.txt
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

# left_out COMMAND: a line says why it has no row.
left_out() {
    local pattern
    while read -r pattern; do [[ $1 =~ ^$pattern$ ]] && return; done < <(sed -nE 's/^# no row: (.*) - .+/\1/p' "$list")
    return 1
}

# check COMMAND: it has a row, and one that draws a plot, if it can.
check() {
    left_out "$1" && return
    need "(^|[ ;(])$1( |\$)" "$1"
    "$LG_BIN_DIR/"$1 --help-all 2>&1 | grep -q -- ' --plot=' && ! left_out "$1 --plot" && need "(^|[ ;(])$1 .*--plot " "$1 --plot"
}

for program in $(cd "$LG_BIN_DIR" && echo lg-*); do
    check "$program"
    for verb in $(verbs "$program"); do check "$program $verb"; done
done

need '(^|[ ;(])liegrad (lg-)?[a-z]+ ' 'liegrad PROGRAM'

# listed TEXT: the words that a message lists.
listed() {
    tr '\n' ' ' <<<"$1" | sed -nE 's/.*(is not one of|is none of|one of|neither|known:|expected|systems are:|methods are|integral; take) ([a-z0-9_, -]*).*/\2/p' |
        sed -E 's/ (nor|Try|or the file).*//; s/ or / /; s/,/ /g'
}

# check_words WHAT BEFORE MESSAGE: a row has BEFORE and then each word of the message; `none` stands for no term.
check_words() {
    local word words
    words=$(listed "$3")
    [ -n "$words" ] || { echo "$1: no names in '$3'"; status=1; }
    for word in $words; do
        [ "$word" = none ] || need "$2([^ ]*[{,])?$word([]:,} \\/]|\$)" "$1 $word"
    done
}

# Options that choose a kind.
while read -r command option; do
    program=${command%%,*}
    check_words "$program $option" "$program .*$option " "$("$LG_BIN_DIR/"${command//,/ } $option '?' 2>&1)"
done <<END
lg-export,absent.h5,--out,absent --target
lg-learn,train,absent.h5,--out,absent --recipe
lg-anomaly,train,absent.h5,--out,absent --method
lg-anomaly,train,absent.h5,--out,absent --features
lg-elastica,train,absent.h5,--out,absent --network
lg-elastica,train,absent.h5,--out,absent --architecture
lg-elastica,train,absent.h5,--out,absent --method
lg-hamiltonian,train,absent.h5,--out,absent --potential
lg-hamiltonian,train,absent.h5,--out,absent --symmetry
lg-hamiltonian,train,absent.h5,--out,absent --penalty-integral
lg-fit,train,absent.h5,--out,absent --network
lg-fit,train,absent.h5,--out,absent --activation
lg-fit,train,absent.h5,--out,absent --method
lg-identify,fit,absent.yaml,absent.csv,--out,absent --method
lg-control,certify,absent.h5 --lyapunov
lg-simulate,$LG_TEST_DIR/../scenes/pendulum.yaml --method
END

# Words of files: WHAT, what stands before them in a row, and a file with a wrong one. The key of a term's part stands
# before it in the same line of the file: a line ends with \n, or where a command of sed does.
work=$(mktemp -d)
trap 'rm -r "$work"' EXIT
machine='columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\n'
while IFS='|' read -r what before text; do
    printf '%b\n' "${text/MACHINE/$machine}" >"$work/file.yaml"
    case $what in
    controller) said=$("$LG_BIN_DIR/lg-control" train "$work/file.yaml" --out "$work/absent" 2>&1) ;;
    *) said=$("$LG_BIN_DIR/lg-identify" check "$work/file.yaml" "$work/file.yaml" 2>&1) ;;
    esac
    check_words "$what" "$before" "$said"
done <<'END'
coordinate|kind: |columns: {time: t}\ncoordinates: [{name: x, kind: '?', velocity: v}]
mass|mass: ([^\\/;]*[ {])?|MACHINEmass: {kind: '?'}
potential|potential: ([^\\/;]*[ {])?|MACHINEpotential: {kind: '?'}
damping|damping: ([^\\/;]*[ {])?|MACHINEdamping: {kind: '?'}
input_map|input_map: ([^\\/;]*[ {])?|MACHINEinputs: {columns: [u]}\ninput_map: {kind: '?'}
residual|residual: ([^\\/;]*[ {])?|MACHINEresidual: {kind: '?'}
bias|bias: ([^\\/;]*[ {])?|MACHINEbias: {kind: '?'}
form of a known potential|form: |MACHINEpotential: {kind: known, form: '?', of: x, values: [1]}
system of a machine|system: |MACHINEsystem: '?'
measured|measured: |MACHINEmeasured: '?'
hold|hold: |MACHINEinputs: {columns: [u], hold: '?'}
controller|kind: |plant: absent\ncontroller: {kind: '?'}
END
need 'dead_zone: ' 'a dead zone'

# Systems of lg-simulate: a row has a scene of each.
printf "system: '?'\n" >"$work/scene.yaml"
systems=$(listed "$("$LG_BIN_DIR/lg-simulate" "$work/scene.yaml" 2>&1)")
[ -n "$systems" ] || { echo 'lg-simulate does not list its systems'; status=1; }
for system in $systems; do
    scenes=$(cd "$LG_TEST_DIR/../scenes" && grep -lE "^system: $system( |\$)" -- *.yaml | sed 's/.yaml//' | paste -sd '|')
    need "lg-simulate .*scenes/([^ ]*[{,])?(${scenes:-none})[.,}]" "a scene of $system"
done

# Families of Hamiltonians: a row trains data that are named for each row of the table.
families=$(sed -n '/define LG_HAMILTONIAN_FAMILIES/,/[^\\]$/p' "$LG_TEST_DIR/../src/hamiltonian/internal.h" | grep -oE 'X\([a-z_]+\)' | tr _ - | tr -d 'X()')
[ -n "$families" ] || { echo 'there is no table of families'; status=1; }
for family in $families; do
    need "lg-hamiltonian train family-([^ ]*[{,])?${family}[.,}]" "the family $family"
done
exit $status
