# No command may change a file that it did not write: every command that writes, of every program, onto a foreign file of
# every name that it uses. The file must stay byte for byte, with exit code 3 and a sentence that names it. A result of the
# command's own kind is replaced, and a sentence says so, or it is continued.
#
# Programs, commands and options come from --help: each option that names an output must be given in a case below whose
# command works and writes it, or stand in the list of reasons.
# ctest-labels: apps/common src/files slow
# shellcheck disable=SC2086 # words are split on purpose
set -u
export LC_ALL=C OPENBLAS_NUM_THREADS=1
status=0 runs=0 outputs=0 kept=0 links=0 replaced=0 continued=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PATH=$LG_BIN_DIR:$PATH
fail() { echo "$*"; status=1; }

# ---- inputs ----

mkdir "$work/in" "$work/run" && cd "$work/in" || exit 1
make() { "$@" >made 2>&1 || fail "$*: exit code $?: $(cat made)"; }
for i in $(seq 60); do echo "$i,$((i * i % 17)),$((i * 3 + i * i % 5)),$((i % 2))"; done | sed '1ia,b,y,c' >table.csv
cat >pendulum.yaml <<'END'
system: pendulum-chain
form: hamiltonian
gravity: 1
masses: [1]
lengths: [1]
t_end: 0.1
starts: {kind: thesis}
END
cat >grid.yaml <<'END'
scene: pendulum.yaml
integrators: [euler, rk4]
N: [10]
M: [3]
eps: [0]
repeats: 2
t_end: 0.1
epochs: 2
batch: 80
lr: 1e-2
lr_step: 50
lr_gamma: 0.1
test: {trajectories: 4, points: 3}
seed: 1
END
columns='columns: {time: t, run: run}
coordinates: [{name: x, kind: line, velocity: vx}]
inputs: {columns: [u], hold: zero}
input_map: {kind: known, values: [[1]]}'
cat >truth.yaml <<END
$columns
mass: {kind: known, values: [2]}
potential: {kind: known, form: quadratic, of: x, values: [2.5]}
damping: {kind: known, values: [0.3]}
END
cat >machine.yaml <<END
$columns
mass: diagonal
potential: {kind: network, of: [x], hidden: [4]}
damping: diagonal
END
cat >task.yaml <<'END'
plant: truth.yaml
period: 0.05
horizon: 1
limits: {u: 5}
starts: {x: [-1, 1], vx: [-1, 1]}
cost: {x: 1, vx: 0.1, u: 0.05}
success: {x: 0.1, hold: 0.5, within: 4}
controller: {kind: network, hidden: [4], gate: lqr}
END
sed 's/^controller:.*/controller: {kind: lqr}/' task.yaml >lqr.yaml
cat >fit.yaml <<'END'
fixed: {epochs: 2, method: adam}
ranges: {hidden: {choice: [2, 3]}}
END
cat >beam.yaml <<'END'
fixed: {network: discrete, method: adam, epochs: 2, most-curves: 0, modes: 0, mirror: false}
ranges: {hidden: {integer: [4, 8]}}
END
cat >well.yaml <<'END'
fixed: {method: cnn, epochs: 1}
ranges: {lr: {log-uniform: [1e-3, 1e-2]}}
END
make lg-hamiltonian generate pendulum.yaml --trajectories 20 --points 4 --out data.h5
make lg-hamiltonian train data.h5 --epochs 2 --hidden 4 --out energy.h5
make lg-elastica generate --count 60 --intervals 10 --out curves.h5
make lg-elastica train curves.h5 --epochs 2 --network discrete --hidden 4 --out beam.h5
make lg-fit train table.csv --outputs y --epochs 2 --out fit.h5
make lg-anomaly generate --noise 10 --runs 6 --hours 1 --out well.h5
make lg-anomaly train well.h5 --method logistic --out detector.h5
make lg-anomaly feed --hours 0.1 --noise 10 --out feed.csv
make lg-identify generate truth.yaml --runs 2 --t-end 2 --out log.csv
make lg-identify fit machine.yaml log.csv --epochs 2 --method lm --out body.h5
make lg-control train task.yaml --seeds 1 --race 2 --finish 0 --polish 0 --starts 64 --out policy.h5
make lg-simulate pendulum.yaml --ensemble 20 --t-end 0.2 --task 0/2 --out e.h5
make lg-simulate pendulum.yaml --ensemble 20 --t-end 0.2 --task 1/2 --out e.h5
# HDF5 of another program: the attribute `format` has another value
sed 's/liegrad/another/g' data.h5 >foreign.h5
# HDF5 of liegrad, of a kind that a program of the user's own has chosen
sed 's/surrogate/mymachine/g' beam.h5 >own.h5

