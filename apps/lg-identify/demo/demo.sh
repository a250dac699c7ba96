run lg-identify generate truth.yaml --out train.csv --runs 12 --t-end 6 --excitation multisine --amplitude 0.3
run lg-identify generate truth.yaml --out test.csv --runs 4 --t-end 6 --excitation multisine --amplitude 0.25 --seed 2
run lg-identify check machine.yaml train.csv --plot log.svg
run lg-identify fit machine.yaml train.csv --out model.h5 --seconds "$LG_SECONDS" --epochs "${LG_EPOCHS:-300}" --plot fit.svg \
    --seed "$LG_SEED"
echo 'The true machine: mass 0.05, 0.06, 0.03, damping 0.01, 0.012, 0.008'
run lg-identify evaluate model.h5 test.csv --plot learned.svg
run lg-identify predict model.h5 test.csv --out predicted.csv --plot predicted.svg
run lg-control train task.yaml --robustness 0 --out policy.h5
result lg-control evaluate policy.h5 --plant truth.yaml
[[ $(lg-control evaluate policy.h5 --plant truth.yaml --json) =~ ^[^}]*'"success": '(1|0\.99) ]] ||
    fail 4 "the controller fails on the true machine: more --seconds"
