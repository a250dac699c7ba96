#!/usr/bin/env python3
"""machine_logs.py NAME --out LOG.csv [--runs N] [--seed S]

Logs of simulated machines for lg-identify, integrated by SciPy (DOP853, 1e-10) with inputs held from row to row. Needs NumPy
and SciPy.

  pendulum, damped-pendulum  a rotation about the vertical axis, theta'' = -15 sin theta + 3 u [- .2 theta'], u constant in {0,
                             -1, 1, -2, 2}, 20 rows .05 s apart (Duong and Atanasov, SE3HamDL); N starts for each u
  pendulum-fast              pendulum .02 s apart (Duong, Altawaitan, Stanley, Atanasov, LieFVIN)
  cart, cart-noisy, cart-irregular, cart-empty   cart 1 kg, pole .3 kg at .5 m, friction on both, 10 s at 50 Hz; noise 2e-3 and
                             1e-2; steps of 8 to 32 ms, 2 % of the rows dropped and a second without rows in each run; 5 % of the
                             cells empty
  body, body-noisy           a heavy rigid body about a fixed point, three torques, damping, 8 s at 50 Hz; noise as of cart-noisy
  arm                        two links, two torques, viscous and Coulomb friction f tanh(v/.01), 8 s at 100 Hz
  sphere                     a spherical pendulum with torques and damping, 8 s at 50 Hz
  rod, pole, acrobot         pendulum, cart-pole and acrobot of Zhong, Dey, Chakraborty (SymODEN, 2020), 20 rows, N starts for
                             each of the same five inputs; rod-free, pole-free, acrobot-free: 40 rows without input
  chain-1, -2, -3, -5        planar chains of Finzi, Wang, Wilson (2020), links' angles from the downward vertical: chunks of 5
                             rows .03 s apart; chain-1-run, ...: the whole of N runs, 100 rows
  gyroscope, gyroscope-run   their heavy top, .02 s apart"""
import argparse
import io

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from machine_scores import CENTRE as AXIS, LENGTHS

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


def together(field, starts, t):
    """Runs of one autonomous field (runs, d) -> (runs, d), all at once: (runs, rows, d)."""
    runs, d = np.shape(starts)
    y = solve_ivp(lambda _, y: field(y.reshape(runs, d)).ravel(), (0, t[-1]), np.ravel(starts), t_eval=t, rtol=1e-12, atol=1e-12,
                  method="DOP853").y
    return y.reshape(runs, d, len(t)).transpose(0, 2, 1)


def lagrange(mass, force):
    """The field of M(q) v' = force(q, v), rows (q, v)."""
    def field(y):
        q, v = np.split(y, 2, 1)
        return np.c_[v, np.linalg.solve(mass(q), force(q, v)[..., None])[..., 0]]
    return field


def matrices(*entries):
    """(runs, 2, 2) of m11, m12, m22."""
    a, b, c = np.broadcast_arrays(*entries)
    return np.stack([np.stack([a, b], -1), np.stack([b, c], -1)], -2)


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


# ---- published ones, rows (q, v) of many runs ----

def rod(u):
    return lagrange(lambda q: np.ones((len(q), 1, 1)), lambda q, v: -15 * np.sin(q) + 3 * u)


def pole(u):
    """Cart and pole of .5 kg, half the pole .5 m, its inertia 4/3 m l^2, the angle from the upright."""
    return lagrange(lambda q: matrices(1, .25 * np.cos(q[:, 1]), .5 / 3),
                    lambda q, v: np.c_[u + .25 * v[:, 1]**2 * np.sin(q[:, 1]), .25 * 9.8 * np.sin(q[:, 1])])


def acrobot(u):
    """Masses, lengths and inertias 1, centres .5, the torque in the elbow, whose angle is relative."""
    def force(q, v):
        s, weight = .5 * np.sin(q[:, 1]), .5 * 9.8 * np.sin(q.sum(1))
        return np.c_[s * v[:, 1] * (v[:, 1] + 2 * v[:, 0]) - 1.5 * 9.8 * np.sin(q[:, 0]) - weight,
                     u - s * v[:, 0]**2 - weight]
    return lagrange(lambda q: matrices(3.5 + np.cos(q[:, 1]), 1.25 + .5 * np.cos(q[:, 1]), 1.25), force)


MASSES = {1: [1.03905080], 2: [1.17215149, 1.03905080], 3: [1.08221070, 1.17215149, 1.03905080],
          5: [.93892384, 1.03590655, 1.08221070, 1.17215149, 1.03905080]}


def chain(links):
    lengths, outer = np.array(LENGTHS[links]), np.cumsum(MASSES[links][::-1])[::-1]  # masses from a link outwards
    heavy = np.minimum.outer(outer, outer) * np.outer(lengths, lengths)
    weight, between = GRAVITY * outer * lengths, lambda q: q[:, :, None] - q[:, None]
    return lagrange(lambda q: heavy * np.cos(between(q)),
                    lambda q, v: -np.einsum("ij,nij,nj->ni", heavy, np.sin(between(q)), v * v) - weight * np.sin(q))


