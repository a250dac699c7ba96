#!/bin/bash
# lg-export when memory ends: the n-th allocation fails, alone or with all later ones, for every target. The files must be
# byte for byte those of a run with enough memory, or there must be a message and no files. Tests some n; all with
# LG_EVERY=1. Only allocations of liegrad and the C library fail, because HDF5 crashes when its own fail.
# ctest-labels: slow apps/lg-export
set -u
bin=$LG_BIN_DIR
export PATH=$bin:$PATH LC_ALL=C
shim=$bin/../tests/fail_nth.so
every=${LG_EVERY:-0}
samples=5
folder=$(mktemp -d "${TMPDIR:-/tmp}/lg-memory-XXXXXX")
trap 'rm -rf "$folder"' EXIT
cd "$folder" || exit 2
if grep -qE '__[at]san_init' "$bin/lg-export"; then exit 77; fi
failures=0
runs=0
refused=0

cat >pendulum.yaml <<'YAML'
system: pendulum-chain
form: hamiltonian
gravity: 1
masses: [1]
lengths: [1]
t_end: 0.1
starts: {kind: thesis}
YAML
{
    echo a,b,y
    for i in $(seq 40); do echo "$i,$((i * i % 17)),$((3 * i + i * i % 5))"; done
} >table.csv
lg-hamiltonian generate pendulum.yaml --trajectories 60 --points 10 --out data.h5 >out.txt || exit 2
lg-hamiltonian train data.h5 --epochs 2 --hidden 4 --out motion.h5 >out.txt 2>&1 || exit 2
lg-fit train table.csv --inputs a,b --outputs y --size 4 --epochs 2 --out table.h5 >out.txt 2>&1 || exit 2

fail() {
    failures=$((failures + 1))
    echo "$model to $target, $before before, allocations $from to $to fail: $*"
}
# is FOLDER: now/out must have the files of the folder and no others, and nothing may be next to it.
is() {
    [ "$(ls -A now)" = out ] && diff -r now/out "$1" >/dev/null 2>&1
}
# try BEFORE FROM TO: BEFORE says what is at the output: nothing, or the files of another model.
try() {
    local before=$1 from=$2 to=$3 code
    rm -rf now
    mkdir now
    [ $before = nothing ] || cp -r "$before" now/out
    LG_FAIL_FROM=$from LG_FAIL_TO=$to LD_PRELOAD=$shim timeout -k 1 20 \
        lg-export $model.h5 --json --out now/out --name it --target $target >now.txt 2>now.err
    code=$?
    runs=$((runs + 1))
    case $code in
    0)
        is all/out || fail "exit code 0 with other files"
        cmp -s now.txt all.txt || fail "exit code 0 with another result"
        ;;
    3 | 5)
        refused=$((refused + 1))
        [ "$(wc -l <now.err)" = 1 ] || fail "told: $(cat now.err)"
        grep -qE "memory|allocation failed" now.err || fail "no word of memory: $(cat now.err)"
        # the message is printed after the files are written
        if [ $before = nothing ]; then
            [ -z "$(ls -A now)" ] || is all/out || fail "exit code $code, left: $(cd now && find . -type f | head -3)"
        else
            is "$before" || is all/out || fail "exit code $code, files of both"
        fi
        ;;
    *) fail "exit code $code $(head -c 300 now.err)" ;;
    esac
}
# sweep MODEL TARGET OTHER: samples over all n, each alone and with all later ones, and the last n, where files are
# written.
sweep() {
    local model=$1 target=$2 other=$3 count step k n before=nothing from=0 to=0
    rm -rf all old
    mkdir all
    lg-export $other.h5 --out old --name it --target $target >old.txt 2>&1 || fail "$(cat old.txt)"
    LG_FAIL_COUNT=$folder/count LD_PRELOAD=$shim \
        lg-export $model.h5 --json --out all/out --name it --target $target >all.txt 2>all.err || fail "$(cat all.err)"
    count=$(cat count)
    # without LG_EVERY: more of the early n, where a model is taken apart; later its numbers are written
    for ((k = 0, n = 1; n <= count; k++)); do
        try nothing $n $n
        try nothing $((n + count / 50)) 1000000000
        n=$((every > 0 ? n + every : 1 + count * (k + 1) ** 2 / samples ** 2))
    done
    # the last n lock and replace files; for one target all of them are tested
    step=12
    [ $every = 0 ] && [ $target != onnx ] || step=1
    for ((n = count - 20; n <= count + 12; n += step)); do try old $n $n; done
}
for target in ${LG_TARGETS:-c casadi fmu2 onnx safetensors}; do
    sweep motion $target table
    sweep table $target motion
done
echo "$runs runs, $refused refused, $failures failures"
[ $failures = 0 ] && [ $refused -gt 0 ]
