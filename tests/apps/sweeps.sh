# Sourced by scripts that test sweeps: makes a small search and a small study, and compares tables except for their times.
fail() { echo "$*" >&2; exit 1; }

make_sweeps() {
    lg-elastica generate --case right-end --count 60 --intervals 20 --out data.h5 >made
    cat >ranges.yaml <<'RANGES'
fixed: {network: angle, epochs: 20, batch: 20, most-curves: 0}
ranges:
  lr: {log-uniform: [1e-4, 1e-1]}
  layers: {integer: [1, 3]}
  hidden: {choice: [8, 16, 24]}
RANGES
    cp "$LG_TEST_DIR/../scenes/pendulum.yaml" .
    cat >grid.yaml <<'GRID'
scene: pendulum.yaml
integrators: [euler, cf4]
N: [20, 40]
M: [2, 5]
eps: [0, 1e-2]
repeats: 2
t_end: 0.1
epochs: 20
batch: 40
lr: 1e-2
lr_step: 50
lr_gamma: 0.1
test: {trajectories: 10, points: 5}
seed: 1
GRID
}

without_seconds() {
    awk -F, -v OFS=, '/^#/ {print; next} !c {for (i = 1; i <= NF; i++) if ($i == "seconds") c = i} {$c = ""; print}' "$1"
}

same_table() { diff <(without_seconds "$1") <(without_seconds "$2") >/dev/null; }

# The hash of the data that a command wrote, from its JSON.
sha() { grep -o '"sha256": "[0-9a-f]*"' "$1"; }
