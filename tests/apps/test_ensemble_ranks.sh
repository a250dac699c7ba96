# An ensemble on ranks of mpirun must have the numbers of one process. Skipped without mpirun or liegrad_mpi.
. "$LG_TEST_DIR/apps/ranks.sh"
printf 'system: oscillator\ninitial: {q: 1, p: 0}\nensemble: q = normal 0 1\nt_end: 2\n' >circles.yaml
run="lg-simulate circles.yaml --ensemble 5000 --points 4 --event q=0 --save 2000 --json --threads 1"
results() { sed 's/.*"end"/"end"/; s/"out".*//' "$1"; }

$run --out one.h5 >one.json
ranks -n 3 $run --out many.h5 >many.json 2>err || { cat err; exit 1; }
[ -n "$(results one.json)" ] && [ "$(results one.json)" = "$(results many.json)" ] || { echo "three ranks say something else"; exit 1; }
[ -s many.h5 ] && ! ls many.part-*-of-3.h5 2>/dev/null || { echo "parts are left, or there is no file"; exit 1; }
# With fewer blocks than ranks, the trajectories of all members are written all the same.
ranks -n 3 lg-simulate circles.yaml --ensemble 1500 --points 4 --save 1100 --out few.h5 \
    >few.out 2>err || { cat err; exit 1; }
[ "$(ls few.part-* | wc -l)" = 2 ] || { echo "two of three ranks have trajectories"; ls; exit 1; }
if ranks -n 2 $run >out 2>err; then echo "ranks without --out run"; exit 1; fi
grep -q 'give --out' err
