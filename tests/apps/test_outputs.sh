# If printed output cannot be written the command must fail, with --help too. Every command must refuse an output file
# that cannot be written before it does any work.
# shellcheck disable=SC2086 # words are split on purpose
set -u
export LC_ALL=C
status=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
fail() { echo "$*"; status=1; }

# verbs PROGRAM: its commands, or one empty word.
verbs() { "$LG_BIN_DIR/$1" --help | awk '/^Commands:/ { on = 1; next } on && /^$/ { exit } on && /^  [a-z]/ { print $1 }'; }

# expect CODE WORDS COMMAND...: standard output is a full device if OUTPUT says so.
expect() {
    local code=$1 words=$2 found
    shift 2
    said=$(timeout 60 "$@" 2>&1 >"${OUTPUT:-/dev/null}" </dev/null)
    found=$?
    [ $found = "$code" ] || fail "$*: exit code $found, not $code: $said"
    case $said in *"$words"*) ;; *) fail "$*: '$words' is not in '$said'" ;; esac
}

pipe_or_device() {
    case "$2 $3" in 'feed out' | 'watch log') return 0 ;; esac # written while the command runs
    return 1
}

programs=$(cd "$LG_BIN_DIR" && echo lg-*)
for program in $programs; do
    run=$LG_BIN_DIR/$program
    commands=$(verbs "$program")
    [ -c /dev/full ] && for option in --help --usage --version; do
        OUTPUT=/dev/full expect 3 'could not be written to standard output' "$run" $option
    done
    for verb in $commands; do
        [ -c /dev/full ] && OUTPUT=/dev/full expect 3 'could not be written to standard output' "$run" "$verb" --help
    done
    [ "$program" != lg-bench ] || continue
    for verb in ${commands:-none}; do
        [ "$verb" = none ] && verb=
        help=$("$run" $verb --help-all)
        for option in out history checkpoint; do
            case $help in *"--$option="*) ;; *) continue ;; esac
            pipe_or_device "$program" "$verb" $option && continue
            case "$program $verb" in 'lg-export ' | *demo | 'lg-elastica solve') continue ;; esac # outputs that are folders; a case is required
            out=
            [ $option = out ] || out='--out=x.h5'
            case $help in *--recipe=*) out+=' --recipe=hamiltonian' ;; esac
            for inputs in '' absent1 'absent1 absent2'; do # as many inputs as the command takes
                said=$(timeout 60 "$run" $verb $inputs --$option=/dev/null $out 2>&1 </dev/null)
                found=$?
                case $said in *' argument'* | *'no start'*) ;; *) break ;; esac
            done
            case $found$said in
                3*'/dev/null: cannot be written: it is not a regular file'*) ;;
                *) fail "$program $verb --$option=/dev/null: exit code $found: $said" ;;
            esac
        done
    done
done
expect 3 'not a regular file' "$LG_BIN_DIR/lg-simulate" merge /dev/null part.h5
mkdir folder
expect 3 'it is a folder' "$LG_BIN_DIR/lg-fit" train absent.csv --out folder
[ -c /dev/full ] && OUTPUT=/dev/full expect 3 'could not be written to standard output' "$LG_BIN_DIR/lg-bench" list
[ -z "$(find . -type f)" ] || fail "files are left: $(find . -type f)"
exit $status
