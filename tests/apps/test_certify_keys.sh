#!/bin/bash
# Each key of a task and of a machine's file has its place in docs/certificates.md: in the proof, not covered, or without
# an effect on the closed loop. test_control_certify runs what is in the proof.
# ctest-labels: apps/lg-control
set -u
cd "$(dirname "$0")/../.." || exit 1
page=docs/certificates.md wrong=0

# The keys of the first table `keys` of a source file
keys_of() {
    sed -n '/^static const lg_field keys\[/,/^};/p' "$1" |
        sed 's/LG_KEY_HIDDEN/.name = "hidden"/' |
        grep -oE '(\.name = |(FIELD|LG_NODE|LG_MAP)\((lg_[a-z_]*, NULL, )?)"[a-z_.]+"' | grep -oE '"[^"]+"' | tr -d '"'
}

# The keys in the first column of the table below a heading
rows_of() {
    sed -n "/^| keys of $1 | |/,/^\$/p" $page | cut -d'|' -f2 | grep -oE '`[^`]+`' | tr -d '`'
}

while IFS=: read -r what source least; do
    keys=$(keys_of "$source" | sort) rows=$(rows_of "$what" | sort)
    [ "$(echo "$keys" | wc -l)" -ge "$least" ] || { echo "$source: its table of keys was not found"; wrong=1; }
    while read -r side key; do
        [ -n "$key" ] || continue
        case $side in
            key) echo "$page has no row for the key $key of $what ($source)" ;;
            row) echo "$page names $key, which is no key of $what ($source)" ;;
        esac
        wrong=1
    done < <(comm -23 <(echo "$keys") <(echo "$rows") | sed 's/^/key /'
        comm -13 <(echo "$keys") <(echo "$rows") | sed 's/^/row /')
done <<END
the task:src/control/files/policy_task.c:24
a machine:src/machine/files/machine.c:22
END
exit $wrong
