# The manual pages of the build: one for each program and command, whole, rendered without a warning.
set -u
export LC_ALL=C.UTF-8 MANWIDTH=80
manual=$LG_BIN_DIR/../manual
[ -d "$manual" ] || { echo "there are no manual pages in this build"; exit 77; }
command -v man >/dev/null || { echo "there is no man"; exit 77; }
status=0
fail() { echo "$*"; status=1; }

for program in "$LG_BIN_DIR"/lg-*; do
    name=$(basename "$program")
    pages=$name
    if [ "$name" != lg-bench ]; then # its commands are cases, with the same options
        for command in $("$program" --help | sed -n '/^Commands:/,/^$/s/^  \([a-z][^ ]*\)  .*/\1/p'); do pages+=" $name-$command"; done
    fi
    for title in $pages; do
        page=$manual/$name/$title.1
        [ -s "$page" ] || { fail "there is no page $title; does apps/examples.sh have its examples?"; continue; }
        warnings=$(man --warnings -E UTF-8 -l -Tutf8 -Z "$page" 2>&1 >/dev/null)
        [ -z "$warnings" ] || fail "$title: $warnings"
        text=$(man -E UTF-8 -l "$page" | col -bx)
        for line in '^NAME' "^ +$title +- +[a-z]" '^SYNOPSIS' '^ *--json' '^EXAMPLES' "^       $name .*"; do
            grep -qE -- "$line" <<<"$text" || fail "$title has no line $line"
        done
    done
done
pages=$(find "$manual" -name '*.1' | wc -l)
[ "$pages" -ge 30 ] || fail "$pages pages"
exit $status
