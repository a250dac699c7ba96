# Sourced by scripts that start programs with mpirun: makes a folder for them, and exits with 77 (skipped) without mpirun
# or liegrad_mpi.
set -eu
command -v mpirun >/dev/null && find "$LG_BIN_DIR"/../lib* -name libliegrad_mpi.so | grep -q . || { echo "no MPI here"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PATH=$LG_BIN_DIR:$PATH OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
cd "$work"
ranks() { timeout 300 mpirun --oversubscribe "$@"; }