def chain_start(rng, lengths):
    """Angles and rates N(0, 1); nodes and their velocities moved, then brought back to the constraints by Newton's method."""
    k = len(lengths)
    a, w = rng.normal(size=(2, k))
    c, s = np.cos(a), np.sin(a)
    z = np.array([np.cumsum((lengths * [s, -c]).T, 0), np.cumsum((lengths * w * [c, s]).T, 0)])  # (x, v), nodes, 2
    z[0] += .2 * rng.normal(size=(k, 2))
    z[1] = 3 * (.5 * z[1] + .4 * rng.normal(size=(k, 2)))
    links = np.eye(k) - np.eye(k, k=-1)
    for _ in range(500):
        d, u = links @ z
        error = np.r_[(d * d).sum(1) - lengths**2, 2 * (d * u).sum(1)]
        if np.abs(error).max() < 1e-12:
            return np.r_[np.arctan2(d[:, 0], -d[:, 1]), (d[:, 0] * u[:, 1] - d[:, 1] * u[:, 0]) / lengths**2]
        by_x, by_v = 2 * links[:, :, None] * d[:, None], 2 * links[:, :, None] * u[:, None]
        slope = np.block([[by_x.reshape(k, -1), np.zeros((k, 2 * k))], [by_v.reshape(k, -1), by_x.reshape(k, -1)]])
        step, bound = np.linalg.pinv(slope) @ error, .5 * np.sqrt((z * z).mean())
        z -= np.clip(step, -bound, bound).reshape(z.shape)
    return chain_start(rng, lengths)


TOP = np.array([.0278320, .0278320, .0482757]) + .1 * AXIS**2 * np.array([1, 1, 0])  # about the pivot


def top(y):
    R, w = y[:, :9].reshape(-1, 3, 3), y[:, 9:]
    torque = -.1 * GRAVITY * AXIS * np.cross([0, 0, 1], R[:, 2]) - np.cross(w, TOP * w)
    return np.c_[np.cross(R, w[:, None]).reshape(-1, 9), torque / TOP]


def top_start(rng):
    a, b, c = rng.uniform(-1.5, 1.5, 3)
    da, db = rng.uniform(-4.5, 4.5), rng.uniform(-.3, .3)
    dc = rng.choice([-1.5, 1.5]) * (7 + rng.normal())
    w = [da * np.sin(b) * np.sin(c) + db * np.cos(c), da * np.sin(b) * np.cos(c) - db * np.sin(c), da * np.cos(b) + dc]
    return np.r_[Rotation.from_euler("ZXZ", [a, b, c]).as_matrix().ravel(), w]


# ---- logs: (header, rows) ----

def cart_log(rng, runs, noise=0.0, irregular=False, empty=0.0):
    rows = []
    for run in range(runs):
        t = np.r_[0, np.cumsum(rng.uniform(.008, .032, 500))] if irregular else np.arange(501) * .02
        y, u = follow(cart, [0, rng.uniform(-3, 3), .3 * rng.normal(), 2 * rng.normal()], t, multisine(rng, 8, 1))
        y += noise * np.array([1, 1, 5, 5]) * rng.normal(size=y.shape)
        log = np.c_[np.full(len(t), run), t, y, u]
        if irregular:
            log = log[(rng.random(len(t)) > .02) & (np.abs(t - rng.uniform(1, 9)) > .5)]
        if empty > 0:
            log[:, 2:][rng.random(log[:, 2:].shape) < empty] = np.nan
        rows.append(log)
    return "run,t,x,theta,vx,vtheta,u", np.vstack(rows)


def body_log(rng, runs, noise=0.0):
    rows, t = [], np.arange(401) * .02
    for run in range(runs):
        R = Rotation.from_quat(rng.normal(size=4)).as_matrix()
        y, u = follow(body, np.r_[R.ravel(), 2 * rng.normal(size=3)], t, multisine(rng, .4, 3), upright)
        R = Rotation.from_matrix(y[:, :9].reshape(-1, 3, 3))
        if noise > 0:
            R *= Rotation.from_rotvec(noise * rng.normal(size=(len(t), 3)))
            y[:, 9:] += 5 * noise * rng.normal(size=(len(t), 3))
        rows.append(np.c_[np.full(len(t), run), t, R.as_quat()[:, [3, 0, 1, 2]], y[:, 9:], u])
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


def table(runs, t, *columns):
    """Rows of many runs: run, t, then columns (runs, rows) or (runs, rows, n)."""
    number, time = np.broadcast_arrays(np.arange(runs)[:, None], t)
    return np.dstack([number, time, *columns]).reshape(runs * np.shape(t)[-1], -1)


INPUTS = (0, -1, 1, -2, 2)


def forced(rng, runs, field, lows, highs, dt, inputs=INPUTS, samples=20):
    """The same starts for each input: t, states and inputs."""
    t, starts, u = dt * np.arange(1, samples + 1), rng.uniform(lows, highs, (runs, len(lows))), np.repeat(inputs, runs)
    y = np.concatenate([together(field(value), starts, np.r_[0, t])[:, 1:] for value in inputs])
    return len(u), t, y, np.repeat(u[:, None], samples, 1)


