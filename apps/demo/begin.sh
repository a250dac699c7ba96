# Every demo.sh begins with these lines. A signal is passed on to the command that runs, which saves its state.
# The folder of the program that runs the demo becomes the first of PATH. An empty entry would be the demo's folder.
PATH=${PATH:-/usr/bin:/bin} PATH=$(dirname "$(readlink "/proc/$PPID/exe")"):$PATH
# fail CODE SENTENCE: ends the demo.
fail() { printf '%s: %s\n' "$0" "$2" >&2; exit "$1"; }
# run COMMAND...: shows the command and runs it. result COMMAND...: likewise; with --json its object is all that is printed.
run() {
    printf '\n$ %s\n' "$*" || exit 3
    [ "$1" = make ] || set -- "$@" --threads "$LG_THREADS"
    "$@" >&"${to:-1}" 3>&- & child=$! code=0
    wait $child || code=$?
    while kill -0 $child 2>/dev/null; do wait $child || code=$?; done
    [ $code = 0 ] || fail $code "'$*' ended with exit code $code"
}
result() { [ -z "$LG_JSON" ] || set -- "$@" --json; to=3 run "$@"; }
trap 'trap "" INT TERM; kill "${child-}" 2>/dev/null || exit 130' INT TERM
exec 3>&1
[ -z "$LG_JSON" ] || exec >/dev/null
