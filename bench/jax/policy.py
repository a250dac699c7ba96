"""Learning a policy by JAX as lg-control train does it, from a policy file of lg-control, which has the task, the regulator, the
gate and the scales. Prints one JSON object.

  policy.py check POLICY.h5 RUNS.csv     the costs of runs of lg-control evaluate --runs, from the same starts, and their
                                         largest relative difference; the mean cost of 512 starts of this program
  policy.py train POLICY.h5 --target C   the network is drawn again; ends when the mean cost of these 512 starts is at most C and
                                         99.5 % of them succeed [--method race|one] [--finish N] [--seconds S]

Machines as in bench/policies: a pendulum or a cart with a pole. race: lg-control's plan, eight networks under vmap, of which half
leave after a third and two thirds; steps of Adam on 64 fresh starts over .3 to .5 of the horizon in single precision, what goes
back through a period bounded as there; the best one goes on with 128 starts. one: one network, the same steps. The winner then
takes as many steps over the whole horizon, in place of lg-control's L-BFGS. Every 50 steps the
512 starts are judged, in double precision. seconds, cpu: since the process began; *_without: without its start and compiling.
What is not matched: the regulator's search is not done here, it is in the file."""
import argparse
import csv
import json
import os
import sys

sys.dont_write_bytecode = True
sys.path[1:1] = [os.path.dirname(os.path.dirname(os.path.abspath(__file__)))]

import peerlib

peerlib.pin_jax()

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import optax

from clocks import Clocks

jax.config.update("jax_enable_x64", True)
CHUNK, VALIDATION, ENOUGH, SHARES = 50, 512, 0.995, (0.3, 0.5, 0.4)


# ---- machines: (q, v) -> p, (q, p) -> v, and p' ----

def pendulum(row):
    m, c = row["mass"]["values"][0], row["potential"]["values"][1]
    mass = lambda q: ((m,),)
    return mass, lambda q: c * jnp.cos(q[0])


def cart(row):
    mc, mp, L, g = (row["parameters"][k] for k in ("cart", "pole", "length", "gravity"))

    def mass(q):
        c = mp * L * jnp.cos(q[1])
        return (mc + mp, c), (c, mp * L * L)

    return mass, lambda q: mp * g * L * jnp.cos(q[1])


def product(M, v):
    return jnp.stack([sum(a * b for a, b in zip(row, v)) for row in M])


def solve(M, p):
    if len(M) == 1:
        return jnp.stack([p[0] / M[0][0]])
    (a, b), (_, d) = M
    det = a * d - b * b
    return jnp.stack([(d * p[0] - b * p[1]) / det, (a * p[1] - b * p[0]) / det])


