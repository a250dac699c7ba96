# Ranks of mpirun: 1 to 4 ranks with 1 or 2 threads train networks and policies with the bits of one
# process, also resumed with another number of ranks; sweeps whose ranks are killed; refusals. Skipped without mpirun or liegrad_mpi.
# ctest-labels: slow src/mpi src/nn src/control apps/common
. "$LG_TEST_DIR/apps/ranks.sh"
. "$LG_TEST_DIR/apps/sweeps.sh"
make_sweeps
forget() { rm -f one.h5 many.h5; } # a command replaces no file of another kind

# The numbers of a model file, without its times.
numbers() { lg-export "$1" --out "$2" --name m >/dev/null 2>&1 && cat "$2"/m_weights.c; }
same_model() {
    rm -rf a b
    numbers "$1" a >a.txt
    numbers "$2" b >b.txt
    [ -s a.txt ] && cmp -s a.txt b.txt
}
same_history() { diff <(cut -d, -f1-4 "$1") <(cut -d, -f1-4 "$2") >/dev/null; }

lg-hamiltonian generate pendulum.yaml --trajectories 40 --points 5 --t-end 0.5 --out h.h5 >made
for method in adam ssbroyden lbfgs; do
    train="lg-hamiltonian train h.h5 --hidden 12,12 --method $method --epochs 14 --shards 4"
    $train --threads 1 --out one.h5 --history one.csv >out 2>&1
    case $method in # threads of 1 to 4 ranks, and the ranks of a training in two parts
        adam) threads="1 2 1 2" parts="1 3" ;;
        ssbroyden) threads="2 1 2 1" parts="3 2" ;;
        lbfgs) threads="2 1 1 2" parts="4 1" ;;
    esac
    R=0
    for T in $threads; do
        R=$((R + 1))
        ranks -n $R $train --threads $T --out many.h5 --history many.csv --json >out 2>err || fail "$method $R: $(cat err)"
        same_model one.h5 many.h5 && same_history one.csv many.csv || fail "$method: $R ranks of $T threads give other bits"
        grep -q "\"ranks\": $R" out || fail "$method $R: $(cat out)"
    done
    set -- $parts
    ranks -n $1 $train --threads 1 --out many.h5 --stop-after 6 --checkpoint c.h5 >out 2>err || fail "$method: $(cat err)"
    ranks -n $2 lg-hamiltonian train h.h5 --resume c.h5 --threads 1 --out many.h5 --history many.csv >out 2>err || fail "$method: $(cat err)"
    same_model one.h5 many.h5 && same_history one.csv many.csv || fail "$method: resumed by $2 after $1 gives other bits"
done
# Levenberg-Marquardt for a table.
forget
awk 'BEGIN {print "x,y"; for (i = 0; i < 200; i++) print i / 100 "," sin(i / 20)}' >table.csv
fit="lg-fit train table.csv --inputs x --outputs y --hidden 10 --epochs 30 --threads 1"
$fit --out one.h5 >out 2>&1
ranks -n 3 $fit --out many.h5 >out 2>err || fail "lm: $(cat err)"
same_model one.h5 many.h5 || fail "lm: 3 ranks give other bits"

# Policies.
forget
cat >policy.yaml <<'E'
columns: {time: t}
coordinates: [{name: th, kind: angle, velocity: w}]
inputs: {columns: [u]}
mass: {kind: known, values: [[1]]}
potential: {kind: known, form: linear, of: th, values: [0, 1]}
damping: {kind: known, values: [0.1]}
input_map: {kind: known, values: [[1]]}
E
cat >task.yaml <<'E'
plant: policy.yaml
period: 0.1
horizon: 3
starts: {th: [-3, 3]}
limits: {u: 0.7}
cost: {th: 1, w: 0.1}
success: {th: 0.1, hold: 1, within: 5}
controller: {kind: network, hidden: [8]}
E
train="lg-control train task.yaml --seeds 3 --race 9 --finish 6 --polish 4 --threads 1"
$train --out one.h5 >out 2>&1
ranks -n 2 $train --out many.h5 --json >out 2>err || fail "policy: $(cat err)"
same_model one.h5 many.h5 || fail "policy: 2 ranks give other bits"
[ "$(wc -l <out)" = 1 ] || fail "policy: all ranks report: $(cat out)"

# Sweeps: ranks are killed, and the table must be that of one process.
search="lg-elastica search ranges.yaml data.h5 --trials 16 --threads 1"
study="lg-hamiltonian study grid.yaml --threads 1"
rm -f one.csv many.csv # histories of trainings
$search --sampler grid --out one.csv >out 2>&1
ranks -n 3 $search --sampler grid --out many.csv --json >out 2>err || fail "grid: $(cat err)"
same_table one.csv many.csv || fail "3 ranks give another grid"
rm -f one.csv many.csv
for kind in search study; do
    command=${!kind}
    $command --out one.csv >out 2>&1
    ranks -n 3 $command --out many.csv --json >out 2>err || fail "$kind: $(cat err)"
    same_table one.csv many.csv || fail "$kind: 3 ranks give another table"
    [ "$(wc -l <out)" = 1 ] || fail "$kind: all ranks report: $(cat out)"
    rm -f many.csv
    ranks -n 4 $command --out many.csv >out 2>err &
    job=$!
    sleep 0.7
    pid=$(pgrep -f -- "--out many.csv" | while read -r p; do [ "$(cat /proc/$p/comm 2>/dev/null)" != "${command%% *}" ] || echo $p; done | tail -n 1)
    [ -z "$pid" ] || kill -9 "$pid" 2>/dev/null || true
    wait $job || true
    # Two ranks continue from the parts of the four, unless these had finished.
    [ -e many.csv ] || ranks -n 2 $command --out many.csv --json >out 2>err || fail "$kind: $(cat err)"
    same_table one.csv many.csv || fail "$kind: a killed rank changes the table"
    ! ls many.csv.part-* 2>/dev/null || fail "$kind: parts are left"
    rm -f one.csv many.csv*
