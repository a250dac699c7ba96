# Searches and studies by several processes must give the same table as one process: jobs, tasks of a job array, and the same
# command in two terminals, with some of the processes killed.
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
parts() { find . -name 't.*.part-*' | grep -q .; } # killed tasks leave the files of their locks

for kind in search study; do
    command=${!kind}
    # Tasks do all of the work together, --merge writes the table, and no part is left.
    for i in 0 1 2; do $command --out t.csv --task $i/3 >"task$i" & done
    wait
    # Finished work stays: a task that finds everything done keeps the results and their seconds.
    before=$(cat t.csv.part-* | sha256sum)
    $command --out t.csv --task 0/3 >again
    [ "$before" = "$(cat t.csv.part-* | sha256sum)" ] || fail "$kind: what was done is done again"
    # The piece whose result was cut off is done again.
    size=$(stat -c %s t.csv.part-0-of-3)
    truncate -s -1 t.csv.part-0-of-3
    $command --out t.csv --task 0/3 >again
    [ "$(stat -c %s t.csv.part-0-of-3)" -ge "$size" ] || fail "$kind: a result that was cut off is not done again"
    # So is the piece whose record cannot be: the first number of the first record, behind the heads of the part and of the entry,
    # is that of no trial and no value of the grid.
    size=$(stat -c %s t.csv.part-0-of-3)
    rest=$(tail -c +181 t.csv.part-0-of-3 | sha256sum)
    printf '\377\377\377\377' | dd of=t.csv.part-0-of-3 bs=1 seek=176 conv=notrunc 2>dd
    [ "$rest" = "$(tail -c +181 t.csv.part-0-of-3 | sha256sum)" ] || fail "dd"
    $command --out t.csv --task 0/3 >again
    grep -q "all tasks together have done \(.*\) of \1 pieces" again || fail "$kind: $(cat again)"
    $command --out t.csv --merge >merged
    same_table $kind.csv t.csv || fail "$kind: tasks gave another table"
    ! parts || fail "$kind: a part is left"
    # A task that starts late has nothing to do.
    $command --out t.csv --task 2/3 | grep -q "pieces; collect them with --merge" || fail "$kind: a late task works"
    ! parts || fail "$kind: a late task leaves a part"
    rm -f t.csv*

    # A task that is started again does what it had not finished when it was killed. --merge before that writes what is finished
    # and keeps the parts.
    mkdir -p f
    for kill in 1 2 3; do
        $command --out f/t.csv --task $kill/4 >task 2>&1 &
        pid=$!
        sleep "$(printf '0.%02d' $((10 + 10 * kill)))" # of about .5 s
        kill -9 $pid 2>/dev/null || true
        wait $pid 2>/dev/null || true
    done
    code=0
    $command --out f/t.csv --merge >part 2>&1 || code=$?
    [ $code = 3 ] && grep -q "pieces are not done yet" part || fail "$kind: a merge of a part: $code $(cat part)"
    $command --out f/t.csv --task 1/4 >again
    # Without --task, a command that finds parts takes their results, and completes the table. A second command is refused
    # while the first one runs.
    first=0 second=0
    $command --out f/t.csv >rest 2>&1 &
    $command --out f/t.csv >rest2 2>&1 || second=$?
    wait $! || first=$?
    [ $first = 0 ] || grep -q "is being written by process" rest || fail "$kind: first of two commands: $(cat rest)"
    [ $second = 0 ] || grep -q "is being written by process" rest2 || fail "$kind: second of two commands: $(cat rest2)"
    [ $first = 0 ] || [ $second = 0 ] || fail "$kind: both of two commands are refused"
    same_table $kind.csv f/t.csv || fail "$kind: killed tasks changed the table"
    ! parts || fail "$kind: a part is left after killed tasks"
    rm -f f/t.csv*
done

