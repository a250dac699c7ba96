#!/usr/bin/env python3
"""machine_logs.py NAME --out LOG.csv [--runs N] [--seed S]

Logs of simulated machines for lg-identify, integrated by SciPy (DOP853, 1e-10) with inputs held from row to row. Needs NumPy
and SciPy.

  pendulum, damped-pendulum  a rotation about the vertical axis, theta'' = -15 sin theta + 3 u [- .2 theta'], u constant in {0,
                             -1, 1, -2, 2}, 20 rows .05 s apart (Duong and Atanasov, SE3HamDL); N starts for each u
  cart, cart-noisy, cart-irregular   cart 1 kg, pole .3 kg at .5 m, friction on both, 10 s at 50 Hz; noise 2e-3 and 1e-2;
                             steps of 8 to 32 ms
  body                       a heavy rigid body about a fixed point, three torques, damping, 8 s at 50 Hz
  arm                        two links, two torques, viscous and Coulomb friction f tanh(v/.01), 8 s at 100 Hz
  sphere                     a spherical pendulum with torques and damping, 8 s at 50 Hz"""
import argparse

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

GRAVITY = 9.81


def multisine(rng, amplitude, count):
    """`count` inputs, each a sum of six sines below 1 Hz."""
    rates, phases = rng.uniform(.05, 1, (count, 6)), rng.uniform(0, 2 * np.pi, (count, 6))
    heights = amplitude * rng.uniform(.3, 1, (count, 6)) / 2
    return lambda t: (heights * np.sin(2 * np.pi * rates * t + phases)).sum(1)


def follow(field, start, times, inputs, project=lambda y: y):
    """States (rows, d) and held inputs (rows, m)."""
    states, held = [np.array(start, float)], [inputs(t) for t in times]
    for a, b, u in zip(times[:-1], times[1:], held):
        end = solve_ivp(field, (a, b), states[-1], args=(u,), rtol=1e-10, atol=1e-11, method="DOP853").y[:, -1]
        states.append(project(end))
    return np.array(states), np.array(held)


# ---- the machines: (t, y, u) -> y' ----

def cart(t, y, u):
    x, angle, v, w = y
    c, s = np.cos(angle), np.sin(angle)
    mass = np.array([[1.3, .15 * c], [.15 * c, .075]])
    return np.r_[v, w, np.linalg.solve(mass, [u[0] + .15 * w * w * s - .1 * v, -.15 * GRAVITY * s - .02 * w])]


INERTIA, CENTRE, DAMPING = np.array([.05, .06, .02]), np.array([.02, .01, .15]), np.array([.01, .012, .008])


def body(t, y, u):
    R, w = y[:9].reshape(3, 3), y[9:]
    hat = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    torque = -GRAVITY * np.cross(CENTRE, R[2]) + u - DAMPING * w - np.cross(w, INERTIA * w)
    return np.r_[(R @ hat).ravel(), torque / INERTIA]


def upright(y):
    U, _, V = np.linalg.svd(y[:9].reshape(3, 3))
    return np.r_[(U @ V).ravel(), y[9:]]


def arm(t, y, u):
    q, w = y[:2], y[2:]
    c, h = np.cos(q[1]), .08 * np.sin(q[1])  # m2 l1 lc2 = .8 .5 .2
    m12 = .052 + .08 * c
    mass = np.array([[.0625 + .03 + .2 + .032 + .02 + .16 * c, m12], [m12, .052]])
    coriolis = np.array([-h * (2 * w[0] * w[1] + w[1]**2), h * w[0]**2])
    weight = GRAVITY * np.array([.65 * np.sin(q[0]) + .16 * np.sin(q.sum()), .16 * np.sin(q.sum())])
    friction = np.array([.05, .04]) * w + np.array([.15, .1]) * np.tanh(w / .01)
    return np.r_[w, np.linalg.solve(mass, u - coriolis - weight - friction)]


def sphere(t, y, u):
    q, w = y[:3], y[3:]
    torque = -.48 * GRAVITY * np.cross(q, [0, 0, 1]) - .03 * w + u
    return np.r_[np.cross(w, q), (torque - q * (q @ torque)) / .288]


