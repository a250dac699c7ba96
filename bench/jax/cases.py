"""Cases of lg-bench in JAX: compiled by jit for each batch, with the gradient in the input by hand or by grad, batch first
or components first. Prints one JSON object; the fastest form comes first, with what compiling it took."""
import json
import os
import sys

sys.dont_write_bytecode = True
sys.path[1:1] = [os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "torch")]

import timing

args = timing.begin()
if args.threads == 1:
    os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_cpu_multi_thread_eigen=false"
os.environ["JAX_PLATFORMS"] = "cpu"

import jax
import jax.numpy as jnp
import numpy as np

import model  # sets 64 bits

dtype = np.dtype(args.dtype.replace("f", "float"))


def compiled(function, *example):
    """The executable, and the seconds that it took."""
    start = timing.time.perf_counter()
    made = jax.jit(function).lower(*example).compile()
    return made, timing.time.perf_counter() - start


# ---- second order: d/dtheta sum |grad_x V|^2 ----


def rows_by_hand(net, x):
    """x (B, 3); net: W, b, W, b, ..., W with W (in, out)."""
    h, values = x, []
    for w, b in zip(net[:-1:2], net[1::2]):
        h = jnp.tanh(h @ w + b)
        values.append(h)
    g = net[-1].T * (1 - h * h)
    for w, h in zip(net[-3:0:-2], values[-2::-1]):
        g = (g @ w.T) * (1 - h * h)
    return g @ net[0].T


def rows_by_grad(net, x):
    def potential(x):
        h = x
        for w, b in zip(net[:-1:2], net[1::2]):
            h = jnp.tanh(h @ w + b)
        return (h @ net[-1]).sum()

    return jax.grad(potential)(x)


def columns_by_hand(net, x):
    return model.potential_gradient(net, x.T)


FORMS = {"rows, by hand": rows_by_hand, "columns, by hand": columns_by_hand, "rows, by grad": rows_by_grad}


def weights_of(widths):
    rng, net = np.random.default_rng(1), []
    for a, b in zip(widths, widths[1:]):
        net.append(rng.uniform(-1, 1, (a, b)).astype(dtype) / a**0.5)
        if b != 1:
            net.append(rng.uniform(-1, 1, b).astype(dtype) / a**0.5)
    return [w.astype(dtype) for w in net]


def second(widths):
    rows = []
    net = [jnp.asarray(w) for w in weights_of(widths)]
    for n in [args.batch] if args.batch else (1, 50, 500, 1500):
        x = jnp.asarray(np.random.default_rng(3).uniform(-1, 1, (n, 3)).astype(dtype))
        tried = []
        for name, form in FORMS.items():
            call, seconds = compiled(jax.grad(lambda net, x: (form(net, x)**2).sum()), net, x)
            run = lambda: jax.block_until_ready(call(net, x))
            tried.append(timing.measure(run, args.repeats, args.patience / len(FORMS), name="B=%d" % n, batch=n, form=name,
                                        width=widths[1], compile_seconds=seconds))
        rows.append(min(tried, key=lambda r: r["median_us"]))
    return rows


# ---- learning a Hamiltonian: an epoch is one call ----

POINTS, DT, DECAY, BATCH, CLIP, EPS = 5, 0.025, 50, 80, 1e-3, 1e-12
HIDDEN = {"hamiltonian": (100, 100, 100), "hamiltonian-small": (20, 20)}


def split(flat, widths):
    """net, gamma, b of lg-bench's flat vector"""
    out, at = [], 0
    shapes = [s for a, b in zip(widths, widths[1:]) for s in ([(a, b), (b,)] if b != 1 else [(a, b)])]
    for shape in shapes + [(1, 1), (1,)]:
        n = int(np.prod(shape))
        out.append(flat[at:at + n].reshape(shape))
        at += n
    return out


def adam(flat, m, v, t, g, lr):
    """As bench/torch does it: the norm of g is clipped."""
    g = g * jnp.minimum(CLIP / jnp.sqrt((g * g).sum()), 1)
    m, v = m + 0.1 * (g - m), 0.999 * v + 0.001 * g * g
    step = m / (1 - 0.9**t) / (jnp.sqrt(v / (1 - 0.999**t)) + EPS)
    return flat - lr * step, m, v


def hamiltonian(widths):
    read = lambda ending: np.fromfile(args.inputs + ending)
    data = read(".data").reshape(-1, POINTS, 2, 3).astype(dtype)
    flat = jnp.asarray(read(".weights").astype(dtype))
    count, batch = len(data), args.batch or BATCH
    full = count // batch * batch
    data = jnp.asarray(data)
    loss = lambda flat, x: model.loss(split(flat, widths), x.transpose(1, 2, 3, 0), DT)

    def update(state, x, lr):
        flat, m, v, t = state
        value, g = jax.value_and_grad(loss)(flat, x)
        return (*adam(flat, m, v, t + 1, g, lr), t + 1), value

    def epoch(state, order, lr):
        """Batches of one size in a loop, and what is left."""
        step = lambda state, i: update(state, data[i], lr)
        state, values = jax.lax.scan(step, state, order[:full].reshape(-1, batch))
        total = values.sum() * batch
        if full < count:
            state, value = update(state, data[order[full:]], lr)
            total = total + value * (count - full)
        return state, total / count

    rng = np.random.default_rng(1)
    order = lambda: jnp.asarray(rng.permutation(count))
    rate = lambda e: jnp.asarray(1e-2 * 0.1**(e // DECAY), dtype)
    state = (flat, jnp.zeros_like(flat), jnp.zeros_like(flat), jnp.asarray(0, dtype))
    call, seconds = compiled(epoch, state, order(), rate(0))
    times, losses = [], []
    for e in range(args.epochs):
        start = timing.time.perf_counter()
        state, value = jax.block_until_ready(call(state, order(), rate(e)))
        times.append(1e6 * (timing.time.perf_counter() - start))
        losses.append(float(value))
    if args.out:
        np.asarray(state[0], float).tofile(args.out)
    return [timing.row(times[1:], name="epoch", batch=batch, inner=1, loss=losses[-1], losses=losses, compile_seconds=seconds)]


CASES = {"mlp2": lambda: second((3, 100, 100, 100, 1)), "mlp2-small": lambda: second((3, 20, 20, 1))}
CASES.update({name: (lambda hidden=hidden: hamiltonian((3, *hidden, 1))) for name, hidden in HIDDEN.items()})
if args.case not in CASES:
    raise SystemExit("no such case: " + args.case)
rows = CASES[args.case]()
print(json.dumps(dict(peer="JAX " + jax.__version__, case=args.case, dtype=args.dtype, threads=args.threads, rows=rows)))