# foreign files: a text without a line end, bytes without a line, plots that liegrad did not draw, a comment that begins
# as that of a table of trials
printf '# seed 42\nmy,only\n1,data\n' >seed.csv
printf 'important notes' >notes
head -c 600 /dev/zero >zeros
printf '\211PNG\r\n\032\nphoto' >photo.png
printf '<?xml version="1.0" encoding="utf-8"  standalone="no"?>\n<svg/>\n' >photo.svg

# ---- a case ----

covered=' '
# fresh: an empty folder for a run, the current one from then on.
fresh() {
    cd "$work" && rm -rf run && mkdir run && cd run || exit 1
}
# command WORDS...: runs it; sets `found` and `said`.
command() {
    runs=$((runs + 1))
    said=$(timeout 120 "$@" 2>&1 >/dev/null </dev/null)
    found=$?
}

# onto_foreign NAME CONTENT WORDS...: in an empty folder, except for this file; refuses: in this folder.
onto_foreign() {
    fresh
    refuses "$@"
}
refuses() {
    local name=$1 content=$2
    shift 2
    mkdir -p "$(dirname "$name")"
    cp "$content" "$name"
    command "$@"
    kept=$((kept + 1))
    cmp -s "$content" "$name" || fail "$*: $name, a file of the user (${content##*/}), is changed: code $found: $said"
    case $found$said in 3*"${name##*/}"*) ;; *) fail "$*: onto $name (${content##*/}): code $found: $said" ;; esac
}

# onto_link NAME WORDS...: NAME is a symbolic link to nothing. It stays one.
onto_link() {
    local name=$1
    fresh
    shift
    mkdir -p "$(dirname "$name")"
    ln -s ../nowhere "$name"
    command "$@"
    links=$((links + 1))
    case $found$said in 3*"${name##*/}"*) ;; *) fail "$*: onto the link $name: code $found: $said" ;; esac
    [ -L "$name" ] && [ ! -e "$name" ] && [ ! -e ../nowhere ] || fail "$*: the link $name is followed or replaced"
}

# onto_table NAME WORDS...: a user's table with the first line of what the command writes into NAME.
onto_table() {
    local name=$1 made=../made.csv mine=../mine.csv
    shift
    cp "$name" $made
    case $(head -c 1 $made) in '#') onto_foreign "$name" "$work/in/seed.csv" "$@" && return ;; esac
    case $2 in study) ;; *) head -1 $made >$mine && onto_foreign "$name" $mine "$@" ;; esac # a study continues its first line
    (head -1 $made && head -1 $made | sed 's/[^,]\+/1/g') >$mine && onto_foreign "$name" $mine "$@"
    (cat $made && echo mine) >$mine && onto_foreign "$name" $mine "$@"
}

# onto_own WORDS...: the command again, onto its own results in this folder. A file that is another one afterwards was
# replaced, and this must be said; a file that is still the same one was continued.
onto_own() {
    local name= folder=
    find ${only:-.} -type f -printf '%i %p\n' >../inodes
    rm -rf ../before ../links
    cp -a . ../before && cp -al . ../links # the links keep the numbers of the files
    command "$@"
    while read -r inode name; do
        if [ "$inode" != "$(stat -c %i "$name")" ]; then
            replaced=$((replaced + 1))
            folder=${name%/*} # of lg-export
            case $said in *"${name##*/}: replaces an earlier result"* | *": ${folder##*/}: replaces an earlier result"*) ;;
                *) fail "$*, again: it is not said that $name is replaced: $said" ;;
            esac
        else
            continued=$((continued + 1))
            cmp -s -n "$(stat -c %s "../before/$name")" "../before/$name" "$name" || fail "$*, again: $name is changed"
        fi
    done <../inodes
}