def on_sphere(y):
    q = y[:3] / np.linalg.norm(y[:3])
    return np.r_[q, y[3:] - q * (q @ y[3:])]


# ---- logs: (header, rows) ----

def cart_log(rng, runs, noise=0.0, irregular=False):
    rows = []
    for run in range(runs):
        t = np.r_[0, np.cumsum(rng.uniform(.008, .032, 500))] if irregular else np.arange(501) * .02
        y, u = follow(cart, [0, rng.uniform(-3, 3), .3 * rng.normal(), 2 * rng.normal()], t, multisine(rng, 8, 1))
        y += noise * np.array([1, 1, 5, 5]) * rng.normal(size=y.shape)
        rows.append(np.c_[np.full(len(t), run), t, y, u])
    return "run,t,x,theta,vx,vtheta,u", np.vstack(rows)


def body_log(rng, runs):
    rows, t = [], np.arange(401) * .02
    for run in range(runs):
        R = Rotation.from_quat(rng.normal(size=4)).as_matrix()
        y, u = follow(body, np.r_[R.ravel(), 2 * rng.normal(size=3)], t, multisine(rng, .4, 3), upright)
        q = Rotation.from_matrix(y[:, :9].reshape(-1, 3, 3)).as_quat()[:, [3, 0, 1, 2]]
        rows.append(np.c_[np.full(len(t), run), t, q, y[:, 9:], u])
    return "run,t,qw,qx,qy,qz,wx,wy,wz,t1,t2,t3", np.vstack(rows)


def arm_log(rng, runs):
    rows, t = [], np.arange(801) * .01
    for run in range(runs):
        shapes = multisine(rng, 1, 2)
        y, u = follow(arm, rng.normal(size=4), t, lambda s: shapes(s) * [3, 1])
        rows.append(np.c_[np.full(len(t), run), t, y, u])
    return "run,t,q1,q2,w1,w2,u1,u2", np.vstack(rows)


def sphere_log(rng, runs):
    rows, t = [], np.arange(401) * .02
    for run in range(runs):
        y, u = follow(sphere, on_sphere(np.r_[rng.normal(size=3), 2 * rng.normal(size=3)]), t, multisine(rng, 1, 3), on_sphere)
        rows.append(np.c_[np.full(len(t), run), t, y, u])
    return "run,t,qx,qy,qz,wx,wy,wz,t1,t2,t3", np.vstack(rows)


def pendulum_log(rng, runs, friction=0.0):
    starts = np.c_[rng.uniform(-np.pi, np.pi, runs), rng.uniform(-1, 1, runs)]
    rows, t = [], .05 * np.arange(1, 21)
    for u in (0, -1, 1, -2, 2):
        for start in starts:
            y = solve_ivp(lambda s, y: [y[1], -15 * np.sin(y[0]) + 3 * u - friction * y[1]], (0, 1), start, t_eval=t,
                          rtol=1e-12, atol=1e-13, method="DOP853").y
            c, s, o = np.cos(y[0]), np.sin(y[0]), np.zeros(20)
            run = len(rows)
            rows.append(np.c_[np.full(20, run), t, c, -s, o, s, c, o, o, o, o + 1, o, o, y[1], np.full(20, u)])
    names = ",".join("r%d%d" % (i, j) for i in (1, 2, 3) for j in (1, 2, 3))
    return "run,t,%s,wx,wy,wz,u" % names, np.vstack(rows)


LOGS = {
    "pendulum": pendulum_log,
    "damped-pendulum": lambda rng, runs: pendulum_log(rng, runs, .2),
    "cart": cart_log,
    "cart-noisy": lambda rng, runs: cart_log(rng, runs, 2e-3),
    "cart-irregular": lambda rng, runs: cart_log(rng, runs, 0, True),
    "body": body_log,
    "arm": arm_log,
    "sphere": sphere_log}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=LOGS)
    parser.add_argument("--out", required=True)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    header, rows = LOGS[args.name](np.random.default_rng(args.seed), args.runs)
    np.savetxt(args.out, rows, fmt=["%d"] + ["%.17g"] * (rows.shape[1] - 1), delimiter=",", header=header, comments="")


if __name__ == "__main__":
    main()