class Policy:
    """States are (q, p), components first, runs last."""

    def __init__(self, path):
        with h5py.File(path, "r") as file:
            group = file["policy"]
            self.task = json.loads(group.attrs["task"])
            take = lambda name: np.array(group[name])
            self.P, self.near, self.scale = take("P"), take("near")[0], take("scale")
            self.level, self.terminal_weight = float(take("level")), float(take("terminal"))
            self.theta, self.u0, self.substeps = np.array(file["parameters/policy"]), take("u0")[0], int(group.attrs["substeps"])
        with open(os.path.join(os.path.dirname(path), self.task["plant"])) as file:
            self.row = json.load(file)
        self.mass, self.potential = (cart if self.row.get("system") == "cart-pole" else pendulum)(self.row)
        self.coordinates, self.n = self.row["coordinates"], len(self.row["coordinates"])
        self.damping = np.array(self.row["damping"]["values"])[:, None]
        self.map = np.array(self.row["input_map"]["values"], float)
        self.limit = self.task["limits"]["u"]
        self.h, self.N = self.task["period"], int(round(self.task["horizon"] / self.task["period"]))
        self.within, self.hold = (int(round(self.task["success"][k] / self.h)) for k in ("within", "hold"))
        weights = self.task["cost"]
        self.weights = [(weights.get(c["name"], 0), weights.get(c["velocity"], 0)) for c in self.coordinates]
        hidden = self.task["controller"]["hidden"]
        angles = sum(c["kind"] == "angle" for c in self.coordinates)
        self.widths = [2 * self.n + angles, *hidden, 1]
        self.names = [c["name"] for c in self.coordinates] + [c["velocity"] for c in self.coordinates]

    def draw(self, rng):
        return np.concatenate([rng.uniform(-a ** -0.5, a ** -0.5, (a + 1) * b) for a, b in zip(self.widths, self.widths[1:])])

    def box(self):
        """Bounds of the starts, (2 n, 1) each: of q, then of v."""
        return np.array([self.task["starts"].get(k, [0, 0]) for k in self.names]).T[..., None]

    def state(self, qv):
        q, v = qv[:self.n], qv[self.n:]
        return jnp.concatenate([q, product(self.mass(q), v)])

    def velocity(self, x):
        return solve(self.mass(x[:self.n]), x[self.n:])

    def field(self, x, u):
        q, p = x[:self.n], x[self.n:]
        energy = lambda q, p: (0.5 * (p * solve(self.mass(q), p)).sum(0) + self.potential(q)).sum()
        g, v = jax.grad(energy, (0, 1))(q, p)
        return jnp.concatenate([v, self.map.astype(x.dtype) * u - self.damping.astype(x.dtype) * v - g])

    def period(self, x, u):
        h = self.h / self.substeps
        for _ in range(self.substeps):
            k1 = self.field(x, u)
            k2 = self.field(x + 0.5 * h * k1, u)
            k3 = self.field(x + 0.5 * h * k2, u)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + self.field(x + h * k3, u))
        return x

    def errors(self, q, v):
        z = [jnp.sin(a) / jnp.sqrt(0.5 * jnp.cos(a) + (0.5 + 1e-6)) if c["kind"] == "angle" else a
             for a, c in zip(q, self.coordinates)]
        return jnp.stack([*z, *v])

    def ratio(self, q, z):
        """V/c"""
        P = self.P.astype(z.dtype)
        V = (z * (P @ z)).sum(0)
        for i, c in enumerate(self.coordinates):
            if c["kind"] == "angle":
                V += float(self.P[i, i]) * (2 - 2 * jnp.cos(q[i]) - z[i] ** 2)
        return V / self.level

    def control(self, theta, q, v):
        z, parts, at, scale = self.errors(q, v), [], 0, self.scale.tolist()
        for i, c in enumerate(self.coordinates):
            parts += [jnp.sin(q[i]), jnp.cos(q[i])] if c["kind"] == "angle" else [q[i] / scale[i]]
            parts.append(v[i] / scale[self.n + i])
        y = jnp.stack(parts)
        for i, (a, b) in enumerate(zip(self.widths, self.widths[1:])):
            y = theta[at:at + a * b].reshape(a, b).T @ y + theta[at + a * b:at + (a + 1) * b][:, None]
            y, at = jnp.tanh(y), at + (a + 1) * b
        u = self.limit * y[0]
        gate = jax.nn.sigmoid(4.5 - 4.5 * self.ratio(q, z))
        held = jnp.clip(float(self.u0) - self.near.astype(z.dtype) @ z, -self.limit, self.limit)
        return u + gate * (held - u)

    def closed(self, theta, x):
        """The next state, and the cost of a period."""
        q, v = x[:self.n], self.velocity(x)
        u = self.control(theta, q, v)
        cost = self.task["cost"]["u"] * (u - float(self.u0)) ** 2
        for a, w, c, (wq, wv) in zip(q, v, self.coordinates, self.weights):
            cost += wq * (2 - 2 * jnp.cos(a) if c["kind"] == "angle" else a * a) + wv * w * w
        return self.period(x, u), self.h * cost

    def end(self, x):
        q, v = x[:self.n], self.velocity(x)
        return self.terminal_weight * jnp.log1p(self.ratio(q, self.errors(q, v)) / 13)

    def judged(self, theta, x):
        """Cost and success of each run over `within`."""
        def one(x, _):
            q = x[:self.n]
            far = jnp.stack([abs(jnp.arctan2(jnp.sin(a), jnp.cos(a))) if c["kind"] == "angle" else abs(a)
                             for a, c in zip(q, self.coordinates)])
            bound = jnp.array([self.task["success"].get(c["name"], jnp.inf) for c in self.coordinates])[:, None]
            next, cost = self.closed(theta, x)
            return next, (cost, (far < bound).all(0))

        x, (costs, inside) = jax.lax.scan(one, x, None, self.within + 1)
        return costs[:-1].sum(0), inside[-self.hold:].all(0)

    def mean(self, theta, x, steps, most):
        """Mean cost over `steps` of `most` periods with the end; what goes back through a period is bounded."""
        weight = jnp.asarray(1 / x.shape[1], x.dtype)
        bounded = bound_of(5 * self.terminal_weight)

        def one(carry, k):
            x, total, spread = carry
            next, cost = self.closed(theta, bounded(x, spread, weight))
            on = k < steps
            return (jnp.where(on, next, x), total + jnp.where(on, cost, 0), spread), None

        path = jax.lax.scan(lambda x, k: (jnp.where(k < steps, self.closed(theta, x)[0], x),) * 2, x, jnp.arange(most))[1]
        spread = jax.lax.stop_gradient(path.std((0, 2)))
        (x, total, _), _ = jax.lax.scan(one, (x, jnp.zeros(x.shape[1], x.dtype), spread), jnp.arange(most))
        return (total + self.end(x)).mean()


def bound_of(bound):
    @jax.custom_vjp
    def same(x, spread, weight):
        return x

    def back(kept, g):
        spread, weight = kept
        length = jnp.sqrt(((g * spread[:, None]) ** 2).sum(0))
        short = jnp.where(length <= bound * weight, g, g * (bound * weight / length))
        return jnp.where(jnp.isfinite(length), short, 0), jnp.zeros_like(spread), jnp.zeros_like(weight)

    same.defvjp(lambda x, spread, weight: (x, (spread, weight)), back)
    return same


# ---- commands ----

def validation(policy):
    return policy.state(jnp.asarray(np.random.default_rng(2).uniform(*policy.box(), (2 * policy.n, VALIDATION))))