# writes CODE 'OPTIONS' 'MORE NAMES' PROGRAM WORDS...: the command works, with this exit code; OPTIONS are the outputs that
# it is given, MORE NAMES are files that it uses while it works, or sometimes. `only`: the names that are tried, not all.
only=
writes() {
    local code=$1 options=$2 more=$3 what=$4 made= name= option=
    shift 3
    case $what in lg-export) ;; lg-simulate) [ "$2" != merge ] || what+=" merge" ;; *) what+=" $2" ;; esac
    fresh
    command "$@"
    [ $found = $code ] || { fail "$*: exit code $found: $said"; return; }
    rm -rf ../result && cp -a . ../result
    case $said in *replaces*) fail "$*: in an empty folder: $said" ;; esac
    made=$(find . -type f -printf '%P\n' | sort)
    [ -n "$made" ] || fail "$*: nothing is written"
    for option in $options; do covered+="$what --$option "; done
    outputs=$((outputs + $(echo $made $more | wc -w)))
    onto_own "$@"
    [ $found = $code ] || fail "$*, again: exit code $found: $said"
    for name in ${only:-$made $more}; do
        onto_foreign "$name" "$work/in/notes" "$@"
        case $name in
            *.h5)
                onto_foreign "$name" "$work/in/foreign.h5" "$@"
                onto_foreign "$name" "$work/in/own.h5" "$@"
                ;;
            *.csv) [ ! -e "../result/$name" ] || { cp "../result/$name" . && onto_table "$name" "$@"; } ;;
            *.svg) onto_foreign "$name" "$work/in/photo.svg" "$@" ;;
            *.png) onto_foreign "$name" "$work/in/photo.png" "$@" ;;
            *) onto_foreign "$name" "$work/in/zeros" "$@" ;;
        esac
        case $name in *part*) ;; *.h5 | *.csv | *.svg | *.json) onto_link "$name" "$@" ;; esac
    done
}

# trains PROGRAM VERB WORDS...: a training with all of its outputs, and one that is stopped.
trains() {
    writes 0 'out history checkpoint plot' '' "$@" --checkpoint-every 1 --out m.h5 --history h.csv --checkpoint c.h5 --plot p.svg
    writes 0 'checkpoint' '' "$@" --stop-after 1 --out m.h5
}

# ---- the cases ----

