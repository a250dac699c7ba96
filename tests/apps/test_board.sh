# Searches and studies by several processes must give the same table as one process: tasks of a job array, with some of
# them killed, and the same command in two terminals.
# ctest-labels: slow apps/common src/settings
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PATH=$LG_BIN_DIR:$PATH
cd "$work"
. "$LG_TEST_DIR/apps/sweeps.sh"

search="lg-elastica search ranges.yaml data.h5 --trials 16 --threads 1"
study="lg-hamiltonian study grid.yaml --threads 1"
make_sweeps
$search --out search.csv >one 2>&1
$study --out study.csv >one 2>&1

for kind in search study; do
    command=${!kind}
    # Tasks do all of the work together, --merge writes the table, and no board is left.
    for i in 0 1 2; do $command --out t.csv --task $i/3 >"task$i" & done
    wait
    # Finished work stays: a task that finds everything done keeps the results and their seconds.
    before=$(sha256sum <t.csv.board)
    $command --out t.csv --task 0/3 >again
    [ "$before" = "$(sha256sum <t.csv.board)" ] || fail "$kind: what was done is done again"
    # The piece whose result was cut off is done again.
    truncate -s -1 t.csv.board
    $command --out t.csv --task 0/3 >again
    # So is the piece whose record cannot be: the first number of the first record, behind head and state, is that of no
    # trial and no value of the grid.
    printf '\377\377\377\377' | dd of=t.csv.board bs=1 seek=192 conv=notrunc 2>dd
    $command --out t.csv --task 0/3 >again
    [ "$(od -An -t x4 -j 192 -N 4 t.csv.board)" != " ffffffff" ] || fail "$kind: a record that cannot be counts as done"
    $command --out t.csv --merge >merged
    same_table $kind.csv t.csv || fail "$kind: tasks gave another table"
    [ ! -e t.csv.board ] || fail "$kind: the board is left"
    # A task that starts late has nothing to do.
    $command --out t.csv --task 2/3 | grep -q "pieces; collect them with --merge" || fail "$kind: a late task works"
    rm -f t.csv*

    # The next task does the work that killed tasks had not finished. --merge before that writes a part and keeps the
    # board.
    for kill in 1 2 3; do
        $command --out t.csv --task $kill/4 >task 2>&1 &
        pid=$!
        sleep "$(printf '0.%02d' $((10 + 10 * kill)))" # of about .5 s
        kill -9 $pid 2>/dev/null || true
        wait $pid 2>/dev/null || true
    done
    $command --out t.csv --merge >part 2>&1 || true
    [ -e t.csv.board ] || same_table $kind.csv t.csv || fail "$kind: the board of unfinished work is gone"
    # Without --task, a command that finds a board takes part and completes the table. A command that starts when the
    # board is gone may be refused, but only because the other one is writing the table.
    first=0 second=0
    $command --out t.csv >rest 2>&1 &
    $command --out t.csv >rest2 2>&1 || second=$?
    wait $! || first=$?
    [ $first = 0 ] || grep -q "is being written by process" rest || fail "$kind: first of two commands: $(cat rest)"
    [ $second = 0 ] || grep -q "is being written by process" rest2 || fail "$kind: second of two commands: $(cat rest2)"
    [ $first = 0 ] || [ $second = 0 ] || fail "$kind: both of two commands are refused"
    same_table $kind.csv t.csv || fail "$kind: killed tasks changed the table"
    [ ! -e t.csv.board ] || fail "$kind: the board is left after killed tasks"
    rm -f t.csv*
done

# A trial is not stopped before all earlier trials have come as far. With the quantile 1 a trial is stopped if all earlier
# ones are better; trial 0 is the worst of these three, so none is stopped. The task with trial 0 is suspended after its
# first report, while another task runs the others.
state_of_first() { od -An -t u8 -j 176 -N 8 t.csv.board 2>/dev/null | tr -d ' '; } # after the board's head; 1 means unfinished
sed 's/epochs: 20/epochs: 150/' ranges.yaml >long.yaml
long="lg-elastica search long.yaml data.h5 --trials 3 --threads 1 --rungs 5,1,1 --seed 6"
$long --out long.csv >one 2>&1
! grep -q pruned long.csv || fail "trial 0 is not the worst one"
$long --out t.csv --task 0/2 >task0 2>&1 &
pid=$!
until [ "0$(state_of_first)" -gt 0 ]; do :; done
kill -STOP $pid
held=$(state_of_first)
$long --out t.csv --task 1/2 >task1 2>&1
kill -CONT $pid
wait $pid
[ "$held" = 1 ] || fail "trial 0 was done before it could be held"
$long --out t.csv --merge >merged 2>&1
same_table long.csv t.csv || fail "a trial was stopped by what was not known yet"
rm -f t.csv*

