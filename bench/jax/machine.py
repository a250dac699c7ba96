"""Learning a machine by JAX as lg-identify fit does it: the same windows of the same log, the same terms, steps and loss, from
a model file of lg-identify, which says all of these. Prints one JSON object.

  machine.py check MODEL.h5 LOG.csv                 the loss at the weights of the file; of any log: --held LOG.csv
  machine.py train MODEL.h5 LOG.csv --target LOSS   weights are drawn again; ends when the loss has reached the target
                                                    [--method NAME] [--form NAME] [--short N] [--seconds S] [--out FILE.h5]

Machines of lines and angles, or of one rotation; mass constant or a network, potential a network, damping diagonal and coulomb,
a known input map, starts at logged rows. All in float64, on one core, windows along the last axis. --short N (150): so many steps
on windows of two rows come first, as with lg-identify; 0: none. seconds, cpu: since the process began; *_without: without its
start and compiling. What is not matched: lg-identify's prior of weights has no part in the loss here, the easier problem."""
import argparse
import csv
import json
import os
import shutil
import sys

sys.dont_write_bytecode = True
sys.path[1:1] = [os.path.dirname(os.path.dirname(os.path.abspath(__file__)))]

import peerlib

peerlib.pin_jax()

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import yaml

import model as rotations  # sets 64 bits
import peer
from clocks import Clocks

cross = rotations.cross
HALF = 0.5 ** 0.5  # unit of the numbers of a rotation
CHUNK, FOREVER = 10, 10**9  # iterations of a compiled call


class Machine:
    """What the model file says: terms, scales, theta as one vector with its shapes."""

    def __init__(self, path):
        with h5py.File(path, "r") as file:
            self.yaml = yaml.safe_load(file["model"].attrs["machine"])
            numbers = [float(x) for x in file["model"].attrs["scales"].decode().split(",")]
            self.run = {k: v.decode() if isinstance(v, bytes) else v for k, v in file["run"].attrs.items()}
            self.names = [n.decode() for n in file["parameters"].attrs["theta"]]
            arrays = [np.array(file[n]) for n in self.names]
        self.path, self.shapes = path, [a.shape for a in arrays]
        self.theta = np.concatenate([a.ravel() for a in arrays])
        self.coordinates = self.yaml["coordinates"]
        self.turns = self.coordinates[0]["kind"] == "rotation"
        self.kinds = [c["kind"] for c in self.coordinates]
        self.n = 3 if self.turns else len(self.coordinates)
        self.T, self.energy = numbers[0], numbers[81]
        self.place, self.velocity = np.array(numbers[1:1 + self.n]), np.array(numbers[49:49 + self.n])
        self.input, self.fastest = np.array(numbers[65:81]), np.array(numbers[83:83 + self.n])
        self.damping = self.yaml.get("damping", {})
        self.steep = self.velocity / (self.T * np.array(self.damping.get("coulomb_width") or 1e-3 * self.fastest))
        given = np.array(self.yaml["input_map"]["values"], float)
        self.map = given * self.velocity[:, None] / self.energy * self.input[:given.shape[1]]
        take = lambda name: np.array([float(x) for x in self.run[name].split(",")])[:len(self.coordinates)]
        repeat = (lambda x: np.repeat(x, 3)) if self.turns else (lambda x: x)
        self.position_weight = np.full(9, HALF / take("position_scale")[0]) if self.turns else (
            self.place / take("position_scale"))
        self.velocity_weight = self.velocity / self.T / repeat(take("velocity_scale"))

    def parts(self, theta):
        """name -> array; of a network: the list of its arrays."""
        out, at = {}, 0
        for name, shape in zip(self.names, self.shapes):
            n = int(np.prod(shape))
            term = name.split("/")[1]
            own = theta[at:at + n].reshape(shape)
            out.setdefault(term, []).append(own) if "layer" in name else out.update({name.split("/")[-1]: own})
            at += n
        return out

    def draw(self, rng):
        """Weights as lg-identify draws them (uniform, 1/sqrt(inputs), a tenth in the last layer); numbers where they begin."""
        out, last = [], {n.rsplit("/layer", 1)[0]: n.rsplit("/", 1)[0] for n in self.names if "/layer" in n}
        for name, shape in zip(self.names, self.shapes):
            if "/layer" not in name:
                out.append(np.full(int(np.prod(shape)), 0.0 if "/mass" in name else 0.1))
                continue
            bound = shape[0] ** -0.5 if len(shape) == 2 else bound  # a bias follows its weight
            tenth = 0.1 if name.startswith(last[name.rsplit("/layer", 1)[0]]) else 1.0
            out.append(tenth * rng.uniform(-bound, bound, int(np.prod(shape))))
        return np.concatenate(out)

    def write(self, path, theta):
        """A copy of the file with these parameters: lg-identify evaluates it."""
        shutil.copy(self.path, path)
        with h5py.File(path, "r+") as file:
            at = 0
            for name, shape in zip(self.names, self.shapes):
                n = int(np.prod(shape))
                file[name][...] = np.asarray(theta[at:at + n]).reshape(shape)
                at += n