in=../in
one='--threads 1'
trains lg-fit train $in/table.csv --outputs y --epochs 4 $one
trains lg-learn train $in/table.csv --recipe table --outputs y --epochs 4 $one
trains lg-hamiltonian train $in/data.h5 --epochs 4 --hidden 4 $one
trains lg-elastica train $in/curves.h5 --epochs 4 --network discrete --hidden 4 $one
trains lg-anomaly train $in/well.h5 --method cnn --epochs 2 $one
trains lg-identify fit $in/machine.yaml $in/log.csv --epochs 4 --method lm $one
writes 0 'out plot' '' lg-anomaly train $in/well.h5 --method tree --out m.h5 --plot p.svg
writes 0 'suggest' '' lg-identify fit $in/machine.yaml $in/log.csv --epochs 2 --out m.h5 --suggest s.yaml
writes 0 'out' m.h5.checkpoint lg-control train $in/task.yaml --seeds 1 --race 2 --finish 0 --polish 0 --starts 64 --out m.h5
writes 0 'out plot' t.csv.part-0-of-2 lg-fit search $in/fit.yaml $in/table.csv --outputs y --trials 2 $one --out t.csv --plot p.svg
writes 0 'out plot' t.csv.part-0-of-2 lg-learn search $in/fit.yaml $in/table.csv --recipe table --outputs y --trials 2 $one --out t.csv --plot p.svg
writes 0 'out plot' t.csv.part-0-of-2 lg-elastica search $in/beam.yaml $in/curves.h5 --trials 2 $one --out t.csv --plot p.svg
writes 0 'out plot' t.csv.part-0-of-2 lg-anomaly search $in/well.yaml $in/well.h5 --trials 2 $one --out t.csv --plot p.svg
writes 0 'out' '' lg-fit search $in/fit.yaml $in/table.csv --outputs y --trials 2 $one --task 0/2 --out t.csv
writes 0 'out plot' t.csv.part-0-of-2 lg-hamiltonian search $in/fit.yaml $in/data.h5 --trials 2 $one --out t.csv --plot p.svg
writes 0 'out plot' s.csv.part-0-of-2 lg-hamiltonian study $in/grid.yaml --jobs 1 $one --out s.csv --plot p.svg
writes 0 'out' d.h5.part-0-of-2 lg-hamiltonian generate $in/pendulum.yaml --trajectories 5 --points 3 --out d.h5
writes 0 'out plot' '' lg-elastica generate --count 20 --intervals 10 --out d.h5 --plot p.svg
writes 0 'out plot' d.h5.part-0-of-2 lg-anomaly generate --noise 10 --runs 2 --hours 1 --out d.h5 --plot p.png
writes 0 'out plot' '' lg-identify generate $in/truth.yaml --runs 2 --t-end 1 --out l.csv --plot p.svg
writes 0 'out' '' lg-anomaly feed --hours 0.1 --noise 10 --out f.csv
writes 0 'plot' '' lg-fit evaluate $in/fit.h5 $in/table.csv --plot p.svg
writes 0 'plot' '' lg-hamiltonian evaluate $in/energy.h5 $in/data.h5 --plot p.svg
writes 0 'plot' '' lg-elastica evaluate $in/beam.h5 $in/curves.h5 --plot p.svg
writes 0 'scores plot' '' lg-anomaly evaluate $in/detector.h5 $in/well.h5 --scores s.csv --plot p.svg
writes 0 'out plot' '' lg-control evaluate $in/policy.h5 --starts 10 --out r.csv --plot p.svg
writes 0 'certificate' '' lg-control certify $in/lqr.yaml --box x=1,vx=1 --certificate c.json
writes 0 'plot' '' lg-identify evaluate $in/body.h5 $in/log.csv --plot p.svg
writes 0 'plot' '' lg-identify check $in/machine.yaml $in/log.csv --plot p.svg
writes 0 'out' '' lg-fit predict $in/fit.h5 $in/table.csv --out p.csv
writes 0 'out' '' lg-learn predict $in/energy.h5 --initial 0,0,-1,0.1,0,0 --t-end 1 --points 3 --out p.csv
writes 0 'out plot' '' lg-hamiltonian predict $in/energy.h5 $in/pendulum.yaml --t-end 1 --points 3 --out p.h5 --plot q.svg
writes 0 'out plot' '' lg-elastica predict $in/beam.h5 --x 0.7 --out p.csv --plot q.svg
writes 0 'out plot' '' lg-identify predict $in/body.h5 $in/log.csv --out p.csv --plot q.svg
writes 0 'out' '' lg-identify adapt $in/body.h5 $in/log.csv --seconds 1 --out a.h5
writes 0 'out plot' '' lg-elastica solve --case right-end --x 0.7 --intervals 10 --out c.csv --plot p.svg
writes 0 'out plot' '' lg-elastica solve --case right-end --sweep 3 --intervals 10 --out c.csv --plot p.svg
writes 0 'log' '' lg-anomaly watch $in/detector.h5 --input $in/feed.csv --log w.txt
writes 0 'log' '' lg-anomaly watch $in/detector.h5 --input $in/feed.csv --log w.txt --json
for target in c casadi fmu2 fmu3 simulink onnx safetensors package; do
    writes 0 'out' '' lg-export $in/fit.h5 --name alarm --target $target --out o