def check(args, policy, clocks):
    with open(args.runs) as file:
        rows = list(csv.DictReader(file))
    first = [r for r in rows if float(r["t"]) == 0]
    x = policy.state(jnp.array([[float(r[n]) for r in first] for n in policy.names]))
    wanted = np.zeros(len(first))
    for r in rows:
        wanted[int(r["start"])] += float(r["cost"] or 0)
    judged = jax.jit(policy.judged)
    costs = np.asarray(judged(jnp.asarray(policy.theta), x)[0])
    own, held = judged(jnp.asarray(policy.theta), validation(policy))
    return dict(cost=float(costs.mean()), cost_lg=float(wanted.mean()), difference=float(abs(costs / wanted - 1).max()),
                difference_of_mean=float(abs(costs.mean() / wanted.mean() - 1)), own_cost=float(own.mean()),
                own_success=float(held.mean()))


def train(args, policy, clocks):
    low, high = (jnp.asarray(b, jnp.float32) for b in policy.box())
    seeds = 8 if args.method == "race" else 1
    rng = np.random.default_rng(args.seed)
    flat = jnp.asarray(np.stack([policy.draw(rng) for _ in range(seeds)]), jnp.float32)
    steps = jnp.asarray([int(np.ceil(SHARES[k % 3] * policy.N)) for k in range(seeds)])
    clip = policy.terminal_weight / 8

    def plan(total, starts, rate, most):
        method = optax.chain(optax.clip_by_global_norm(clip), optax.adam(optax.cosine_decay_schedule(rate, total)))

        def update(flat, state, steps, key):
            x = policy.state(jax.random.uniform(key, (2 * policy.n, starts), jnp.float32) * (high - low) + low)
            g = jax.grad(policy.mean)(flat, x, steps, most)
            g = jnp.where(jnp.isfinite(g).all(), g, 0)
            change, state = method.update(g, state)
            return flat + change, state

        def chunk(flat, state, steps, key):
            def one(carry, key):
                return jax.vmap(update)(*carry, steps, jax.random.split(key, len(carry[0]))), None
            return jax.lax.scan(one, (flat, state), jax.random.split(key, CHUNK))[0]

        return jax.vmap(method.init), chunk

    x, key = validation(policy), jax.random.key(args.seed)
    judge = clocks.compiled(lambda theta, x: [r.mean() for r in policy.judged(theta, x)], jnp.asarray(flat[0], jnp.float64), x)
    best, done = (0.0, np.inf, None), 0

    def look(flat):
        nonlocal best
        out = []
        for theta in flat:
            cost, success = map(float, judge(jnp.asarray(theta, jnp.float64), x))
            out.append((-min(success, ENOUGH), cost))
            if np.isfinite(cost) and out[-1] < (-min(best[0], ENOUGH), best[1]):
                best = success, cost, theta
        return np.array(sorted(range(len(out)), key=lambda k: out[k])), min(out)

    reached = lambda: best[1] <= args.target and best[0] >= ENOUGH
    over = lambda: reached() or clocks.told()["cpu_without"] > args.seconds
    short = int(np.ceil(max(SHARES) * policy.N))
    phases = [(args.race, seeds, 64, 2e-2, short)] * (seeds > 1) + [(args.finish, 1, 128, 2e-2, short),
                                                                   (args.finish, 1, 128, 5e-3, policy.N)]
    for total, points, starts, rate, most in phases:
        flat, steps = flat[:points], steps[:points] if most == short else jnp.asarray([most])
        init, chunk = plan(total, starts, rate, most)
        state = init(flat)
        runs, leave = {}, [total / 3, 2 * total / 3] if points > 1 else []
        for k in range(0, total, CHUNK):
            if over():
                break
            if leave and k >= leave[0]:
                order = look(flat)[0][:(len(flat) + 1) // 2]
                flat, steps, leave = flat[order], steps[order], leave[1:]
                state = jax.tree.map(lambda a: a[order], state)
            key, own = jax.random.split(key)
            if len(flat) not in runs:
                runs[len(flat)] = clocks.compiled(chunk, flat, state, steps, own)
            flat, state = jax.block_until_ready(runs[len(flat)](flat, state, steps, own))
            done += CHUNK
            if points == 1:
                look(flat)
        order = look(flat)[0]
        flat, steps = flat[order], steps[order]
    told = clocks.told()
    return dict(method=args.method, cost=best[1], success=best[0], reached=reached(), parameters=int(flat.shape[1]), steps=done,
                **told)


if __name__ == "__main__":
    clocks = Clocks()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("check", "train"))
    parser.add_argument("policy")
    parser.add_argument("runs", nargs="?")
    parser.add_argument("--target", type=float, default=0.0)
    parser.add_argument("--method", choices=("race", "one"), default="one")
    parser.add_argument("--race", type=int, default=450)
    parser.add_argument("--finish", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=200, help="of processor time, at most")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    result = dict(check=check, train=train)[args.command](args, Policy(args.policy), clocks)
    print(json.dumps(dict(peer="JAX " + jax.__version__, **result)))