# ---- data: windows in scaled units, components first, windows last ----

def read(machine, path, window, stride):
    with open(path) as file:
        rows = csv.reader(file)
        head = next(rows)
        data = np.array([[float(c) for c in row] for row in rows])
    column = lambda names: data[:, [head.index(n) for n in names]]
    y = machine.yaml
    if machine.turns:
        c = machine.coordinates[0]
        w, i, j, k = (column(c["columns"]) / np.linalg.norm(column(c["columns"]), axis=1, keepdims=True)).T
        q = np.stack([1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j),
                      2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i),
                      2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)], 1)
        v = column(c["velocity"])
    else:
        q = column([c["name"] for c in machine.coordinates]) / machine.place
        v = column([c["velocity"] for c in machine.coordinates])
    u = column(y["inputs"]["columns"])
    v, u = v * machine.T / machine.velocity, u / machine.input[:u.shape[1]]
    t, run = data[:, head.index("t")], data[:, head.index("run")]
    edges = np.r_[0, np.flatnonzero(np.diff(run)) + 1, len(run)]
    starts = np.concatenate([np.arange(a, b - window + 1, stride) for a, b in zip(edges, edges[1:])])
    cut = lambda x: np.ascontiguousarray(x[starts[:, None] + np.arange(window)].transpose(1, 2, 0))
    h = float(t[starts[0] + 1] - t[starts[0]]) / machine.T
    return dict(q=jnp.asarray(cut(q)), v=jnp.asarray(cut(v)), u=jnp.asarray(cut(u))), h


# ---- the model: p = M v, p' = d(v M v/2 - V)/dq + f ----

def network(net, x):
    """net: W, b, ..., W[, b]; x (in, B)."""
    layers = [net[i:i + 2] for i in range(0, len(net), 2)]
    for w, b in layers[:-1]:
        x = jnp.tanh(w.T @ x + b[:, None])
    out = layers[-1][0].T @ x
    return out + layers[-1][1][:, None] if len(layers[-1]) == 2 else out


def triangle(packed, n):
    """L (rows of entries, each (B,) or ()) with exp on the diagonal: first n numbers, then the rows below it."""
    rest = iter(packed[n:])
    return [[next(rest) for _ in range(i)] + [jnp.exp(packed[i])] for i in range(n)]