done
writes 0 'out plot' '' lg-simulate $in/pendulum.yaml --out r.h5 --plot p.svg
writes 0 'out plot save' '' lg-simulate $in/pendulum.yaml --ensemble 4 --save all --t-end 0.2 --out e.h5 --plot p.svg
writes 0 'out save' '' lg-simulate $in/pendulum.yaml --ensemble 40 --save all --t-end 0.2 --task 0/2 --out e.h5
writes 0 'out plot' '' lg-simulate merge m.h5 $in/e.part-0-of-2.h5 $in/e.part-1-of-2.h5 --plot p.svg
for case in hamiltonian hamiltonian-small hamiltonian-double hamiltonian-quartic; do
    writes 0 'out' '' lg-bench $case --epochs 2 --width 4 --out b
done
writes 0 'out' '' lg-hamiltonian demo --epochs 2 --t-end 1 --out o
# These demos run for seconds. The controller of a short fit fails (4), when all files are written. What a user has changed in
# a text of a demo stays.
only='o/truth.yaml o/machine.yaml o/train.csv' writes 4 'out' '' lg-identify demo --epochs 2 --seconds 1 --out o
sed '$a# mine' o/machine.yaml >../in/mine.yaml
onto_foreign o/machine.yaml "$work/in/mine.yaml" lg-identify demo --epochs 2 --seconds 1 --out o
only='o/truth.yaml o/cart.yaml o/task.yaml o/log.csv o/cart.h5' writes 0 'out' '' lg-control demo --seconds 1 --out o
sed '$a# mine' o/task.yaml >../in/mine.yaml
onto_foreign o/task.yaml "$work/in/mine.yaml" lg-control demo --seconds 1 --out o
[ "$(ls o)" = task.yaml ] || fail "lg-control demo: writes files beside one that it refuses: $(ls o)"

# Nothing is said of a file that the command continues.
continues() {
    command "$@"
    case $found$said in 0*replaces* | [!0]*) fail "$*: exit code $found: $said" ;; esac
}
fresh
command lg-fit train $in/table.csv --outputs y --epochs 4 $one --stop-after 1 --out m.h5
continues lg-fit train $in/table.csv --outputs y --epochs 4 $one --stop-after 1 --resume m.h5.checkpoint --out m.h5
continues lg-fit train $in/table.csv --outputs y --epochs 4 $one --resume m.h5.checkpoint --out m.h5
command lg-fit search $in/fit.yaml $in/table.csv --outputs y --trials 2 $one --out t.csv
continues lg-fit search $in/fit.yaml $in/table.csv --outputs y --trials 3 $one --out t.csv --resume
refuses t.csv "$work/in/notes" lg-fit search $in/fit.yaml $in/table.csv --outputs y --trials 3 $one --out t.csv --resume
refuses m.h5 "$work/in/notes" lg-fit train $in/table.csv --outputs y --epochs 5 $one --resume m.h5.checkpoint --out m.h5
cp $in/energy.h5 .
continues lg-hamiltonian evaluate energy.h5 $in/data.h5 --record
printf 'y\nmy only data\n' >$in/words.csv
printf 'y\n0.1\n0.7\n' >$in/numbers.csv
for mine in words numbers; do refuses p.csv "$work/in/$mine.csv" lg-fit predict $in/fit.h5 $in/table.csv --out p.csv; done

