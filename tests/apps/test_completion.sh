# Completion by bash for every program and command: commands, options, choices and files.
# shellcheck disable=SC2034 # COMP_WORDS is read by the completion
set -u
export LC_ALL=C
status=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
mkdir runs
touch model.h5 notes.txt scene.yaml
# shellcheck source=/dev/null
. "$LG_TEST_DIR/../apps/completion.bash"

# completed WORD...: prints the completions of the last word.
completed() {
    COMP_WORDS=("$LG_BIN_DIR/$1" "${@:2}") COMP_CWORD=$(($# - 1)) COMPREPLY=()
    _liegrad
    printf '%s\n' ${COMPREPLY[@]+"${COMPREPLY[@]}"} | sort | paste -sd ' '
}
# expect RESULT WORD...: the completions must be RESULT.
expect() {
    local expected=$1 found
    shift
    found=$(completed "$@")
    [ "$found" = "$expected" ] || { echo "$*: '$found', not '$expected'"; status=1; }
}
expect 'train' lg-hamiltonian tr
expect 'demo evaluate generate predict search study train' lg-hamiltonian ''
expect 'evaluate' lg-hamiltonian --seed 3 ev
expect '--penalty-form= --penalty-integral= --penalty=' lg-hamiltonian train --pen
expect '--json' lg-hamiltonian --js
expect 'cf32a cf32b cf4 cf43' lg-hamiltonian train --scheme = cf
expect 'cf32a cf32b cf4 cf43' lg-hamiltonian train --scheme cf
expect '--scheme=cf43' lg-hamiltonian train --scheme=cf43 --scheme=cf43
expect 'best thesis' lg-hamiltonian train --preset =
methods=$("$LG_BIN_DIR/lg-hamiltonian" train x --out y --optimizer none 2>&1 | sed -n 's/.*there are //p' | tr -d , | tr ' ' '\n' | LC_ALL=C sort | tr '\n' ' ')
expect "${methods% }" lg-hamiltonian train --optimizer ''
expect 'model.h5 runs scene.yaml' lg-hamiltonian predict ''
expect 'runs scene.yaml' lg-simulate ''
expect 'notes.txt' lg-hamiltonian train --out = no
expect '' lg-hamiltonian train --epochs = ''
expect '' lg-hamiltonian nothing --scheme = cf

# Every option in --help-all must be completed.
for program in "$LG_BIN_DIR"/lg-*; do
    program=$(basename "$program")
    for command in $("$LG_BIN_DIR/$program" --help | sed -n '/^Commands:/,/^$/s/^  \([a-z][^ ]*\)  .*/\1/p' | head -n 6) ''; do
        shown=$("$LG_BIN_DIR/$program" $command --help-all | sed -n 's/^  \{1,5\}\(-., \)\?\(--[a-z0-9-]*=\?\).*/\2/p' | sort | paste -sd ' ')
        expect "$shown" "$program" ${command:+"$command"} -
    done
done

# Completing a value must not run a command, not even one that needs no argument: nothing may be written or printed.
for program in 'lg-hamiltonian demo' 'lg-anomaly feed' lg-gradcheck; do
    for option in $(completed $program -); do
        completed $program "${option%=}" '' >/dev/null 2>said
        [ ! -s said ] || { echo "$program $option:"; cat said; status=1; }
    done
done
rm -f said
[ "$(echo *)" = 'model.h5 notes.txt runs scene.yaml' ] || { echo "completion left files:" *; status=1; }
exit $status