class Model:
    def __init__(self, machine, h, form="scan"):
        self.m, self.form, self.substeps = machine, form, int(machine.run["substeps"])
        self.h = h / self.substeps

    def of(self, key):
        names = self.m.yaml[key]["of"]
        return [names] if isinstance(names, str) else names

    def features(self, key, q):
        if self.m.turns:
            return q[6:9] if self.of(key)[0].endswith(".up") else q
        out = []
        for name in self.of(key):
            i = next(i for i, c in enumerate(self.m.coordinates) if c["name"] == name)
            out += [jnp.sin(q[i]), jnp.cos(q[i])] if self.m.kinds[i] == "angle" else [q[i]]
        return jnp.stack(out)

    def root(self, parts, q):
        """L of M = L L^T."""
        packed = network(parts["mass"], self.features("mass", q)) if "mass" in parts else parts["constant"]
        return triangle(list(packed), self.m.n)

    @staticmethod
    def momenta(L, v):
        n = len(L)
        w = [sum(L[i][j] * v[i] for i in range(j, n)) for j in range(n)]
        return jnp.stack([sum(L[i][j] * w[j] for j in range(i + 1)) for i in range(n)])

    @staticmethod
    def below(L, p):
        """L^-1 p"""
        w = []
        for i, row in enumerate(L):
            w.append((p[i] - sum(row[j] * w[j] for j in range(i))) / row[i])
        return w

    def velocities(self, L, p):
        w, v = self.below(L, p), [None] * len(L)
        for i in reversed(range(len(L))):
            v[i] = (w[i] - sum(L[j][i] * v[j] for j in range(i + 1, len(L)))) / L[i][i]
        return jnp.stack(v)

    def forces(self, parts, v, u):
        f = jnp.asarray(self.m.map) @ u - parts["diagonal"][:, None] ** 2 * v
        if "coulomb" in parts:
            f -= parts["coulomb"][:, None] ** 2 * jnp.tanh(v * self.m.steep[:, None])
        return f

    def field(self, parts, q, p, u):
        """(v, p'), or of a rotation (the angular velocity in space, p')"""
        if self.m.turns:
            v = self.velocities(self.root(parts, q), p)
            g = jax.grad(lambda x: network(parts["potential"], x).sum())(self.features("potential", q))
            R = q.reshape(3, 3, -1)
            rows = (R[2],) if g.shape[0] == 3 else R
            turned = sum(cross(r, g[3 * i:3 * i + 3]) for i, r in enumerate(rows))
            return (R * v).sum(1), cross(p, v) + turned + self.forces(parts, v, u)

        def energy(q, p):
            w = self.below(self.root(parts, q), p)
            return (0.5 * sum(x * x for x in w) + network(parts["potential"], self.features("potential", q))[0]).sum()

        g, v = jax.grad(energy, (0, 1))(q, p)
        return v, self.forces(parts, v, u) - g

    def act(self, a, q):
        """exp(a) R"""
        if not self.m.turns:
            return q + a
        w = (a * a).sum(0)
        c1, c2 = rotations.stumpff(1, w), rotations.stumpff(2, w)
        y, a = q.reshape(3, 3, -1), a[:, None]  # columns of R are turned
        x = cross(a, y)
        return (y + c1 * x + c2 * cross(a, x)).reshape(9, -1)

    def step(self, parts, q, p, u):
        """CF4; on lines and angles it is the classical Runge-Kutta method."""
        f = lambda y: [self.h * x for x in self.field(parts, *y, u)]
        on = lambda y, *terms: (self.act(sum(c * a[0] for c, a in terms), y[0]), y[1] + sum(c * a[1] for c, a in terms))

        def substep(y, _):
            f1 = f(y)
            y2 = on(y, (0.5, f1))
            f2 = f(y2)
            f3 = f(on(y, (0.5, f2)))
            f4 = f(on(y2, (1, f3), (-0.5, f1)))
            both = (1 / 6, f2), (1 / 6, f3)
            return on(on(y, *both, (1 / 4, f1), (-1 / 12, f4)), *both, (-1 / 12, f1), (1 / 4, f4)), None

        y = q, p
        return substep(y, None)[0] if self.substeps == 1 else jax.lax.scan(substep, y, None, self.substeps)[0]

    def loss(self, theta, data):
        parts = self.m.parts(theta)
        weight_q, weight_v = self.m.position_weight[:, None], self.m.velocity_weight[:, None]
        one = jax.checkpoint(self.step) if "again" in self.form else self.step

        def advance(y, now):
            u, truth_q, truth_v = now
            q, p = one(parts, *y, u)
            v = self.velocities(self.root(parts, q), p)
            return (q, p), (((q - truth_q) * weight_q) ** 2).sum() + (((v - truth_v) * weight_v) ** 2).sum()

        q, v = data["q"][0], data["v"][0]
        start = q, self.momenta(self.root(parts, q), v)
        now = data["u"][:-1], data["q"][1:], data["v"][1:]
        _, each = jax.lax.scan(advance, start, now, unroll=len(now[0]) if "flat" in self.form else 1)
        return each.sum() / ((data["q"].shape[0] - 1) * q.shape[1])


