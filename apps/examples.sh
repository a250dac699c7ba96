# The examples of the manual pages. `#: PAGE` begins those of a page: a program or one of its commands; a command without
# examples has no page of its own. Together they are one script, which the test test_manual runs; scenes/ and searches/ are
# those of share/liegrad.

#: lg-simulate
# A heavy top by the default method, with a plot; then 2000 equal steps of a commutator-free method.
lg-simulate scenes/heavy-top.yaml --plot top.svg
lg-simulate scenes/heavy-top.yaml --scheme cf4 --steps 2000 --out top.h5
# The derivatives of the last position of a double pendulum by the start, the masses and the lengths.
lg-simulate scenes/double-pendulum.yaml --gradient 1,0,0,0,0,0,0,0,0,0,0,0 --json
# 10000 pendulums from random starts: bands of quantiles, and when each one passes the height of its hinge.
lg-simulate scenes/pendulum-ensemble.yaml --ensemble 10000 --scheme dp85 --event 'q1.z>0' --plot bands.svg
# Two parts of an ensemble with masses of 5 % tolerance, as two jobs of an array would run them, become one file.
lg-simulate scenes/double-pendulum.yaml --ensemble 4000 --vary masses=within:5% --task 0/2 --out study.h5
lg-simulate scenes/double-pendulum.yaml --ensemble 4000 --vary masses=within:5% --task 1/2 --out study.h5
lg-simulate merge study.h5 study.part-0-of-2.h5 study.part-1-of-2.h5

#: lg-hamiltonian
# From a scene to a learned model, its error and a prediction.
lg-hamiltonian generate scenes/pendulum.yaml --out data.h5
lg-hamiltonian train data.h5 --scheme cf4 --epochs 50 --out model.h5
lg-hamiltonian evaluate model.h5 data.h5
lg-hamiltonian predict model.h5 scenes/pendulum.yaml --t-end 10 --plot flow.svg

#: lg-hamiltonian generate
# Training data with noise on all points but the first, and test data without.
lg-hamiltonian generate scenes/pendulum.yaml --noise 1e-3 --out data.h5
lg-hamiltonian generate scenes/pendulum.yaml --trajectories 100 --points 15 --seed 2 --out test.h5

#: lg-hamiltonian train
# Adam, 50 epochs, with a table of the loss.
lg-hamiltonian train data.h5 --epochs 50 --history loss.csv --out model.h5
# A quasi-Newton method for three seconds.
lg-hamiltonian train data.h5 --optimizer ssbroyden --seconds 3 --out model.h5

#: lg-hamiltonian evaluate
lg-hamiltonian evaluate model.h5 test.h5 --plot errors.svg

#: lg-hamiltonian predict
lg-hamiltonian predict model.h5 scenes/pendulum.yaml --t-end 10 --points 500 --plot flow.svg

#: lg-hamiltonian search
printf '%s\n' 'fixed: {epochs: 20}' 'ranges: {hidden: {integer: [4, 16]}}' > ranges.yaml
lg-hamiltonian search ranges.yaml data.h5 --trials 2 --out trials.csv

#: lg-hamiltonian study
# Two runs of a grid; the same line again does the next two.
lg-hamiltonian study scenes/study-small.yaml --stop-after 2 --out study.csv

#: lg-hamiltonian demo
lg-hamiltonian demo --epochs 50 --out demo

#: lg-learn
# Which recipes there are; then one of them from data to a motion.
lg-learn list
lg-learn train data.h5 --recipe hamiltonian --optimizer lbfgs --hidden 8 --epochs 200 --out recipe.h5
lg-learn evaluate recipe.h5 test.h5
lg-learn predict recipe.h5 --initial 1,0,0,0,0.5,0 --t-end 2 --out motion.csv

#: lg-learn train
lg-learn train data.h5 --recipe hamiltonian --hidden 8 --epochs 20 --history loss.csv --out recipe.h5