# A process raises its beat when the wall clock is set back by a day, too.
beat_of_first() { od -An -t u8 -j 184 -N 8 t.csv.board 2>/dev/null | tr -d ' '; }
until_beat() { # until_beat N: waits up to five minutes until the beat is above N
    for i in $(seq 3000); do [ "0$(beat_of_first)" -le "$1" ] || return 0; sleep 0.1; done
    fail "no beat after $1: $(cat task)"
}
sed 's/epochs: 20/epochs: 1000000/' ranges.yaml >long.yaml
LD_PRELOAD=$LG_BIN_DIR/../tests/set_clock.so LG_CLOCK=clock \
    lg-elastica search long.yaml data.h5 --trials 1 --threads 1 --out t.csv --task 0/2 >task 2>&1 &
pid=$!
until_beat 0
echo -86400 >clock
[ $(($(date +%s) - $(LD_PRELOAD=$LG_BIN_DIR/../tests/set_clock.so LG_CLOCK=clock date +%s))) -gt 86000 ] || fail "the clock cannot be set"
until_beat $(($(beat_of_first) + 2))
kill -9 $pid
wait $pid 2>/dev/null || true
rm -f t.csv* clock

# A table of other work is refused, and its board does not block the right work. A merge of a part is reported as such.
sed 's/seed: 1/seed: 2/' grid.yaml >grid2.yaml
cp study.csv t.csv
code=0
lg-hamiltonian study grid2.yaml --out t.csv --threads 1 --task 0/2 2>err >out || code=$?
[ $code = 3 ] && [ ! -e t.csv.board ] || fail "a study on a table of another one: $code $(cat err)"
$study --out t.csv --merge >merged || fail "the table of a study is no longer its own"
rm -f t.csv*
$study --out t.csv --task 0/2 --stop-after 3 >task
code=0
$study --out t.csv --merge 2>err >out || code=$?
[ $code = 3 ] && grep -q "pieces are not done yet" err && [ -s t.csv ] || fail "a merge of three runs: $code $(cat err)"
$study --out t.csv --task 1/2 >rest && $study --out t.csv --merge >merged
same_table study.csv t.csv || fail "a second merge wrote the rows of the first one again, or lost some"
rm -f t.csv*
code=0
$search --out t.csv --merge 2>err >out || code=$?
[ $code = 3 ] && grep -q "16 of 16 pieces are not done yet" err || fail "a merge of no trials: $code $(cat err)"
rm -f t.csv*

# generate must write the same file as a single process.
generate="lg-hamiltonian generate pendulum.yaml --trajectories 203 --segments 3 --noise 1e-3 --threads 1"
$generate --out one.h5 --json >one
for i in 0 1 2; do $generate --out t.h5 --task $i/3 >"task$i" & done
wait
code=0
$generate --out other.h5 --merge 2>err >out || code=$?
[ $code = 3 ] && grep -q "pieces are not done yet" err || fail "a merge of nothing: $code $(cat err)"
rm -f other.h5.board
$generate --out t.h5 --merge --json >merged
[ "$(sha one)" = "$(sha merged)" ] || fail "tasks generate other data"
[ ! -e t.h5.board ] || fail "generate: the board is left"
$generate --out two.h5 --threads 2 --json >two
[ "$(sha one)" = "$(sha two)" ] || fail "two threads generate other data"

# A board of other work is refused, and a wrong task is a usage error.
$search --out t.csv --task 0/2 >task
code=0
lg-elastica search ranges.yaml data.h5 --trials 16 --threads 1 --seed 2 --out t.csv 2>err || code=$?
[ $code = 3 ] && grep -q "belongs to work with other options or data" err || fail "another search took the board: $code $(cat err)"
for task in 2/2 x 1 /2 1/ -1/2; do
    code=0
    $search --out t.csv --task=$task 2>err >out || code=$?
    [ $code = 2 ] || fail "--task $task: exit code $code"
done
code=0
$search --out t.csv --task 0/2 --merge 2>err >out || code=$?
[ $code = 2 ] || fail "--task with --merge: exit code $code"