# ---- methods: theta where the loss has reached the target, or where the time is up ----

class Training:
    def __init__(self, args, clocks, model, data, target):
        self.args, self.clocks, self.data, self.target, self.evaluations = args, clocks, data, target, 0
        self.loss = model.loss
        self.spent = lambda: clocks.told()["cpu_without"] > args.seconds

    def iterate(self, begin, iteration, read, theta):
        """Chunks of a compiled loop: iteration(loss, state) is the next state, read(state) = (theta, value, evaluations)."""
        bound = lambda data: (lambda theta: self.loss(theta, data))

        def chunk(state, data, target, most):
            go_on = lambda s: (read(s[0])[1] > target) & (s[1] < most)
            return jax.lax.while_loop(go_on, lambda s: (iteration(bound(data), s[0]), s[1] + 1), (state, 0))

        start = self.clocks.compiled(lambda theta, data: begin(bound(data), theta), theta, self.data)
        state = start(theta, self.data)
        run = self.clocks.compiled(chunk, state, self.data, self.target, CHUNK)
        left = self.args.short or FOREVER if self.short else FOREVER
        before = None
        while left > 0 and not self.spent():
            state, _ = jax.block_until_ready(run(state, self.data, self.target, min(CHUNK, left)))
            value, left = float(read(state)[1]), left - CHUNK
            if not value > self.target or value == before:
                break
            before = value
        self.evaluations += int(read(state)[2])
        return read(state)[0]


def optax_lbfgs(training, theta):
    import optax
    from optax.tree_utils import tree_get
    method = optax.lbfgs(memory_size=training.args.memory)

    def begin(loss, theta):
        return theta, method.init(theta), loss(theta), jnp.asarray(1)

    def iteration(loss, carry):
        theta, state, _, n = carry
        value, g = optax.value_and_grad_from_state(loss)(theta, state=state)
        change, state = method.update(g, state, theta, value=value, grad=g, value_fn=loss)
        return optax.apply_updates(theta, change), state, tree_get(state, "value"), n + tree_get(
            state, "info").num_linesearch_steps

    return training.iterate(begin, iteration, lambda c: (c[0], c[2], c[3]), theta)


def jaxopt_method(make):
    def run(training, theta):
        return training.iterate(lambda loss, theta: (theta, make(training.args, loss).init_state(theta)),
                                lambda loss, carry: tuple(make(training.args, loss).update(*carry)),
                                lambda carry: (carry[0], carry[1].value, carry[1].num_fun_eval), theta)
    return run


def jaxopt_bfgs(args, loss):
    import jaxopt
    return jaxopt.BFGS(loss, tol=0.0, linesearch="zoom")


def jaxopt_lbfgs(args, loss):
    import jaxopt
    return jaxopt.LBFGS(loss, history_size=args.memory, tol=0.0, linesearch="zoom")


class Done(Exception):
    pass


def evaluator(training, theta):
    """Loss and gradient as NumPy's numbers, from one compiled call; raises Done at the target."""
    call = training.clocks.compiled(jax.value_and_grad(training.loss), theta, training.data)

    def tell(x):
        value, g = call(jnp.asarray(x), training.data)
        training.evaluations += 1
        tell.x = x
        if float(value) <= training.target or training.spent():
            raise Done
        return float(value), np.asarray(g)

    return tell


def scipy_bfgs(training, theta):
    import scipy.optimize
    tell, most = evaluator(training, theta), training.args.short if training.short else FOREVER
    try:
        return jnp.asarray(scipy.optimize.minimize(tell, np.asarray(theta), jac=True, method="BFGS",
                                                   options=dict(gtol=0.0, maxiter=most)).x)
    except Done:
        return jnp.asarray(tell.x)


