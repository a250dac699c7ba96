#!/usr/bin/env python3
"""mpc.py --log LOG.csv | mpc.py EXPORTED [--starts 5] [--seed 1]

Model predictive control of a cart with a pole by CasADi, with a model that lg-identify learned. `--log` writes the log to learn
from. EXPORTED is the folder of `lg-export model.h5 --target casadi --name cart --functions step,momenta`, after `make`.

Nonlinear: IPOPT swings the pole up from random starts, with exact first and second derivatives of the learned step. Linear: a
quadratic program with A and B of the learned step at the upright equilibrium balances it from starts near the top. Both drive
the true cart, `field` below, which they do not know. Exit code 1 if a start fails. Needs casadi and numpy.
"""
import argparse
import os
import sys
import time

import casadi as ca
import numpy as np

STEP = .05          # seconds an input is held
BOUND = 10.0        # the largest force, N
SECONDS = 6
HORIZON = 40        # steps

# ---- the true cart: 1 kg, a pole of .3 kg with its centre .5 m from the hinge, theta from below, friction on both ----


def field(y, u):
    c, s = np.cos(y[1]), np.sin(y[1])
    mass = np.array([[1.3, .15 * c], [.15 * c, .075]])
    return np.r_[y[2:], np.linalg.solve(mass, [u + .15 * y[3] ** 2 * s - .1 * y[2], -.15 * 9.81 * s - .02 * y[3]])]


def move(y, u, h, parts):
    """The true cart h seconds later: `parts` steps of Runge-Kutta's method of order 4."""
    d = h / parts
    for _ in range(parts):
        k1 = field(y, u)
        k2 = field(y + d / 2 * k1, u)
        k3 = field(y + d / 2 * k2, u)
        k4 = field(y + d * k3, u)
        y = y + d / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return y


def write_log(path, rng, runs=10, rows=500):
    """Runs of 10 s at 50 Hz, driven by sums of six sines below 1 Hz, held from row to row."""
    with open(path, "w") as file:
        file.write("run,t,x,theta,vx,vtheta,u\n")
        for run in range(runs):
            y = np.r_[rng.uniform(-1, 1), rng.uniform(-np.pi, np.pi), rng.normal(0, [.5, 2])]
            heights, rates, phases = 4 * rng.uniform(.3, 1, 6), rng.uniform(.05, 1, 6), rng.uniform(0, 2 * np.pi, 6)
            for k in range(rows):
                u = (heights * np.sin(2 * np.pi * rates * k * .02 + phases)).sum()
                file.write(",".join("%.12g" % number for number in np.r_[run, k * .02, y, u]) + "\n")
                y = move(y, u, .02, 4)


# ---- two controllers: the state is x, theta and their momenta, the input a force ----


class Controller:
    """Multiple shooting over HORIZON steps; z is the states, then the inputs."""

    def __init__(self, solver, states):
        self.solver, self.n, self.guess, self.ms, self.failed = solver, states, None, [], 0

    def control(self, x):
        n, N = self.n, HORIZON
        if self.guess is None:
            self.guess = np.r_[np.tile(x, N + 1), np.zeros(N)]
        wide, before = np.full(n * (N + 1), np.inf), time.perf_counter()
        z = self.solver(x0=self.guess, p=x, lbg=0, ubg=0, lbx=np.r_[-wide, np.full(N, -BOUND)], ubx=np.r_[wide, np.full(N, BOUND)])
        z = np.array(z["x"]).ravel()
        self.ms.append(1e3 * (time.perf_counter() - before))
        self.failed += not self.solver.stats()["success"]
        if not np.isfinite(z).all():  # nothing usable: no force, and the next step begins anew
            self.guess = None
            return 0.0
        X, U = z[:n * (N + 1)], z[n * (N + 1):]
        self.guess = np.r_[X[n:], X[-n:], U[1:], U[-1:]]  # the next step begins with this solution, a step on
        return min(max(U[0], -BOUND), BOUND)


def nonlinear(step):
    n, N = step.numel_in(0), HORIZON
    X, U, start = ca.MX.sym("X", n, N + 1), ca.MX.sym("U", 1, N), ca.MX.sym("start", n)
    x, u = ca.SX.sym("x", n), ca.SX.sym("u")
    stage = ca.Function("stage", [x, u], [5 * (1 + ca.cos(x[1])) + .5 * x[0] ** 2 + .02 * x[2] ** 2 + 2 * x[3] ** 2 + 1e-3 * u ** 2])
    cost = ca.sum2(stage.map(N)(X[:, 1:], U)) + 20 * stage(X[:, N], 0)
    after = step.map(N)(X[:, :N], U, ca.DM.ones(1, N) * STEP)
    problem = {"x": ca.veccat(X, U), "p": start, "f": cost, "g": ca.veccat(X[:, 0] - start, after - X[:, 1:])}
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-6, "ipopt.max_iter": 200}
    return Controller(ca.nlpsol("nonlinear", "ipopt", problem, options), n)


