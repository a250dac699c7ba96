# No text of a file and no name of a file reaches the terminal as a control character, or begins a line of its own. Every
# command of every program is run on files whose names and texts hold escape sequences: with one and two of them in every
# combination that it takes, and in the ways of `use` that succeed; as text and as JSON.
# shellcheck disable=SC2086 # words are split on purpose
set -u
export LC_ALL=C
ulimit -t 100 # CPU time of each command, in seconds
status=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
fail() { echo "$*"; status=1; }

# verbs PROGRAM: its commands, or one empty word.
verbs() { "$LG_BIN_DIR/$1" --help | awk '/^Commands:/ { on = 1; next } on && /^$/ { exit } on && /^  [a-z]/ { print $1 }'; }

# A title, a colour, C1 as UTF-8, CR, DEL, a mark that reverses the line, a byte that is not UTF-8, and a line of its own.
bad=$'\e]0;title\a\e[31m\xc2\x9b1m\r\x7f\xe2\x80\xae\xff\nFORGED'
runs=0 succeeded=0 commands=()
mkdir said

# run COMMAND...: its exit code is in `found`, what it printed in the files $out and $err, which `check` reads.
run() {
    out=said/$runs.out err=said/$runs.err
    printf -v "commands[$runs]" '%q ' "$@"
    runs=$((runs + 1))
    "$LG_BIN_DIR/$1" "${@:2}" >"$out" 2>"$err" </dev/null
    found=$?
}

