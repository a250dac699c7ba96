# In a copied tree, a copied build folder would build the original tree. Every script that builds must refuse such a
# folder.
set -u
status=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/tree/build" "$work/other" "$work/bin"
cp -r "$LG_TEST_DIR/../scripts" "$work/tree/scripts"
ln -s tree "$work/link"
cd "$work/tree" || exit 1
for stub in scripts/deps ../bin/cmake ../bin/ctest; do
    printf '#!/bin/sh\necho "%s $*" >>"%s/said"\n' "${stub##*/}" "$work" >$stub
    chmod +x $stub
done
PATH=$work/bin:$PATH
unset LIEGRAD_BUILD

# configured HOME: makes build/ look as if it was configured for the tree HOME.
configured() { printf 'CMAKE_HOME_DIRECTORY:INTERNAL=%s\n' "$1" >build/CMakeCache.txt; rm -f "$work/said"; }

for command in 'configure build' build test demo; do
    for tree in "$work/other" "$work/gone"; do
        configured "$tree"
        # shellcheck disable=SC2086 # a script and its argument
        said=$(scripts/$command 2>&1) && { echo "scripts/$command: builds $tree"; status=1; }
        case $said in
            *"build was configured for $tree and would build that tree, not $work/tree"*) ;;
            *) echo "scripts/$command: says '$said'"; status=1 ;;
        esac
        grep -q '^cmake' "$work/said" 2>/dev/null && { echo "scripts/$command: starts cmake"; status=1; }
    done
done
for tree in "$work/tree" "$work/link"; do
    configured "$tree"
    scripts/configure build || { echo "scripts/configure: refuses its tree as $tree"; status=1; }
    grep -q '^cmake -S' "$work/said" || { echo "scripts/configure: does not start cmake for $tree"; status=1; }
done
rm build/CMakeCache.txt
scripts/configure build && grep -q 'CMAKE_BUILD_TYPE=Release' "$work/said" || { echo "scripts/configure: no new folder"; status=1; }
exit $status