#: lg-learn search
printf 'ranges:\n  hidden: {integer: [4, 12]}\nfixed: {epochs: 20, method: lbfgs}\n' > widths.yaml
lg-learn search widths.yaml data.h5 --recipe hamiltonian --trials 2 --out widths.csv

#: lg-learn evaluate
lg-learn evaluate recipe.h5 test.h5 --json

#: lg-learn predict
lg-learn predict recipe.h5 --initial 1,0,0,0,0.5,0 --t-end 2 --points 21 --out motion.csv

#: lg-learn list
lg-learn list --json

#: lg-identify
# From the log of a machine to a controller in 100 evaluations of the loss; all files are in the folder machine.
lg-identify demo --epochs 100 --seconds 60 --out machine

#: lg-identify check
lg-identify check machine/machine.yaml machine/train.csv --plot log.svg

#: lg-identify fit
# Two seconds of training; the parameters that are best on another log are kept.
lg-identify fit machine/machine.yaml machine/train.csv --validation-logs machine/test.csv --seconds 2 --out body.h5

#: lg-identify evaluate
lg-identify evaluate body.h5 machine/test.csv --horizons 1,2 --plot learned.svg

#: lg-identify adapt
# The first two seconds of a new log tell the factor of the friction and a constant force; the rest is judged.
lg-identify adapt body.h5 machine/test.csv --seconds 2 --out adapted.h5

#: lg-identify predict
lg-identify predict body.h5 machine/test.csv --out run.csv --plot run.svg

#: lg-identify generate
lg-identify generate machine/truth.yaml --runs 2 --noise 1e-3,1e-2 --out log.csv

#: lg-identify demo
lg-identify demo --epochs 100 --seconds 60 --out machine

#: lg-elastica
# The shape of a clamped beam; then a network that gives shapes.
lg-elastica solve --case both-ends --x 3 --plot beam.svg
lg-elastica generate --count 100 --out curves.h5
lg-elastica train curves.h5 --seconds 2 --out beam.h5
lg-elastica predict beam.h5 --x 3 --solve

#: lg-elastica solve
# All shapes of lowest energy for one pair of ends, and a table of a family of shapes.
lg-elastica solve --x 3 --branches
lg-elastica solve --case both-ends --sweep 20 --out sweep.csv

#: lg-elastica generate
lg-elastica generate --case both --count 50 --out both.h5

#: lg-elastica train
lg-elastica train curves.h5 --network discrete --seconds 2 --out beam.h5

#: lg-elastica evaluate
lg-elastica evaluate beam.h5 curves.h5 --part test

#: lg-elastica predict
lg-elastica predict beam.h5 --x 3 --points 200 --out curve.csv

#: lg-elastica search
lg-elastica search searches/elastica-discrete.yaml curves.h5 --trials 1 --out trials.csv

#: lg-anomaly
# A detector of damage, trained on simulated recordings, watches a feed.
lg-anomaly generate --noise 10 --runs 36 --out well.h5
lg-anomaly train well.h5 --classifier logistic --out detector.h5
lg-anomaly evaluate detector.h5 well.h5
lg-anomaly feed --noise 10 --hours 1 | lg-anomaly watch detector.h5 --quiet

#: lg-anomaly generate
lg-anomaly generate --noise 10 --runs 36 --plot recordings.svg --out well.h5

#: lg-anomaly feed
# Two hours; the casing breaks after one.
lg-anomaly feed --noise 10 --hours 2 --crack-at 1 --out feed.csv

#: lg-anomaly train
# A classical method, and a small convolutional network for two epochs.
lg-anomaly train well.h5 --classifier svm-rbf --features cov --out detector.h5
lg-anomaly train well.h5 --classifier cnn --epochs 2 --out network.h5

#: lg-anomaly evaluate
lg-anomaly evaluate detector.h5 well.h5 --part test --plot confusion.svg --plot-kind confusion

#: lg-anomaly search
lg-anomaly search searches/anomaly.yaml well.h5 --trials 1 --out trials.csv

