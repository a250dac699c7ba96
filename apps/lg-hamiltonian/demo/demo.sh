run lg-hamiltonian generate pendulum.yaml --seed "$LG_SEED" --out train.h5
run lg-hamiltonian generate pendulum.yaml --trajectories 100 --points 15 --t-end 1 \
    --seed "$(printf %u $((LG_SEED + 0x9e3779b9)))" --out test.h5
# shellcheck disable=SC2086 # nothing unless --epochs is given
run lg-hamiltonian train train.h5 ${LG_EPOCHS:+--epochs $LG_EPOCHS} --seed "$LG_SEED" --history loss.csv --plot loss.svg --out model.h5
result lg-hamiltonian evaluate model.h5 test.h5 --record --plot trajectories.svg
echo 'Published for 500 such trajectories (thesis, section 4.4.3): E1 1.7e-7, E2 3.4e-4'
run lg-hamiltonian predict model.h5 start.yaml --t-end "$LG_T_END" --points 2001 --plot prediction.svg
