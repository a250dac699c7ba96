# Every command that reads a file must refuse a pipe without a writer at once, and no command may keep running after
# SIGTERM because of it.
# shellcheck disable=SC2086 # words are split on purpose
set -u
export LC_ALL=C
status=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
mkfifo pipe
fail() { echo "$*"; status=1; }

# try PROGRAM WORDS...: sets the exit code and the output; 124: SIGTERM ended the program, 137: SIGTERM did not.
try() {
    local program=$1
    shift
    said=$(timeout -k 2 10 "$LG_BIN_DIR/$program" "$@" 2>&1 </dev/null)
    found=$?
    count=$((count + 1))
}
refused() {
    try "$@"
    case $found$said in 3*'pipe: is not a regular file'*) ;; *) fail "$*: exit code $found: $said" ;; esac
}

# verbs PROGRAM: its commands, or one empty word.
verbs() { "$LG_BIN_DIR/$1" --help | awk '/^Commands:/ { on = 1; next } on && /^$/ { exit } on && /^  [a-z]/ { print $1 }'; }

count=0
for program in $(cd "$LG_BIN_DIR" && echo lg-*); do
    for verb in $(verbs "$program") none; do
        [ "$verb" = none ] && [ -n "$(verbs "$program")" ] && continue
        [ "$verb" = none ] && verb=
        case "$program $verb" in 'lg-simulate merge' | lg-bench* | lg-gradcheck* | *' demo') continue ;; esac
        for inputs in pipe 'pipe pipe'; do # as many inputs as the command takes
            try "$program" $verb $inputs --out=x.h5
            case $said in *"option '--out=x.h5'"*) try "$program" $verb $inputs ;; esac
            case $found$said in
                2*) ;; # a wrong number of arguments, or another missing argument
                3*': pipe: is not a regular file'*) ;;
                *) fail "$program $verb $inputs: exit code $found: $said" ;;
            esac
        done
    done
done

# Files that are read after other files, and files given by options.
for i in $(seq 40); do echo "$i,$((i * i % 17)),$((i * 3 + i * i % 5))"; done | sed '1ia,b,y' >table.csv
cat >machine.yaml <<'END'
columns: { time: a }
coordinates: [{ name: b, kind: line, velocity: y }]
measured: velocities
mass: { kind: diagonal }
potential: none
END
"$LG_BIN_DIR/lg-fit" train table.csv --epochs 1 --out model.h5 >/dev/null 2>&1
"$LG_BIN_DIR/lg-anomaly" generate --noise 10 --runs 2 --hours 1 --out series.h5 >/dev/null 2>&1
"$LG_BIN_DIR/lg-anomaly" train series.h5 --method logistic --out detector.h5 >/dev/null 2>&1
refused lg-fit train table.csv --test pipe --out x.h5
refused lg-fit train table.csv --resume pipe --out x.h5
refused lg-fit evaluate model.h5 pipe
refused lg-fit predict model.h5 pipe
refused lg-identify check machine.yaml pipe
refused lg-identify fit machine.yaml pipe --out x.h5
refused lg-identify fit machine.yaml table.csv --validation pipe --out x.h5
refused lg-anomaly evaluate detector.h5 pipe
refused lg-anomaly train series.h5 --method tree --test pipe --out x.h5
refused lg-export model.h5 --scheme ./pipe --out x
try lg-bench hamiltonian --weights pipe
[ $found = 3 ] || fail "lg-bench --weights: exit code $found: $said"

# A feed is read while it is written: the program waits for it, and ends at the first SIGTERM.
said=$(timeout -k 2 2 "$LG_BIN_DIR/lg-anomaly" watch detector.h5 --input pipe 2>&1 </dev/null)
found=$?
[ $found = 124 ] || fail "lg-anomaly watch --input: exit code $found: $said"
[ $count -gt 30 ] || fail "$count commands"
exit $status
