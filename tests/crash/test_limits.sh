#!/bin/bash
# The commands at the limits of the system: a full disk, folders that cannot be written, limits on memory, file size and
# descriptors, signals, closed pipes, clocks that jump, two writers of one output. A failure prints the test's line.
# ctest-labels: slow src/files apps/common
set -u
bin=$LG_BIN_DIR
export PATH=$bin:$PATH LC_ALL=C
folder=$(mktemp -d "${TMPDIR:-/tmp}/lg-limits-XXXXXX")
failures=0
mounted=
leave() {
    [ -z "$mounted" ] || umount "$mounted"
    chmod -R u+w "$folder"
    rm -rf "$folder"
}
trap leave EXIT
cd "$folder" || exit 2
mkdir in w

# fail WORDS: prints WORDS with the line of the test.
fail() {
    echo "test_limits.sh: lines ${BASH_LINENO[*]}: $*"
    failures=$((failures + 1))
}
# expect CODE WORDS COMMAND...: the command must return CODE, and WORDS must be in standard error (empty: nothing is
# required).
expect() {
    local code=$1 words=$2 got
    shift 2
    timeout -k 5 600 "$@" >out.txt 2>err.txt
    got=$?
    [ $got = "$code" ] || fail "exit code $got, not $code: $* $(cat err.txt)"
    [ -z "$words" ] || grep -qF -- "$words" err.txt || fail "no '$words' of $*: $(cat err.txt)"
}
# No temporary file may be left below the folder w.
clean() {
    local left
    left=$(find w -name '*.liegrad-*')
    [ -z "$left" ] || fail "left: $left"
}
# same FILE COPY: compares byte for byte.
same() { cmp -s "$1" "$2" || fail "$1 is not $2"; }
# until_file FILE: waits for FILE to appear, for five minutes: the machine may have other work.
until_file() {
    for _ in $(seq 6000); do [ ! -e "$1" ] || return 0; sleep 0.05; done
    fail "no $1"
}

cat >in/pendulum.yaml <<'END'
system: pendulum-chain
form: hamiltonian
gravity: 1
masses: [1]
lengths: [1]
t_end: 0.1
starts: {kind: thesis}
END
cat >in/grid.yaml <<'END'
scene: pendulum.yaml
integrators: [euler]
N: [20]
M: [3]
eps: [0]
repeats: 2
t_end: 0.1
epochs: 5
batch: 80
lr: 1e-2
lr_step: 50
lr_gamma: 0.1
test: {trajectories: 10, points: 5}
END
cat >in/ranges.yaml <<'END'
fixed: {network: discrete, method: adam, epochs: 3, most-curves: 0, modes: 0, mirror: false}
ranges: {hidden: {integer: [8, 24]}}
END
lg-hamiltonian generate in/pendulum.yaml --trajectories 60 --points 10 --out in/data.h5 >/dev/null || exit 2
lg-hamiltonian train in/data.h5 --epochs 20 --hidden 16,16 --out in/model.h5 >/dev/null || exit 2
lg-elastica generate --count 60 --out in/curves.h5 >/dev/null || exit 2
lg-anomaly generate --noise 10 --runs 9 --out in/well.h5 >/dev/null || exit 2
lg-anomaly train in/well.h5 --method logistic --out in/alarm.h5 >/dev/null 2>&1 || exit 2
lg-anomaly feed --hours 3 --noise 10 --out in/feed.csv >/dev/null || exit 2

train="lg-hamiltonian train in/data.h5 --threads 1 --hidden 16,16"
# Commands that write w/out, and their other outputs.
writers=(
    "lg-hamiltonian generate in/pendulum.yaml --trajectories 60 --points 10 --out w/out"
    "$train --epochs 20 --out w/out"
    "$train --epochs 20 --checkpoint w/check --out w/out"
    "lg-hamiltonian predict in/model.h5 in/pendulum.yaml --t-end 10 --points 100 --out w/out"
    "lg-hamiltonian study in/grid.yaml --out w/out"
    "lg-elastica search in/ranges.yaml in/curves.h5 --trials 2 --out w/out"
    "lg-elastica solve --case both-ends --sweep 5 --out w/out"
    "lg-anomaly train in/well.h5 --method tree --out w/out"
    "lg-anomaly feed --hours 0.2 --noise 10 --out w/out"
    "lg-anomaly watch in/alarm.h5 --input in/feed.csv --log w/out"
    "lg-export in/model.h5 --name energy --out w/out"
    "lg-export in/model.h5 --name energy --target package --out w/out"
    "lg-export in/model.h5 --name energy --target onnx --out w/out"
)