#: lg-anomaly watch
# The crack of the feed is after 3600 seconds.
lg-anomaly watch detector.h5 --input feed.csv --crack-at 3600
# Verdicts to a file that logrotate may turn (kill -HUP).
lg-anomaly watch detector.h5 --input feed.csv --log verdicts.log

#: lg-fit
# A table of 300 rows, y = sin(3 a) b, and a network that learns it.
seq 300 | awk 'BEGIN { print "a,b,y" } { a = $1 % 17 / 17; b = $1 % 23 / 23; print a "," b "," sin(3 * a) * b }' > table.csv
lg-fit train table.csv --inputs a,b --outputs y --out table.h5
lg-fit predict table.h5 table.csv --out predictions.csv

#: lg-fit train
# A validation part of a tenth, and a plot of predicted against true values.
lg-fit train table.csv --outputs y --validation-fraction 0.1 --plot fit.svg --out table.h5

#: lg-fit evaluate
lg-fit evaluate table.h5 table.csv --json

#: lg-fit predict
lg-fit predict table.h5 table.csv --out predictions.csv

#: lg-fit search
printf 'ranges:\n  hidden: {integer: [4, 12]}\nfixed: {epochs: 20}\n' > ranges.yaml
lg-fit search ranges.yaml table.csv --trials 2 --out trials.csv

#: lg-control
# A cart and pole whose numbers are known, a task, a policy that swings it up, and its C.
printf '%s\n' 'columns: {time: t}' 'coordinates: [{name: x, kind: line, velocity: vx}, {name: theta, kind: angle, velocity: w}]' 'inputs: {columns: [u]}' 'system: cart-pole' 'parameters: {cart: 1, pole: 0.1, length: 1, gravity: 9.81}' 'input_map: {kind: known, values: [[1], [0]]}' > cart.yaml
printf '%s\n' 'plant: cart.yaml' 'period: 0.05' 'horizon: 5' 'starts: {x: [-0.5, 0.5], theta: [-3.14, 3.14], vx: [-0.5, 0.5], w: [-1, 1]}' 'limits: {u: 10}' 'cost: {x: 0.1, theta: 1, vx: 0.01, w: 0.02, u: 0.002}' 'success: {theta: 0.05, hold: 1, within: 10}' 'controller: {kind: network, hidden: [32, 32]}' > task.yaml
lg-control train task.yaml --seconds 4 --out policy.h5
lg-control evaluate policy.h5
lg-export policy.h5 --name swingup --out swingup

#: lg-control train
# Within 4 seconds; without --seconds it takes about a minute.
lg-control train task.yaml --seconds 4 --out policy.h5

#: lg-control evaluate
# Success, costs and the worst start of 500, beside the regulator alone; also on another machine.
lg-control evaluate policy.h5 --json
lg-control evaluate policy.h5 --plant cart.yaml

#: lg-control certify
# From where the regulator of the same task brings the cart and pole to the goal, proved.
sed 's/{kind: network, hidden: .32, 32.}/{kind: lqr}/' task.yaml > regulator.yaml
lg-control certify regulator.yaml --box x=2,theta=0.6,vx=4,w=4 --certificate proof.json

#: lg-control verify
# The proof again, from its file alone.
lg-control verify proof.json

#: lg-control demo
# From a log to a machine, a controller and its C, with training of 4 seconds.
lg-control demo --out control --seconds 4

#: lg-export
# A controller's C from a model: value, gradient, step; then its own test, which needs cc and make.
lg-export model.h5 --name pendulum --out exported
make -C exported test
# A CasADi external, and a pendulum of two links as an FMU.
lg-export model.h5 --name pendulum --target casadi --out external
lg-export scenes/chain-2.yaml --name chain --target fmu3 --out unit

#: lg-gradcheck
# The derivatives of one operation; then wrong ones are planted, and each has to be caught.
lg-gradcheck --only mul
lg-gradcheck --only mul --plant

#: lg-bench
lg-bench list
lg-bench scalar --json