done

generate="lg-anomaly generate --runs 6 --hours 0.05 --threads 1 --json"
forget
$generate --out one.h5 >one
ranks -n 3 $generate --out many.h5 >many 2>err || fail "generate: $(cat err)"
[ "$(sha one)" = "$(sha many)" ] || fail "3 ranks generate other data: $(cat many)"

# Refusals: printed once, with the right exit code.
code=0
ranks -n 3 lg-hamiltonian train none.h5 --out x.h5 >out 2>err || code=$?
[ $code = 3 ] && [ "$(grep -c "none.h5" err)" = 1 ] || fail "a missing file: $code $(cat err)"
code=0
ranks -n 2 lg-export one.h5 --out x >out 2>err || code=$?
[ $code = 2 ] && grep -q "runs in one process only" err || fail "an export by two: $code $(cat err)"
code=0
ranks -n 1 lg-hamiltonian train h.h5 --out x.h5 --epochs 2 : -n 1 -x LIEGRAD_ISA=baseline lg-hamiltonian train h.h5 --out x.h5 --epochs 2 >out 2>err || code=$?
[ $code = 2 ] && grep -q "ranks must be of one kind" err || fail "two kinds of processors: $code $(cat err)"

# Ctrl-C saves the state, and training resumed from it reaches the same bits.
train="lg-hamiltonian train h.h5 --hidden 12,12 --method adam --epochs 4000 --threads 1 --shards 4"
forget
$train --out one.h5 >out 2>&1
rm -f c.h5
mpirun --oversubscribe -n 2 $train --out many.h5 --checkpoint c.h5 --checkpoint-every 50 >out 2>err &
job=$!
for i in $(seq 3000); do [ ! -e c.h5 ] || break; sleep 0.1; done
kill -INT $job
wait $job || true
[ ! -e .many.h5.liegrad-lock ] || fail "Ctrl-C left a lock"
if [ ! -e many.h5 ]; then
    [ -e c.h5 ] || fail "Ctrl-C saved nothing: $(cat err)"
    grep -q "continue with --resume" err || fail "Ctrl-C says nothing: $(cat err)"
    lg-hamiltonian train h.h5 --resume c.h5 --out many.h5 >out 2>&1
fi
same_model one.h5 many.h5 || fail "after Ctrl-C other bits"

# SIGTERM to mpirun leaves the state, but no lock and no temporary file. A rank that is stopped for ever is given up: all
# ranks say so, the state is saved, and another number of ranks continues to the same bits. Stopped for a while it is not.
train="lg-hamiltonian train h.h5 --hidden 12,12 --method adam --epochs 600 --threads 1 --shards 4"
$train --out one.h5 >out 2>&1
start_ranks() { # start_ranks SILENCE: starts three ranks, and waits for their first checkpoint
    rm -f c.h5 many.h5*
    LIEGRAD_SILENCE=$1 timeout 600 mpirun --oversubscribe --mca odls_base_sigkill_timeout 4 -n 3 $train --out many.h5 --checkpoint c.h5 \
        --checkpoint-every 5 >out 2>err &
    job=$!
    for i in $(seq 3000); do [ ! -e c.h5 ] || break; sleep 0.1; done
    launcher=$(pgrep -P $job -x mpirun)
    second=$(pgrep -P $launcher -x lg-hamiltonian | sed -n 2p)
}
rest() { # rest RANKS: to the end
    [ -e many.h5 ] || ranks -n $1 lg-hamiltonian train h.h5 --resume c.h5 --threads 1 --out many.h5 >out 2>err || fail "rest: $(cat err)"
    same_model one.h5 many.h5 || fail "resumed by $1 ranks: other bits"
}
start_ranks 30
kill -TERM $launcher
wait $job || true
[ -z "$(find . -name '*.liegrad-*')" ] || fail "SIGTERM leaves $(ls -A)"
[ -e many.h5 ] || grep -q "continue with --resume" err || fail "SIGTERM: $(cat err)"
rest 2
start_ranks 8
kill -STOP $second
code=0
wait $job || code=$?
[ $code = 3 ] && [ "$(grep -c "no sign of life" err)" -ge 1 ] || fail "a stopped rank: $code $(cat err)"
grep -q "the state before this failure is in c.h5" err || fail "a stopped rank: nothing saved: $(cat err)"
rest 2
start_ranks 8
for i in 1 2 3; do kill -STOP $second; sleep 2; kill -CONT $second; sleep 0.1; done
wait $job || fail "a slow rank was given up: $(cat err)"
rest 1

# A rank whose wall clock is set back by a day gives signs of life.
train="${train/--epochs 600/--epochs 100000000}"
LIEGRAD_SILENCE=8 timeout 600 mpirun --oversubscribe --mca odls_base_sigkill_timeout 30 -n 3 bash -c "LD_PRELOAD=$LG_BIN_DIR/../tests/set_clock.so \
    LG_CLOCK=clock.\$OMPI_COMM_WORLD_RANK exec $train --out clocks.h5 --checkpoint k.h5 --checkpoint-every 5" >out 2>err &
job=$!
for i in $(seq 3000); do [ ! -e k.h5 ] || break; sleep 0.1; done
echo -86400 >clock.1
sleep 12
pkill -TERM -P $job -x mpirun
wait $job || true
! grep -q "no sign of life" err || fail "a rank whose clock was set back is given up: $(cat err)"
grep -q "continue with --resume" err || fail "ranks with a clock set back: $(cat err)"
