#!/bin/bash
# The executable liegrad runs a program by the name of a link or by its first argument, and no program by another name.
# ctest-labels: apps/common
set -u
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
liegrad=$LG_BIN_DIR/liegrad wrong=0

# expect CODE WORDS COMMAND...: the exit code of the command, and words of what it prints
expect() {
    local code=$1 words=$2 text got
    shift 2
    text=$("$@" 2>&1) && got=0 || got=$?
    [ "$got" = "$code" ] && grep -qF -- "$words" <<<"$text" || { echo "$*: exit code $got, not $code, or no '$words': $text"; wrong=1; }
}

for link in "$LG_BIN_DIR"/lg-*; do
    [ -L "$link" ] || continue
    name=$(basename "$link")
    expect 0 "$name (liegrad)" "$link" --version
    expect 0 "$name (liegrad)" "$liegrad" "$name" --version
    expect 0 "$name" "$liegrad" --help
    expect 2 'must be a program' "$liegrad" "${name}x" --version
done
[ "$(find "$LG_BIN_DIR" -type l -name 'lg-*' | wc -l)" = 9 ] || { echo "there are not nine links"; wrong=1; }
ln -s "$liegrad" "$work/fit"
expect 2 'must be a program' "$work/fit" --version
expect 0 'lg-fit (liegrad)' "$work/fit" lg-fit --version
expect 2 'must be a program' "$liegrad"
exit $wrong