def linearise(step, at):
    """A and B of the learned step at a state, without input: the exact Jacobian."""
    x, u = ca.MX.sym("x", step.numel_in(0)), ca.MX.sym("u")
    after = step(x, u, STEP)
    jacobian = ca.Function("jacobian", [x, u], [ca.jacobian(after, x), ca.jacobian(after, u)])
    return [np.array(ca.densify(matrix)) for matrix in jacobian(at, 0)]


def riccati(A, B, Q, R):
    """What the quadratic cost is from the horizon on, if no bound is met."""
    P = Q
    for _ in range(5000):
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
        P, before = Q + A.T @ P @ (A - B @ K), P
        if abs(P - before).max() < 1e-10 * abs(P).max():
            return P
    raise SystemExit("mpc.py: no input of the learned cart balances it")


def linear(step, at):
    """States are those less `at`."""
    (A, B), n, N = linearise(step, at), step.numel_in(0), HORIZON
    Q, R = np.diag([10.0, 50.0, 1.0, 5.0]), np.array([[.1]])
    X, U, start = ca.MX.sym("X", n, N + 1), ca.MX.sym("U", 1, N), ca.MX.sym("start", n)
    cost = ca.bilin(riccati(A, B, Q, R), X[:, N], X[:, N]) + ca.dot(ca.mtimes(Q, X[:, :N]), X[:, :N]) + ca.dot(U, R[0, 0] * U)
    after = ca.mtimes(A, X[:, :N]) + ca.mtimes(B, U)
    problem = {"x": ca.veccat(X, U), "p": start, "f": cost, "g": ca.veccat(X[:, 0] - start, after - X[:, 1:])}
    options = {"print_time": False, "error_on_fail": False, "osqp": {"verbose": False, "eps_abs": 1e-6, "eps_rel": 1e-6}}
    return Controller(ca.qpsol("linear", "osqp", problem, options), n)


# ---- the loop ----


def drive(control, y):
    """The angle's and the place's largest distance from the top and from the middle, over the last second."""
    away = []
    for _ in range(round(SECONDS / STEP)):
        y = move(y, control(y), STEP, 10)
        away.append([abs(np.angle(np.exp(1j * (y[1] - np.pi)))), abs(y[0])])
    return np.max(away[-round(1 / STEP):], 0)


def report(name, controllers, away):
    ms, held = np.concatenate([c.ms for c in controllers]), int((np.array(away)[:, 0] < .05).sum())
    print("%s: %d of %d up, angle within %.1e rad, cart within %.1e m in the last second; a solve takes %.1f ms (median), %.1f ms (99 %%), "
          "%d of %d not solved" % (name, held, len(away), *np.max(away, 0), *np.quantile(ms, [.5, .99]), sum(c.failed for c in controllers), len(ms)),
          flush=True)
    return held == len(away)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("exported", nargs="?")
    parser.add_argument("--log", metavar="LOG.csv")
    parser.add_argument("--starts", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    if (given.log is None) == (given.exported is None):
        parser.error("either --log LOG.csv or a folder of lg-export")
    if given.log:
        write_log(given.log, rng)
        return 0
    library = os.path.abspath(os.path.join(given.exported, "libcart.so"))
    if not os.path.exists(library):
        parser.error("there is no %s; `make -C %s` builds it" % (library, given.exported))
    step, momenta = ca.external("cart_step", library), ca.external("cart_momenta", library)
    state = lambda y: np.array(momenta(y[:2], y[2:])).ravel()  # a log has velocities, a state has momenta

    controllers, away = [], []
    for _ in range(given.starts):
        c = nonlinear(step)
        away.append(drive(lambda y: c.control(state(y)), np.r_[rng.normal(0, .5), rng.uniform(-np.pi, np.pi), rng.normal(0, [.3, 1])]))
        controllers.append(c)
    good = report("nonlinear", controllers, away)

    controllers, away, top = [], [], np.r_[0, np.pi, 0, 0]
    for _ in range(given.starts):
        c = linear(step, top)
        away.append(drive(lambda y: c.control(state(y) - top), top + rng.uniform(-1, 1, 4) * [.5, .2, .3, .3]))
        controllers.append(c)
    return 0 if report("linear", controllers, away) and good else 1


if __name__ == "__main__":
    sys.exit(main())