def pendulum_log(rng, runs, friction=0.0, dt=.05):
    field = lambda u: lambda y: np.c_[y[:, 1], -15 * np.sin(y[:, 0]) + 3 * u - friction * y[:, 1]]
    count, t, y, u = forced(rng, runs, field, [-np.pi, -1], [np.pi, 1], dt)
    c, s, o = np.cos(y[..., 0]), np.sin(y[..., 0]), np.zeros(u.shape)
    names = ",".join("r%d%d" % (i, j) for i in (1, 2, 3) for j in (1, 2, 3))
    return "run,t,%s,wx,wy,wz,u" % names, table(count, t, c, -s, o, s, c, o, o, o, o + 1, o, o, y[..., 1], u)


def symoden_log(name, rng, runs, **kind):
    """Of the rod the direction, too, which swings in the plane of x and z."""
    field, lows, dt, names = {"rod": (rod, [-np.pi, -1], .05, "theta,w"), "acrobot": (acrobot, [-3.14] * 4, .05, "q1,q2,w1,w2"),
                              "pole": (pole, [-.5, -3.14, -.05, -3], .02, "x,theta,vx,w")}[name]
    count, t, y, u = forced(rng, runs, field, lows, [-low for low in lows], dt, **kind)
    if name == "rod":
        a, o = y[..., 0], np.zeros(u.shape)
        return "run,t,theta,w,qx,qy,qz,wx,wy,wz,u", table(count, t, y, np.sin(a), o, -np.cos(a), o, -y[..., 1], o, u)
    return "run,t,%s,u" % names, table(count, t, y, u)


def published_log(rng, runs, field, start, dt, whole, names, show=lambda y: y):
    """Runs of 100 rows, or one chunk of 5 rows of each, at a multiple of 5."""
    t = dt * np.arange(100)
    y = np.concatenate([together(field, [start(rng) for _ in range(min(runs - i, 500))], t) for i in range(0, runs, 500)])
    if not whole:
        row = 5 * rng.integers(0, 20, runs)[:, None] + np.arange(5)
        t, y = t[row], np.take_along_axis(y, row[..., None], 1)
    return "run,t," + names, table(runs, t, show(y))


def chain_log(rng, runs, links, whole=False):
    """The joints' angles, too: each link's minus the one's before."""
    start = lambda r: chain_start(r, np.array(LENGTHS[links]))
    names = ",".join("%s%d" % (c, i + 1) for c in "awjr" for i in range(links))
    joints = lambda y: np.diff(y, axis=-1, prepend=0)
    return published_log(rng, runs, chain(links), start, .03, whole, names,
                         lambda y: np.dstack([y, joints(y[..., :links]), joints(y[..., links:])]))


def gyroscope_log(rng, runs, whole=False):
    names = ",".join("r%d%d" % (i, j) for i in (1, 2, 3) for j in (1, 2, 3)) + ",wx,wy,wz"
    return published_log(rng, runs, top, top_start, .02, whole, names)


LOGS = {
    "pendulum": pendulum_log,
    "damped-pendulum": lambda rng, runs: pendulum_log(rng, runs, .2),
    "pendulum-fast": lambda rng, runs: pendulum_log(rng, runs, dt=.02),
    "cart": cart_log,
    "cart-noisy": lambda rng, runs: cart_log(rng, runs, 2e-3),
    "cart-irregular": lambda rng, runs: cart_log(rng, runs, irregular=True),
    "cart-empty": lambda rng, runs: cart_log(rng, runs, empty=.05),
    "body": body_log,
    "body-noisy": lambda rng, runs: body_log(rng, runs, 2e-3),
    "arm": arm_log,
    "sphere": sphere_log,
    "gyroscope": gyroscope_log,
    "gyroscope-run": lambda rng, runs: gyroscope_log(rng, runs, True)}
for name in ("rod", "pole", "acrobot"):
    LOGS[name] = lambda rng, runs, name=name: symoden_log(name, rng, runs)
    LOGS[name + "-free"] = lambda rng, runs, name=name: symoden_log(name, rng, runs, inputs=(0,), samples=40)
for links in MASSES:
    LOGS["chain-%d" % links] = lambda rng, runs, links=links: chain_log(rng, runs, links)
    LOGS["chain-%d-run" % links] = lambda rng, runs, links=links: chain_log(rng, runs, links, True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=LOGS)
    parser.add_argument("--out", required=True)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    header, rows = LOGS[args.name](np.random.default_rng(args.seed), args.runs)
    text = io.StringIO()
    np.savetxt(text, rows, fmt=["%d"] + ["%.17g"] * (rows.shape[1] - 1), delimiter=",", header=header, comments="")
    with open(args.out, "w") as file:
        file.write(text.getvalue().replace("nan", ""))


if __name__ == "__main__":
    main()