# wrong WHAT FILE [PATTERN]
wrong() {
    local name=${2#said/}
    fail "$1: ${commands[${name%.*}]}: $(grep -aP -- "${3:-}" "$2" | head -n 3 | cat -v)"
}

# What all commands printed. A cell of CSV in quotes may begin a line.
check() {
    local file name control='[\x00-\x08\x0b-\x1f\x7f]|\xc2[\x80-\x9f]|\xe2\x80[\x8e\x8f\xa8-\xae]|\xe2\x81[\xa6-\xa9]' forged='^FORGED|\tFORGED'
    for file in $(grep -laP -- "$control" said/*); do wrong "a control character" "$file" "$control"; done
    if ! iconv -f UTF-8 -t UTF-8 said/* >/dev/null 2>&1; then
        for file in said/*; do iconv -f UTF-8 -t UTF-8 "$file" >/dev/null 2>&1 || wrong "not UTF-8" "$file"; done
    fi
    for file in $(grep -laP -- "$forged" said/*); do
        name=${file#said/}
        case ${commands[${name%.*}]} in *lg-fit\ predict*) ;; *) wrong "a forged line" "$file" "$forged" ;; esac
    done
    shown=$(grep -laE '\\x1b|\\xc2\\x9b|\\u001b|\\u009b' said/* | sed 's/\..*//' | sort -u | wc -l)
}

# use [WORDS...]: must succeed, with text and with --json.
use() {
    local json
    for json in '' --json; do
        case "$json $*" in '--json '*' predict '*) [[ $* = *--out* ]] || continue ;; esac # CSV on standard output
        # A log of verdicts does not go on in JSON, and a model replaces none of another kind.
        rm -f "watch$bad.log" "x$bad.h5"
        run "$@" $json
        [ $found = 0 ] || fail "$(printf '%q ' "$@" $json): exit code $found: $(head -c 300 "$err")"
        succeeded=$((succeeded + 1))
    done
}

# ---- files; those with `bad` in their name hold it inside, too ----
quoted=\"$bad\"
{
    printf '"a%s","b%s","c%s","y%s"\n' "$bad" "$bad" "$bad" "$bad"
    for i in $(seq 60); do
        if [ $((i * 7 % 3)) = 0 ]; then class=$bad; else class=x$bad; fi
        printf '%s,%s,"%s",%s\n' $i $((i * 7 % 3)).$((i * 13 % 10)) "$class" $((i * i % 50))
    done
} >"table$bad.csv"
run lg-fit train "table$bad.csv" --without "\"c$bad\"" --epochs 2 --out "fit$bad.h5"
run lg-fit train "table$bad.csv" --class "\"c$bad\"" --inputs "\"a$bad\",\"b$bad\"" --epochs 3 --hidden 4 --out "class$bad.h5"
"$LG_BIN_DIR/lg-anomaly" generate --noise 10 --runs 4 --hours 1 --out series.h5 >out
sed 's/intact|broken/\x1b[31m\n|\xc2\x9b\x07\x1b[m/; s/intact/\x1b[31m\n/; s/acc_lower_x|acc_lower_y/\x1b[31mower_x|\n\xe2\x80\xaeFORGED_/' series.h5 >"series$bad.h5"
run lg-anomaly train "series$bad.h5" --method logistic --out "detector$bad.h5"
cat >scene.yaml <<'END'
{system: pendulum-chain, form: hamiltonian, gravity: 1, masses: [1], lengths: [1], t_end: 0.1, starts: {kind: thesis}}
END
cp scene.yaml "scene$bad.yaml"
printf 'system: pendulum-chain\n"k\\e[31m\\x9b\\nFORGED": 1\n' >"wrong$bad.yaml"
printf 'name: "\\e]0;t\\a\\x9b\\nFORGED"\nkind: rkmk\norder: 1\nc: [0]\na: [[]]\nb: [1]\n' >"scheme$bad.yaml"
"$LG_BIN_DIR/lg-hamiltonian" generate scene.yaml --trajectories 20 --out data.h5 >out
sed 's/pendulum-chain/\x1b[31m\n\xc2\x9bFORGE/' data.h5 >"data$bad.h5"
run lg-hamiltonian train data.h5 --epochs 2 --hidden 4 --out "hamiltonian$bad.h5"
sed 's/hamiltonian/\x1b[31m\nFORGE/g' "hamiltonian$bad.h5" >"kind$bad.h5"
machine='columns: {time: "t\x9b", run: run}
coordinates:
  - {name: x, kind: line, columns: ["x\x9b\u202e"], velocity: "vx\x9b\u202e"}
inputs: {columns: ["u\x9b\u202e"]}
'
printf '%s' "$machine" 'mass: {kind: known, values: [1]}
potential: none
damping: {kind: known, values: [0.1]}
input_map: {kind: known, values: [[1]]}
' >"truth$bad.yaml"
printf '%s' "$machine" 'mass: {kind: diagonal}
potential: none
damping: diagonal
input_map: {kind: known, values: [[1]]}
' >"machine$bad.yaml"
run lg-identify generate "truth$bad.yaml" --inputs steps --amplitude 5 --runs 2 --t-end 2 --out "log$bad.csv"
run lg-identify fit "machine$bad.yaml" "log$bad.csv" --epochs 30 --out "machine$bad.h5"
cat >"task$bad.yaml" <<'END'
plant: "PLANT"
goal: {x: 0}
period: 0.1
horizon: 2
starts: {x: [-0.5, 0.5], "vx\x9b\u202e": [-0.5, 0.5]}
limits: {"u\x9b\u202e": 10}
cost: {x: 1, "vx\x9b\u202e": 0.1, "u\x9b\u202e": 0.01}
success: {x: 0.05, hold: 0.5, within: 4}
controller: {kind: lqr}
END
cp "truth$bad.yaml" truth.yaml
sed -i s/PLANT/truth.yaml/ "task$bad.yaml"
run lg-control train "task$bad.yaml" --seconds 1 --out "policy$bad.h5"
printf 'fixed: {epochs: 2}\nranges:\n  hidden: {choice: ["4", "8"]}\n  "\\e[31m\\x9b": {integer: [1, 2]}\n' >"search$bad.yaml"
printf 'fixed: {epochs: 2}\nranges:\n  weight-decay: {uniform: [0, 1e-3]}\n' >search.yaml
for file in table fit class series detector scene wrong scheme data hamiltonian kind truth machine log task policy search; do
    ls "$file$bad".* >/dev/null 2>&1 || fail "$file: was not made: $(cat -v "$err" | head -n 3)"
done

# ---- what succeeds ----
use lg-fit train "table$bad.csv" --class "\"c$bad\"" --inputs "\"a$bad\"" --epochs 3 --hidden 4 --out "x$bad.h5" --plot "x$bad.svg"
use lg-fit evaluate "class$bad.h5" "table$bad.csv"
use lg-fit predict "class$bad.h5" "table$bad.csv"
use lg-fit predict "class$bad.h5" "table$bad.csv" --out "x$bad.csv"
use lg-fit evaluate "fit$bad.h5" "table$bad.csv"
use lg-fit predict "fit$bad.h5" "table$bad.csv"
use lg-fit search search.yaml "table$bad.csv" --class "\"c$bad\"" --inputs "\"a$bad\"" --trials 2 --out "trials$bad.csv"
for method in logistic tree svm-linear rocket; do
    use lg-anomaly train "series$bad.h5" --method $method --out "x$bad.h5"
done
use lg-anomaly evaluate "detector$bad.h5" "series$bad.h5" --scores "scores$bad.csv"
"$LG_BIN_DIR/lg-anomaly" feed --hours 1 | tail -n +2 >"feed$bad.csv"
use lg-anomaly watch "detector$bad.h5" --input "feed$bad.csv"
use lg-anomaly watch "detector$bad.h5" --input "feed$bad.csv" --log "watch$bad.log"
grep -qaP '[\x00-\x08\x0b-\x1f\x7f]' "watch$bad.log" && fail "a control character in the log of watch"
use lg-simulate "scene$bad.yaml" --scheme "./scheme$bad.yaml" --steps 5 --out "run$bad.h5"
use lg-hamiltonian evaluate "hamiltonian$bad.h5" data.h5
use lg-hamiltonian predict "hamiltonian$bad.h5" "scene$bad.yaml" --t-end 1 --out "flow$bad.h5"
use lg-identify check "machine$bad.yaml" "log$bad.csv"
use lg-identify fit "machine$bad.yaml" "log$bad.csv" --epochs 30 --out "x$bad.h5" --suggest "suggest$bad.yaml"
use lg-identify evaluate "machine$bad.h5" "log$bad.csv"
use lg-identify predict "machine$bad.h5" "log$bad.csv" --out "predicted$bad.csv" --bands
use lg-identify check "machine$bad.yaml" "predicted$bad.csv" # a command reads what a command writes
use lg-fit train "scores$bad.csv" --class truth --inputs window --epochs 2 --hidden 4 --out "x$bad.h5"
use lg-identify adapt "machine$bad.h5" "log$bad.csv" --seconds 1 --out "adapted$bad.h5"
use lg-control evaluate "policy$bad.h5" --starts 5 --runs "runs$bad.csv"
use lg-fit train "runs$bad.csv" --outputs cost --inputs start,t --epochs 2 --hidden 4 --out "x$bad.h5"
for model in fit class detector hamiltonian machine policy; do
    use lg-export "$model$bad.h5" --name model --out "export$bad"
done

# ---- every command, on every file and every pair of different kinds ----
verbs=0
for program in $(cd "$LG_BIN_DIR" && echo lg-*); do
    for verb in $(verbs "$program") none; do
        [ "$verb" = none ] && [ -n "$(verbs "$program")" ] && continue
        [ "$verb" = none ] && verb=
        # A demonstration and a measurement read no file, and take minutes.
        case "$program $verb" in *' demo' | 'lg-bench list' | lg-gradcheck*) run "$program" $verb "$bad" && verbs=$((verbs + 1)) && continue ;; lg-bench*) continue ;; esac
        verbs=$((verbs + 1)) pairs=yes given=()
        help=$("$LG_BIN_DIR/$program" $verb --help-all)
        case $help in *--out=*) given+=("--out=x$bad.h5") ;; esac
        case $help in *--recipe=*) given+=(--recipe=machine_model) ;; esac
        case "$program $verb" in 'lg-identify adapt') given+=(--seconds=1) ;; esac
        run "$program" $verb --out "no/$bad" "--no$bad"
        for a in "table$bad.csv" "class$bad.h5" "detector$bad.h5" "wrong$bad.yaml" "data$bad.h5" "kind$bad.h5" "no$bad"; do
            run "$program" $verb "$a" "${given[@]}" --json
            for b in "table$bad.csv" "series$bad.h5" "kind$bad.h5" "no$bad"; do
                [ $pairs = yes ] && run "$program" $verb "$a" "$b" "${given[@]}"
                [[ $(<"$err") = *'too many arguments'* ]] && pairs=no
            done
        done
    done
