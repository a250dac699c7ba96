# Every demo, as --help lists them: folders of any name, which run nothing; one JSON object; the code of the command that
# fails, after which none runs; a folder of another process; and signals, after which no process runs.
# ctest-labels: slow apps/common apps/demo apps/lg-hamiltonian apps/lg-identify apps/lg-control
set -u
export LC_ALL=C OPENBLAS_NUM_THREADS=1
status=0 demos=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
fail() { echo "$*"; status=1; }
# demo CODE WORDS PROGRAM OPTIONS...: runs its demo; its results are in the file out.
demo() {
    local code=$1 words=$2 found
    shift 2
    said=$(timeout 120 "$LG_BIN_DIR/$1" demo "${@:2}" 2>&1 >"$work/out" </dev/null)
    found=$?
    [ $found = "$code" ] || fail "$*: exit code $found, not $code: $said"
    case $said in *"$words"*) ;; *) fail "$*: '$words' is not in '$said'" ;; esac
}

# Options with which a demo takes seconds, its exit code, and an output of a command after which others follow.
declare -A short=([lg-hamiltonian]='--epochs 2 --t-end 1' [lg-identify]='--epochs 2 --seconds 1' [lg-control]='--seconds 1')
declare -A code=([lg-hamiltonian]=0 [lg-identify]=4 [lg-control]=0)
declare -A output=([lg-hamiltonian]=test.h5 [lg-identify]=test.csv [lg-control]=cart.h5)
hostile=$'-n "o\' $(touch RAN) `touch RAN`;touch RAN\n&& touch RAN #'
for program in $(cd "$LG_BIN_DIR" && echo lg-*); do
    "$LG_BIN_DIR/$program" --help | grep -q '^  demo ' || continue
    [ -n "${short[$program]:-}" ] || { fail "$program demo: no case"; continue; }
    demos=$((demos + 1))
    mkdir "$program" && cd "$program" || exit 1
    # shellcheck disable=SC2206 # words are split on purpose
    options=(${short[$program]})

    demo "${code[$program]}" '' "$program" "${options[@]}" "--out=$hostile"
    [ "$(find . -mindepth 1 -maxdepth 1 -printf '%P|')" = "$hostile|" ] || fail "$program: files outside its folder: $(ls)"
    [ -s "$hostile/${output[$program]}" ] || fail "$program: no ${output[$program]} in its folder: $(ls "$hostile")"
    [ -z "$(find . -name 'RAN*')" ] || fail "$program: the name of its folder was run"
    shown=$(grep -c '^\$ ' "$work/out")
    [ "$shown" -gt 4 ] || fail "$program: shows $shown commands"

    demo "${code[$program]}" '' "$program" "${options[@]}" "--out=$hostile" --json
    python3 -c 'import json, sys; assert isinstance(json.load(sys.stdin), dict)' <"$work/out" || fail "$program --json: $(cat "$work/out")"

    mkdir foreign && echo notes >"foreign/${output[$program]}"
    demo 3 "${output[$program]}: exists" "$program" "${options[@]}" --out foreign
    case $said in *"$program demo: '"*"' ended with exit code 3"*) ;; *) fail "$program: does not say which command failed: $said" ;; esac
    case $(grep '^\$ ' "$work/out" | tail -n 1) in *"${output[$program]}"*) ;; *) fail "$program: runs on after a failure: $(cat "$work/out")" ;; esac
    case $(env PATH=/nowhere "$LG_BIN_DIR/$program" demo --out foreign 2>&1; echo $?) in
        *'bash cannot be started'*3) ;;
        *) fail "$program: starts without bash" ;;
    esac
    [ ! -c /dev/full ] || { "$LG_BIN_DIR/$program" demo "${options[@]}" --out full >/dev/full 2>/dev/null
        found=$?; [ $found = 3 ] || fail "$program: exit code $found where standard output is full"; }
    cd ..
done
[ $demos -gt 2 ] || fail "only $demos demos"

CC=false demo 2 "'make -B -f Makefile -C swingup test' ended with exit code 2" lg-control --seconds 1 --out failing

# A training of 30 s is stopped: its state is saved, and no process works in the folder. Meanwhile the folder is taken.
for signal in INT TERM; do
    : >shown
    "$LG_BIN_DIR/lg-control" demo --seconds 30 --out stopped >shown 2>said &
    for _ in $(seq 600); do grep -q '^\$ lg-control train' shown && break; sleep 0.05; done
    sleep 1
    demo 3 'stopped' lg-control --seconds 1 --out stopped
    grep -q '^\$ ' "$work/out" && fail "the demo runs in a folder of another process: $(cat "$work/out")"
    kill -s $signal $!
    wait $!
    found=$?
    [ $found = $((128 + $(kill -l $signal))) ] || fail "SIG$signal: exit code $found: $(cat said)"
    [ -s stopped/policy.h5.checkpoint ] || fail "SIG$signal: the training's state is not saved: $(cat said)"
    for process in /proc/[0-9]*; do
        case $(readlink "$process/cwd") in "$work/stopped"*) fail "SIG$signal: still runs: $(tr '\0' ' ' <"$process/cmdline")" ;; esac
    done
    rm -r stopped
done
exit $status
