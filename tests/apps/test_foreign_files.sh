# Every command reads tables and HDF5 files as other programs write them: CSV with the header in a comment (numpy.savetxt),
# HDF5 behind a user block (MATLAB 7.3). It must give the same exit code and the same output as for the plain files.
# shellcheck disable=SC2086 # words are split on purpose
set -u
export LC_ALL=C
status=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/plain" "$work/foreign" || exit 1
cd "$work/plain" || exit 1
fail() { echo "$*"; status=1; }
run() { timeout 60 "$LG_BIN_DIR/$@" </dev/null 2>&1; }

for i in $(seq 0 60); do echo "$i,$((i * i % 17)),$((i * 3 + i * i % 5))"; done | sed '1it,x,y' >table.csv
awk -F, 'NR == 1 { print "t,x,vx,u"; next } { t = .02 * ($1 + 0); printf "%.4f,%.9f,%.9f,%.9f\n", t, sin(t), cos(t), -sin(t) }' table.csv >log.csv
printf 'columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}]\ninputs: {columns: [u]}\n' >machine.yaml
printf 'q1.x,q1.y,q1.z,p1.x,p1.y,p1.z\n0,0,-1,.1,0,0\n0,0,-1,.2,0,0\n' >starts.csv
cp "$LG_TEST_DIR/../scenes/pendulum.yaml" scene.yaml
run lg-fit train table.csv --hidden 4 --epochs 9 --out model.h5 >/dev/null || fail "no model"
run lg-identify fit machine.yaml log.csv --epochs 3 --out machine.h5 >/dev/null
run lg-anomaly generate --noise 10 --runs 2 --hours 1 --out series.h5 >/dev/null || fail "no series"
run lg-anomaly train series.h5 --method logistic --out detector.h5 >/dev/null || fail "no detector"
run lg-hamiltonian generate scene.yaml --trajectories 20 --points 4 --t-end 0.3 --out paths.h5 >/dev/null || fail "no paths"
run lg-elastica generate --count 20 --out curves.h5 >/dev/null || fail "no curves"
for file in *; do
    case $file in
        *.csv) sed '1s/^/# /' "$file" ;;
        *.h5) head -c 512 /dev/zero && cat "$file" ;;
        *) cat "$file" ;;
    esac >../foreign/"$file"
done

count=0
while read -r words; do
    one=$(cd ../plain && run $words)
    first=$?
    two=$(cd ../foreign && run $words)
    second=$?
    # Times differ from run to run.
    [ $first = $second ] && [ "$(echo "$one" | sed 's/[0-9.e-]* s\b//g; /^[a-z_]*seconds/d')" = "$(echo "$two" | sed 's/[0-9.e-]* s\b//g; /^[a-z_]*seconds/d')" ] ||
        fail "$words: exit codes $first and $second: $one" "--- $two"
    [ $first = 0 ] || fail "$words: exit code $first: $one"
    count=$((count + 1))
done <<'END'
lg-fit train table.csv --hidden 4 --epochs 3 --out new.h5
lg-fit evaluate model.h5 table.csv
lg-fit predict model.h5 table.csv
lg-identify check machine.yaml log.csv
lg-identify fit machine.yaml log.csv --epochs 2 --out newm.h5
lg-identify evaluate machine.h5 log.csv
lg-learn evaluate model.h5 table.csv
lg-simulate scene.yaml --ensemble 2 --starts starts.csv --t-end 0.1 --steps 10
lg-anomaly evaluate detector.h5 series.h5
lg-anomaly train series.h5 --method logistic --out newd.h5
lg-hamiltonian train paths.h5 --epochs 1 --hidden 4 --out newh.h5
lg-elastica train curves.h5 --epochs 1 --out newe.h5
lg-export model.h5 --out c
END
[ $count -ge 13 ] || fail "$count commands"
exit $status