def ssbroyden(training, theta):
    """lg-identify's method without its restarts: as in peer.py, which has its formulas."""
    tell, n, x = evaluator(training, theta), theta.size, np.asarray(theta)
    update = training.clocks.compiled(peer.updated, jnp.eye(n), x, x, x, 1.0, 1.0, 1.0, 1.0, donate_argnums=0)
    last, most = {}, training.args.short if training.short else FOREVER

    def along(alpha):
        last["value"], last["g"] = tell(x + alpha * d)
        return last["value"], float(last["g"] @ d)

    try:
        value, g = tell(x)
        d, H = -g * min(1.0, 0.1 / np.linalg.norm(g)), None
        for _ in range(most):
            slope = float(g @ d)
            alpha = peer.wolfe(value, slope, along)
            if alpha is None:
                d, H = -g * min(1.0, 0.1 / np.linalg.norm(g)), None
                continue
            s, y = alpha * d, last["g"] - g
            x, g, value, ys = x + s, last["g"], last["value"], float(s @ y)
            sbs = -alpha * alpha * slope if H is not None else float(s @ s) * float(y @ y) / ys
            H = H if H is not None else jnp.eye(n) * (ys / float(y @ y))
            hy = np.asarray(H @ y)
            q = float(y @ hy)
            H = update(H, s, y, hy, q, 1 / ys, *peer.scales(n, sbs / ys, q / ys))
            d = -np.asarray(H @ g)
        return jnp.asarray(x)
    except Done:
        return jnp.asarray(tell.x)


METHODS = {"ssbroyden": ssbroyden, "optax-lbfgs": optax_lbfgs, "jaxopt-bfgs": jaxopt_method(jaxopt_bfgs),
           "jaxopt-lbfgs": jaxopt_method(jaxopt_lbfgs), "scipy-bfgs": scipy_bfgs}
FORMS = ("scan", "flat", "again", "again-flat")


# ---- commands ----

def check(args, machine, clocks):
    out = {}
    for name, log, stride in (("loss", args.log, machine.run["stride"]), ("held", args.held, machine.run["window"] - 1)):
        if log:
            data, h = read(machine, log, int(machine.run["window"]), int(stride))
            out[name] = float(jax.jit(Model(machine, h).loss)(jnp.asarray(machine.theta), data))
    return out


def train(args, machine, clocks):
    window = int(machine.run["window"])
    data, h = read(machine, args.log, window, int(machine.run["stride"]))
    model, theta = Model(machine, h, args.form), jnp.asarray(machine.draw(np.random.default_rng(args.seed)))
    training = Training(args, clocks, model, data, args.target)
    training.short = args.short > 0
    if training.short:
        training.data, training.target = {k: x[:2] for k, x in data.items()}, 0.0
        theta = METHODS[args.method](training, theta)
        training.data, training.target, training.short = data, args.target, False
    theta = METHODS[args.method](training, theta)
    told = clocks.told()
    if args.out:
        machine.write(args.out, theta)
    loss = float(jax.jit(model.loss)(theta, data))
    return dict(method=args.method, form=args.form, loss=loss, reached=loss <= args.target * (1 + 1e-9), parameters=theta.size,
                evaluations=training.evaluations, **told)


if __name__ == "__main__":
    clocks = Clocks()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("check", "train"))
    parser.add_argument("model")
    parser.add_argument("log")
    parser.add_argument("--held")
    parser.add_argument("--target", type=float, default=0.0)
    parser.add_argument("--method", choices=METHODS, default="ssbroyden")
    parser.add_argument("--form", choices=FORMS, default="again")
    parser.add_argument("--short", type=int, default=150)
    parser.add_argument("--memory", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=300, help="of processor time, at most")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out")
    args = parser.parse_args()
    result = dict(check=check, train=train)[args.command](args, Machine(args.model), clocks)
    print(json.dumps(dict(peer="JAX " + jax.__version__, **result)))