# Jobs of a search: alone, as parts of tasks, killed with their parent, killed alone, and stopped. The same command continues.
jobs_of() { pgrep -P "$1" -x lg-elastica || true; }
$search --out t.csv --jobs 3 >jobs
same_table search.csv t.csv || fail "3 jobs give another table"
! parts || fail "jobs leave a part"
rm -f t.csv
for i in 0 1; do $search --out t.csv --task $i/2 --jobs 2 >"task$i" & done
wait
$search --out t.csv --merge >merged
same_table search.csv t.csv && ! parts || fail "jobs of tasks give another table"
rm -f t.csv
sed 's/epochs: 20/epochs: 200/' ranges.yaml >long.yaml
long="lg-elastica search long.yaml data.h5 --trials 6 --threads 1 --rungs 0"
$long --out long.csv >one
for signal in KILL INT job; do
    $long --out t.csv --jobs 2 >jobs 2>err &
    pid=$!
    until [ -s t.csv ] && [ "$(wc -l <t.csv)" -gt 2 ]; do kill -0 $pid || fail "jobs: $(cat err)"; sleep 0.02; done # a trial is done
    children=$(jobs_of $pid)
    [ -n "$children" ] || fail "there are no jobs"
    if [ $signal = job ]; then kill -KILL ${children%%[!0-9]*}; else kill -$signal $pid; fi
    code=0
    wait $pid 2>/dev/null || code=$?
    for i in $(seq 100); do kill -0 $children 2>/dev/null || break; sleep 0.1; done
    ! kill -0 $children 2>/dev/null || fail "jobs go on after $signal"
    case $signal$code in
        KILL137) ;;
        INT130) grep -q "stopped after . of 6 trials (Ctrl-C); the same command continues" err || fail "Ctrl-C: $(cat err)" ;;
        job3) grep -q "a job was ended by signal 9" err || fail "a killed job: $(cat err)" ;;
        *) fail "$signal: exit code $code, $(cat err)" ;;
    esac
    [ "$(grep -c '^[0-9]' t.csv)" -ge 1 ] || fail "$signal: the finished trials are not in the table"
    $long --out t.csv --jobs 3 --json >again 2>&1
    ! grep -q '"new": 6' again || fail "$signal: all trials are done again"
    same_table long.csv t.csv && ! parts || fail "after $signal another table"
    rm -f t.csv*
done

# A trial is not stopped before all earlier trials have come as far. With the quantile 1 a trial is stopped if all earlier
# ones are better; trial 0 is the worst of these three, so none is stopped. The task with trial 0 is suspended after its
# first report, while other tasks run the others one after the other.
sed 's/epochs: 20/epochs: 150/' ranges.yaml >long.yaml
long="lg-elastica search long.yaml data.h5 --trials 3 --threads 1 --rungs 5,1,1 --seed 6"
$long --out long.csv >one 2>&1
! grep -q pruned long.csv || fail "trial 0 is not the worst one"
$long --out t.csv --task 0/3 >task0 2>&1 &
pid=$!
until [ "0$(stat -c %s t.csv.part-0-of-3 2>/dev/null)" -gt 168 ]; do :; done
kill -STOP $pid
held=$(od -An -t u8 -j 168 -N 8 t.csv.part-0-of-3 | tr -d ' ') # the state of trial 0, behind head and number: 0 unfinished
for i in 1 2; do $long --out t.csv --task $i/3 >task1 2>&1; done
kill -CONT $pid
wait $pid
[ "$held" = 0 ] || fail "trial 0 was done before it could be held"
$long --out t.csv --merge >merged 2>&1
same_table long.csv t.csv || fail "a trial was stopped by what was not known yet"
rm -f t.csv*

# A table of other work is refused, and leaves no part. A merge of a part is reported as such.
sed 's/seed: 1/seed: 2/' grid.yaml >grid2.yaml
cp study.csv t.csv
code=0
lg-hamiltonian study grid2.yaml --out t.csv --threads 1 --task 0/2 2>err >out || code=$?
[ $code = 3 ] && ! parts || fail "a study on a table of another one: $code $(cat err)"
$study --out t.csv --merge >merged || fail "the table of a study is no longer its own"
rm -f t.csv*
$study --out t.csv --task 0/2 --stop-after 3 >task
code=0
$study --out t.csv --merge 2>err >out || code=$?
[ $code = 3 ] && grep -q "29 of 32 pieces are not done yet" err && [ -s t.csv ] || fail "a merge of three runs: $code $(cat err)"
for i in 0 1; do $study --out t.csv --task $i/2 >rest; done
$study --out t.csv --merge >merged
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
[ $code = 3 ] && grep -q "pieces are not done yet" err && [ ! -e other.h5 ] || fail "a merge of nothing: $code $(cat err)"
$generate --out t.h5 --merge --json >merged
[ "$(sha one)" = "$(sha merged)" ] || fail "tasks generate other data"
! parts || fail "generate: a part is left"
$generate --out two.h5 --threads 2 --json >two
[ "$(sha one)" = "$(sha two)" ] || fail "two threads generate other data"

# Parts of other work are refused, and a wrong task is a usage error.
$search --out t.csv --task 0/2 >task
code=0
lg-elastica search ranges.yaml data.h5 --trials 16 --threads 1 --seed 2 --out t.csv 2>err || code=$?
[ $code = 3 ] && grep -q "belongs to work with other options or data" err || fail "another search took the part: $code $(cat err)"
for task in 2/2 x 1 /2 1/ -1/2; do
    code=0
    $search --out t.csv --task=$task 2>err >out || code=$?
    [ $code = 2 ] || fail "--task $task: exit code $code"
done
code=0
$search --out t.csv --task 0/2 --merge 2>err >out || code=$?
[ $code = 2 ] || fail "--task with --merge: exit code $code"