# Spellings of other programs: blanks around a number, a number in quotes, carriage returns, no last line end, one
# cell more or less, a line without cells, text behind a quote.
fresh
command lg-identify predict $in/body.h5 $in/log.csv --out p.csv
for change in '2s/^/ /' '2s/$/ /' '2s/,/ ,/' '2s/,/,\t/' '2s/^[^,]*/"&"/' '2s/^[^,]*/ ""/' '2s/$/\r/' '2,$s/$/\r/' '$s/$/,1/' \
    '$s/,[^,]*$//' '3s/.*//' '3s/^/\n/' '3s/^/# /' '2s/^/"a"b/' '2s/[0-9]$/&0/'; do
    sed "$change" p.csv >$in/changed.csv
    ! cmp -s p.csv $in/changed.csv || fail "$change: changes nothing"
    cp p.csv kept.csv
    refuses p.csv $in/changed.csv lg-identify predict $in/body.h5 $in/log.csv --out p.csv
    mv kept.csv p.csv
done
printf %s "$(cat p.csv)" >$in/changed.csv
cp p.csv kept.csv
refuses p.csv $in/changed.csv lg-identify predict $in/body.h5 $in/log.csv --out p.csv
mv kept.csv p.csv
for change in '2s/^[^,]*//' '2s/^[^,]*/""/' '2s/^[^,]*/nan/' '$d'; do
    sed -i "$change" p.csv
    command lg-identify predict $in/body.h5 $in/log.csv --out p.csv
    case $found$said in 0*p.csv:\ replaces*) ;; *) fail "$change: an earlier result is not replaced: code $found: $said" ;; esac
done

# A link to an earlier result stays, also where the rows of the file are written one by one.
keeps_link() {
    local name=$1
    shift
    fresh
    command "$@" && mv "$name" ../far && ln -s ../far "$name"
    command "$@"
    [ -L "$name" ] && [ $found = 0 ] || fail "$*: the link $name is replaced: code $found: $said"
}
keeps_link f.csv lg-anomaly feed --hours 0.1 --noise 10 --out f.csv
keeps_link p.csv lg-fit predict $in/fit.h5 $in/table.csv --out p.csv
keeps_link e.trajectories.h5 lg-simulate $in/pendulum.yaml --ensemble 4 --save all --t-end 0.2 --out e.h5

# ---- all outputs of all programs ----

reasons='lg-bench elastica-discrete --out: takes 5 s; writes as hamiltonian does
lg-bench elastica-continuous --out: takes a minute; writes as hamiltonian does
lg-bench elastica-angle --out: takes a minute; writes as hamiltonian does'
for case in $(lg-bench list | awk '{ print $1 }'); do # the other cases have the option, and write nothing
    case $case in hamiltonian* | elastica-discrete | elastica-continuous | elastica-angle) ;; *) reasons+="
lg-bench $case --out: writes nothing" ;; esac
done
# verbs PROGRAM: its commands, or one empty word.
verbs() { "$1" --help | awk '/^Commands:/ { on = 1; next } on && /^$/ { exit } on && /^  [a-z]/ { print $1 }'; }
inputs='resume|inputs|gradient|test|input|plant|disturb|reference|constraint|penalty-integral|members|excitation|scheme|weights'
reached=0 excused=0 commands=0
for program in $(cd "$LG_BIN_DIR" && echo lg-*); do
    list=$(verbs $program)
    [ $program != lg-simulate ] || list='none merge'
    for verb in ${list:-none}; do
        commands=$((commands + 1))
        what=$program
        [ $verb = none ] && verb= || what+=" $verb"
        for option in $($program $verb --help-all | grep -oE -- '--[a-z-]+=[^ ]*(FILE|DIR|FOLDER|PREFIX|\.h5|\.csv)' | sed 's/=.*//' | grep -vxE -- "--($inputs)"); do
            case $covered in *" $what $option "*) reached=$((reached + 1)) && continue ;; esac
            case "
$reasons" in *"
$what $option: "*) excused=$((excused + 1)) ;; *) fail "$what $option: no case writes this output" ;; esac
        done
    done
done
[ $excused = $(echo "$reasons" | wc -l) ] || fail "a reason is given for an output that does not exist, or that is written: $reasons"
[ $commands -gt 40 ] || fail "only $commands commands"
echo "$commands commands: $reached outputs reached, $excused not"
echo "$runs runs; $outputs files, kept $kept times and $links links, replaced $replaced, continued $continued"
exit $status