done

# A name with every control character leaves none to mark the ends of lines.
every=$(for i in $(seq 31); do printf "\\$(printf %o "$i")"; done; echo FORGED)
run lg-fit evaluate "no$every" "no$every"
[ "$(wc -l <"$err")" = 1 ] || fail "a name of control characters: $(cat -v "$err")"

# ---- harmless text stays as it is, byte by byte, also where buffers end ----
{
    printf 'u,"größe, Ω 数 😀",w\n'
    for i in $(seq 1500); do printf '%s,%s,%s数\n' $i $((i * i % 17)) $((i % 3))äöü😀; done
} >harmless.csv
run lg-fit train harmless.csv --class w --epochs 2 --hidden 2 --out harmless.h5
"$LG_BIN_DIR/lg-fit" predict harmless.h5 harmless.csv >printed.csv
run lg-fit predict harmless.h5 harmless.csv --out written.csv
cmp -s printed.csv written.csv || fail 'harmless text is printed otherwise than it is written'

# ---- what was printed ----
check
echo "$verbs commands, $runs runs, $succeeded of the ways that succeed; names were shown in $shown runs"
[ $verbs -gt 35 ] || fail "$verbs commands"
[ $shown -gt $((runs / 2)) ] || fail "names were shown in few runs"
exit $status