# ---- a full disk ----

if mount -t tmpfs -o size=1m tmpfs w 2>/dev/null; then
    mounted=$folder/w
    # fill N: fills the disk, but for N pages, in which N locks have room.
    fill() {
        dd if=/dev/zero of=w/fill bs=4k 2>/dev/null
        truncate -s -$(($1 * 4096)) w/fill
    }
    for writer in "${writers[@]}"; do
        expect 0 "" $writer # an earlier result, which it may replace
        rm -rf old
        mv w/out old
        rm -rf w/*
        case $writer in lg-export* | *study* | *watch*) ;; *) cp old w/out ;; esac
        fill 0
        expect 3 "w/.out.liegrad-lock: No space left" $writer
        clean
        [ "${writer#*train}" = "$writer" ] && locks=1 || locks=2 # a training also has a checkpoint
        rm w/fill
        fill $locks
        expect 3 "No space left" $writer
        ! grep -q "its lock" err.txt || fail "no lock of $writer: $(cat err.txt)"
        [ ! -f w/out ] || [ ! -s w/out ] || cmp -s w/out old || fail "half a file of $writer"
        clean
        rm w/fill
        [ "${writer#*search}" != "$writer" ] || rm -f w/out
        expect 0 "" $writer
        clean
        rm -rf w/*
    done
    # If training cannot write its model, its state is kept elsewhere.
    fill 1
    expect 3 "the training is kept in check" $train --epochs 20 --checkpoint check --out w/out
    rm w/fill
    expect 0 "" $train --epochs 20 --resume check --checkpoint check --out w/out
    # Verdicts are written again when there is room. Lost verdicts are counted, and no verdict is incomplete.
    rm -rf w/*
    lg-anomaly watch in/alarm.h5 <in/feed.csv >whole.txt
    lines=$(wc -l <in/feed.csv)
    (
        sed -n "1,$((lines / 6))p" in/feed.csv
        sleep 1
        dd if=/dev/zero of=w/fill bs=4k 2>/dev/null
        sed -n "$((lines / 6 + 1)),$((lines * 5 / 6))p" in/feed.csv
        sleep 1
        rm w/fill
        sed -n "$((lines * 5 / 6 + 1)),\$p" in/feed.csv
    ) | lg-anomaly watch in/alarm.h5 --log w/log >out.txt 2>err.txt
    got=${PIPESTATUS[1]}
    [ $got = 3 ] || fail "exit code $got of a watch on a full disk: $(cat err.txt)"
    for words in "verdicts cannot be written: No space left" "verdicts are written again" "verdicts could not be written"; do
        grep -qF "$words" err.txt || fail "no '$words': $(cat err.txt)"
    done
    [ "$(grep -avxFf whole.txt w/log | wc -l)" = 0 ] || fail "half lines: $(grep -avxFf whole.txt w/log)"
    [ "$(tail -n 1 w/log)" = "$(grep -av '^#' whole.txt | tail -n 1)" ] || fail "the last verdict is missing"
    umount w
    mounted=
else
    echo "a full disk: skipped, a file system cannot be mounted"
fi

# ---- folders that cannot be written ----

if [ "$(id -u)" = 0 ] && setpriv --reuid=65534 --regid=65534 --clear-groups "$bin/lg-export" --version >/dev/null 2>&1; then
    chmod 755 . in
    chmod 644 in/*
    : >w/out # empty, so that it may be replaced
    chmod 555 w
    for writer in "${writers[@]}"; do
        expect 3 "w/out: " setpriv --reuid=65534 --regid=65534 --clear-groups $writer
        [ ! -s w/out ] || fail "changed by $writer"
        clean
    done
    chmod 755 w
    rm w/out
    # A user's folder in a folder that cannot be written: an export into it works.
    mkdir w/out
    chown 65534 w/out
    expect 0 "" setpriv --reuid=65534 --regid=65534 --clear-groups lg-export in/model.h5 --name energy --out w/out
    expect 0 "" setpriv --reuid=65534 --regid=65534 --clear-groups lg-export in/model.h5 --name energy --out w/out
    clean
    rm -r w/out
else
    echo "folders that cannot be written: skipped, only root can become somebody else"
fi
if mkdir ro && mount --bind w ro 2>/dev/null && mount -o remount,ro,bind ro 2>/dev/null; then
    mounted=$folder/ro
    expect 3 "Read-only file system" $train --epochs 20 --out ro/out
    expect 3 "Read-only file system" lg-export in/model.h5 --name energy --out ro/out
    expect 3 "Read-only file system" lg-anomaly watch in/alarm.h5 --input in/feed.csv --log ro/log
    umount ro
    mounted=
fi

# ---- limits of the process ----

# Files that grow too large: no signal kills the command, and the old file stays.
for writer in "${writers[@]}"; do
    rm -rf w/*
    case $writer in *study* | *search* | *sweep*) continue ;; esac # these write less than a kilobyte
    expect 3 "File too large" bash -c "ulimit -f 1; exec $writer"
    [ ! -f w/out ] || [ "$(tail -c 1 w/out)" = "" ] || fail "half a line of $writer"
    clean
done
rm -rf w/*

# Memory: an exit code and a message, never a signal or an endless wait. Below 84 MB the libraries cannot be loaded.
# limited KILOBYTES: sets got.
limited() {
    (ulimit -v "$1" && timeout -k 5 600 $train --threads 2 --method ssbroyden --epochs 20 --out w/out >/dev/null 2>err.txt)
    got=$?
    case $got in
        0) [ -s w/out ] || fail "no model below $1" ;;
        5) grep -qE "out of memory|no memory|allocation failed" err.txt || fail "$1: $(cat err.txt)" ;;
        *) fail "exit code $got at $1: $(cat err.txt)" ;;
    esac
    clean
    rm -f w/*
}
small=$train # a network so large that its products use OpenBLAS
train="lg-hamiltonian train in/data.h5 --hidden 300,300"
limited 200000
[ $got = 5 ] || fail "200 MB are enough for OpenBLAS"
train=$small
low=84000 high=1600000
limited $low
[ $got = 5 ] || fail "$low kB are enough"
limited $high
[ $got = 0 ] || fail "$high kB are not enough"
while [ $((high - low)) -gt 500 ]; do
    limited $(((low + high) / 2))
    if [ $got = 0 ]; then high=$(((low + high) / 2)); else low=$(((low + high) / 2)); fi
done
for less in $(seq 250 250 9000); do limited $((high - less)); done

# Descriptors: the same; with very few of them not even the libraries can be loaded (127).
for count in 4 5 6 7 8 9 10 11 12 14 16 20; do
    (
        exec >/dev/null 2>err.txt
        ulimit -n $count
        exec $train --epochs 20 --checkpoint w/check --history w/h.csv --plot w/p.svg --out w/out
    )
    got=$?
    case $got in
        0) [ -s w/out ] || fail "no model with $count descriptors" ;;
        3 | 5) grep -q "^lg-hamiltonian" err.txt || fail "$count: $(cat err.txt)" ;;
        127) ;;
        *) fail "exit code $got with $count descriptors: $(cat err.txt)" ;;
    esac
    clean
    rm -f w/*
done

# ---- signals ----

long="$train --method adam --epochs 1000000 --checkpoint-every 1000000 --checkpoint w/check --out w/out"
# catching PID: waits until a child of this process catches SIGINT, as all programs do once they work, however slow the machine is.
catching() {
    local mask
    for _ in $(seq 600); do
        mask=$(sed -n 's/^SigCgt:[[:space:]]*//p' "/proc/$(pgrep -P "$1" | head -n 1)/status" 2>/dev/null)
        [ $((0x${mask:-0} & 2)) = 0 ] || return 0
        sleep 0.1
    done
}
# stopped SIGNAL CODE WORDS COMMAND...: sends a signal a second after the command catches signals.
stopped() {
    local signal=$1 code=$2 words=$3 pid got
    shift 3
    timeout -k 5 600 "$@" >out.txt 2>err.txt &
    pid=$!
    [ "$1" = nohup ] || catching $pid
    sleep 1
    pkill "-$signal" -P $pid
    wait $pid
    got=$?
    [ $got = "$code" ] || fail "exit code $got, not $code after SIG$signal: $(cat err.txt)"
    grep -qF -- "$words" err.txt || fail "no '$words' after SIG$signal: $(cat err.txt)"
    clean
}
stopped INT 130 "continue with --resume w/check" $long
stopped TERM 143 "continue with --resume w/check" $long
rm w/*
stopped HUP 129 "continue with --resume w/check" $long
expect 0 "" lg-hamiltonian train in/data.h5 --threads 1 --hidden 16,16 --resume w/check --stop-after 1 --checkpoint w/check --out w/out
rm w/*
stopped TERM 143 "" lg-anomaly feed --hours 10000 --noise 10 --out w/out
[ ! -e w/out ] || fail "half a feed"
stopped TERM 143 "stopped after" lg-elastica search in/ranges.yaml in/curves.h5 --trials 10000 --out w/trials.csv
sed "s/repeats: 2/repeats: 9999/" in/grid.yaml >in/long.yaml
stopped HUP 129 "the same command continues" lg-hamiltonian study in/long.yaml --out w/study.csv
rm -f w/*
# With nohup SIGHUP stays ignored.
stopped HUP 143 "" nohup bash -c "$long & sleep 2; kill -TERM \$!; wait \$!"
# The same signal twice: the second one kills if the first is not obeyed at once; only this run is lost.
timeout -k 5 600 $long >/dev/null 2>err.txt &
catching $!
sleep 1
pkill -TERM -P $!
pkill -TERM -P $!
wait $!
expect 0 "" $train --epochs 20 --checkpoint w/check --out w/out
clean
rm -f w/*

# ---- a pipe that is closed ----

lg-anomaly feed --hours 20 --noise 10 2>err.txt | head -1 >/dev/null
got=${PIPESTATUS[0]}
[ "$got" = 3 ] || fail "exit code $got of a feed into a closed pipe"
$train --epochs 20 --out w/out 2>err.txt | true
got=${PIPESTATUS[0]}
{ [ "$got" = 3 ] || [ "$got" = 0 ]; } || fail "exit code $got of a training into a closed pipe"
lg-hamiltonian evaluate w/out in/data.h5 >/dev/null || fail "a broken model"
lg-anomaly watch in/alarm.h5 --input in/feed.csv 2>err.txt | head -2 >/dev/null
got=${PIPESTATUS[0]}
{ [ "$got" = 3 ] || [ "$got" = 0 ]; } || fail "exit code $got of a watch into a closed pipe"
clean
rm -f w/*

# ---- two writers ----

rm -f w/*
$long >/dev/null 2>&1 &
first=$!
until_file w/.out.liegrad-lock
until_file w/.check.liegrad-lock
expect 3 "w/out: is being written by process $first on " $train --epochs 3 --out w/out
expect 3 "w/check: is being written by process $first on " $train --epochs 3 --checkpoint w/check --out w/other
: >w/out # empty, so that it may be replaced
ln -s out w/link
expect 3 "is being written by process $first on " lg-hamiltonian generate in/pendulum.yaml --out w/link
kill -TERM $first
wait $first
clean
expect 0 "" $train --epochs 3 --out w/out
rm -f w/*
lg-hamiltonian study in/long.yaml --out w/study.csv >/dev/null 2>&1 &
first=$!
until_file w/.study.csv.liegrad-lock
expect 3 "w/study.csv: is being written by process $first on " lg-hamiltonian study in/long.yaml --out w/study.csv
kill -KILL $first
wait $first 2>/dev/null
expect 0 "" lg-hamiltonian study in/long.yaml --stop-after 1 --out w/study.csv
clean
rm -f w/*

# ---- a training that was killed, resumed with another checkpoint ----

$train --method adam --epochs 100000 --checkpoint w/killed --checkpoint-every 1 --out w/out >/dev/null 2>&1 &
first=$!
until_file w/killed
kill -KILL $first
wait $first 2>/dev/null
: >w/new
mv w/new "w/.killed.liegrad-tmp-$(stat -c %i w/new)-99999"
expect 0 "" lg-hamiltonian train in/data.h5 --resume w/killed --stop-after 1 --out w/out
rm -f w/killed
clean
rm -f w/*

# ---- closed standard descriptors: files must not get their numbers ----

expect 3 "" bash -c "$train --epochs 3 --out w/out >&-"
expect 3 "" bash -c "$train --epochs 3 --out w/out <&- >&- 2>&-"
[ "$(head -c 4 w/out | tail -c 3)" = HDF ] || fail "the model is something else"
rm -f w/*

# ---- a clock that jumps ----

# The system's clock starts in another year and runs 100000 times too fast: the seconds of a training are those of the
# monotonic clock.
if command -v faketime >/dev/null; then
    for clock in '@2001-01-01 00:00:00 x100000' '-3000d'; do
        begin=${EPOCHREALTIME/./}
        expect 0 "" faketime --exclude-monotonic -f "$clock" $train --method ssbroyden --seconds 1 --out w/out
        took=$(((${EPOCHREALTIME/./} - begin) / 1000))
        [ $took -ge 1000 ] && [ $took -lt 60000 ] || fail "a second took $took ms with the clock $clock"
    done
else
    echo "a clock that jumps: skipped, faketime is not installed"
fi

[ $failures = 0 ]
