# Files of a user whose names look like those of locks or temporary files: every command leaves them as they are, and
# refuses to write if one has the name that the lock must have.
# shellcheck disable=SC2086 # words are split on purpose
# ctest-labels: src/files apps/common
set -u
export PATH=$LG_BIN_DIR:$PATH LC_ALL=C
status=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/in" "$work/w"
cd "$work/w" || exit 1
fail() { echo "$*"; status=1; }

# look: all files but the outputs: names, inodes, kinds, sizes, times.
look() { find . -mindepth 1 -printf '%P %i %y %s %C@\n' | grep -vE '^(out|out\.csv|out\.h5\.lock)(/[^ ]*)? ' | sort; }
# run CODE WORDS COMMAND...: checks the exit code, what is said, and that only outputs have changed.
run() {
    local code=$1 words=$2 before now said found
    shift 2
    before=$(look)
    said=$(timeout 60 "$@" 2>&1 </dev/null)
    found=$?
    now=$(look)
    [ "$now" = "$before" ] || fail "$*: changed: $(diff <(echo "$before") <(echo "$now"))"
    [ $found = "$code" ] || fail "$*: exit code $found, not $code: $said"
    case $said in *"$words"*) ;; *) fail "$*: '$words' is not in '$said'" ;; esac
}

# ---- names that look like locks and temporary files, around outputs that are written ----

for i in $(seq 40); do echo "$i.5,$((i * 3 % 7))"; done | sed '1i x,y' >../in/table.csv
lg-fit train ../in/table.csv --outputs y --hidden 4 --epochs 2 --out ../in/fit.h5 >/dev/null 2>&1 || exit 2
train="--outputs y --hidden 4 --epochs 2 --out"
rows=0
for name in out out.csv; do
    echo important >$name.lock
    cp ../in/table.csv $name.tmp-1-0
    mkdir $name.tmp-2024-1 .$name.liegrad-tmp-7-1
    echo mine >$name.tmp-2024-1/results.csv
    echo mine >.$name.liegrad-tmp-7-1/results.csv
    cp ../in/table.csv ".$name.liegrad-tmp-$(stat -c %i $name.lock)-1"
    echo important >.$name.lock
    for command in "lg-fit predict ../in/fit.h5 ../in/table.csv --out $name" "lg-fit predict ../in/fit.h5 $name.tmp-1-0 --out $name" \
        "lg-fit train ../in/table.csv $train $name" "lg-fit train $name.tmp-1-0 $train $name" \
        "lg-fit train ../in/table.csv $train $name --history out.h5.lock" "lg-export ../in/fit.h5 --name f --out $name"; do
        rm -rf $name
        run 0 '' $command
        rows=$((rows + 1))
        [ -z "$(find . -name '*.liegrad-lock')" ] || fail "$command leaves a lock"
    done
done
[ -s out.h5.lock ] || fail "the history is lost"

# ---- every command: a file that has the name of the output's lock, an output that has the name of a lock ----

# verbs PROGRAM: its commands, or one empty word.
verbs() { "$1" --help | awk '/^Commands:/ { on = 1; next } on && /^$/ { exit } on && /^  [a-z]/ { print $1 }'; }
# try WORDS: the command with as many inputs as it takes must say WORDS.
try() {
    local inputs said
    for inputs in '' ../in/1 '../in/1 ../in/2'; do
        said=$(timeout 60 $program $verb $inputs --$option=$path $more 2>&1 </dev/null)
        case $said in *' argument'* | *'no start'*) ;; *) break ;; esac
    done
    run 3 "$1" $program $verb $inputs --$option=$path $more
}
for program in $(cd "$LG_BIN_DIR" && echo lg-*); do
    [ "$program" != lg-bench ] || continue
    commands=$(verbs "$program")
    for verb in ${commands:-none}; do
        [ "$verb" = none ] && verb=
        help=$($program $verb --help-all)
        for option in out history checkpoint plot log; do
            case $help in *"--$option="*) ;; *) continue ;; esac
            case "$program $verb $option" in *demo* | 'lg-export '* | 'lg-elastica solve'*) continue ;; esac # folders; a case is required
            more=
            [ $option = out ] || case $help in *"--out="*) more='--out=out.h5' ;; esac
            case $help in *--recipe=*) more+=' --recipe=hamiltonian' ;; esac
            case $option in plot) end=.svg ;; history | log) end=.csv ;; *) end=.h5 ;; esac
            echo important >.mine$end.liegrad-lock
            path=mine$end
            try "but that is not a lock: move it away"
            path=.mine$end.liegrad-lock
            [ $option = plot ] || try "locks and temporary files have such names"
            rm .mine$end.liegrad-lock
            rows=$((rows + 1))
        done
    done
done
[ $rows -gt 40 ] || fail "only $rows rows"
echo "$rows rows"
exit $status
