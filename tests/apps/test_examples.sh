# Runs the examples of the manual pages as one script.
# ctest-labels: slow apps/examples.sh apps/common
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PATH=$LG_BIN_DIR:$PATH
root=$LG_TEST_DIR/..
examples=$(cd "$root/apps" && pwd)/examples.sh
ln -s "$root/scenes" "$root/searches" "$work"
cd "$work"
bash -eux -o pipefail "$examples" >out 2>err || { tail -n 20 out err; exit 1; }
