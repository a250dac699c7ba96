#!/bin/bash
# The rooms of src/ may include each other only along the arrows of docs/architecture.md. The files and folders that this
# page names must exist: at the given path, or, if no folder is given, anywhere in src or apps. Functions that
# docs/formulas.md names are in their files. The folders of tests are the rooms of src, and some others.
set -u
cd "$(dirname "$0")/../../src" || exit 1

# The rooms that a room may include. The last rows are the subjects, which do not include each other.
may() {
    case $1 in
        core) ;;
        kernels | settings | mpi) echo core ;;
        autodiff) echo core kernels ;;
        nn | integrators) echo core kernels autodiff ;;
        mechanics) echo core kernels autodiff integrators ;;
        model) echo core kernels autodiff integrators ;;
        control) echo core kernels autodiff nn integrators model ;;
        certify) echo core kernels autodiff ;; # no room stands on it
        files) echo core ;;
        settings/files) echo core files settings ;;
        datasets) echo core files settings settings/files ;;
        integrators/files) echo core files settings settings/files ;;
        mechanics/files) echo core files settings settings/files mechanics ;;
        model/files) echo core files settings settings/files model ;;
        */files) echo core files settings settings/files datasets mechanics/files model/files "${1%/files}" ;;
        *) echo core kernels autodiff nn integrators mechanics model settings ;;
    esac
}

room_of() { # hamiltonian/files/model.c -> hamiltonian/files; autodiff/tape/tape.c -> autodiff
    case $1 in
        files/*) echo files ;;
        */files/*) echo "${1%%/*}/files" ;;
        *) echo "${1%%/*}" ;;
    esac
}

wrong=0
while IFS=: read -r file line; do
    header=${line#*\"} header=${header%%\"*}
    from=$(room_of "$file") to=$(room_of "$header")
    case $header in liegrad/* | [!/]*.h*) [ "${header#*/}" != "$header" ] || continue ;; esac
    [ "${header#liegrad/}" = "$header" ] || continue
    [ "$from" != "$to" ] || continue
    if ! may "$from" | tr ' ' '\n' | grep -qx "$to"; then
        echo "src/$file includes $header: $from does not stand on $to"
        wrong=1
    fi
done < <(grep -rE '^ *# *include *"' --include='*.c' --include='*.h' --include='*.inc' . | sed 's|^\./||')
# Headers of the tree have quotes and a path from src or include.
while IFS= read -r line; do
    case ${line#*:} in *'<liegrad/'* | *'"../'* | *'"./'*) ;; *) [ -d "$(sed 's|.*<\([a-z]*\)/.*|\1|' <<<"$line")" ] || continue ;; esac
    echo "src/$line: headers of the tree have quotes and a path from src"
    wrong=1
done < <(grep -rE '^ *# *include *(<[a-z]+/|"\.\.?/)' --include='*.c' --include='*.h' --include='*.inc' . | sed 's|^\./||')
# Nothing but the room certify includes its public headers.
for header in $(cd .. && grep -lE '["<]liegrad/(certify|lyapunov|interval)\.h[">]' include/liegrad/*.h $(find src -name '*.[ch]') |
    grep -vE '^src/certify/|^include/liegrad/(certify|lyapunov|interval)\.h$'); do
    echo "$header includes a header of certificates: only src/certify does"
    wrong=1
done
for room in */; do
    room=${room%/}
    [ -n "$(find "$room" -name '*.c')" ] || { echo "src/$room has no source"; wrong=1; }
done
cd ..
for suite in tests/*/test_*.c; do
    folder=${suite#tests/} folder=${folder%%/*}
    case $folder in
        apps | crash | examples) ;;
        *) [ -d "src/$folder" ] || { echo "$suite: src has no room $folder"; wrong=1; } ;;
    esac
done
for name in $(grep -o '`[a-z0-9_./-]*`' docs/architecture.md | tr -d '`' | grep -E '/|\.[ch]$' | sort -u); do
    case $name in
        */*) [ -e "$name" ] || [ -e "src/$name" ] ;;
        *) find src apps -name "$name" | grep -q . ;;
    esac || { echo "docs/architecture.md names $name: there is no such file"; wrong=1; }
done
while read -r name function; do
    file=src/$name
    [ -e "$file" ] || file=$name
    grep -qw "$function" "$file" || { echo "docs/formulas.md: $name has no $function"; wrong=1; }
done < <(grep -oE '`[a-z0-9_./-]+\.(c|h|inc)` [A-Za-z0-9_]+' docs/formulas.md | tr -d '`')
exit $wrong
