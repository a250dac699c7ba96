# Hostile names in every place of every format where a name can stand, in all programs: nothing runs, nothing lands outside the outputs,
# plots show the names (names.py; names.py BIN --seconds S tries random names).
# ctest-labels: slow apps/common apps/plots
exec python3 "$LG_TEST_DIR/apps/names.py" "$LG_BIN_DIR"
