"""Training of the spherical pendulum's Hamiltonian by JAX, from the weights of a model file, on data of lg-hamiltonian
generate. Prints one JSON object.

  check MODEL.h5 DATA.h5 --checkpoint FILE.h5
                             loss at the weights, and the gradient where training stood beside that in the checkpoint
  gradient MODEL.h5 DATA.h5  time of loss and gradient of all data
  train MODEL.h5 DATA.h5 --method NAME --marks S,S,... --out PREFIX
                             at each mark, in seconds of CPU without compiling, the weights go to PREFIX-i.h5. adam: --epochs E,
                             the settings of lg-hamiltonian

One core; XLA is told to use one thread in its products. What compiling takes is counted apart; `from_start` of a mark counts
all since the process began. --compiled FOLDER: executables are kept there, and taken from there."""
import json
import os
import sys

sys.dont_write_bytecode = True
sys.path[1:1] = [os.path.dirname(os.path.dirname(os.path.abspath(__file__)))]

import peerlib
from peerlib import clock

peerlib.pin_jax()

import jax
import jax.numpy as jnp
import numpy as np

import model

CHUNK = 10  # iterations of a compiled call
FOREVER = 10**9


class Problem:
    def __init__(self, args):
        if args.compiled:
            jax.config.update("jax_compilation_cache_dir", args.compiled)
            jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
            jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
        self.args, self.file = args, peerlib.ModelFile(args.model)
        data, self.h = peerlib.read_data(args.data)
        n, m, _ = data.shape
        self.data = jnp.asarray(np.ascontiguousarray(data.reshape(n, m, 2, 3).transpose(1, 2, 3, 0)))
        self.flat = jnp.asarray(self.file.flat)
        self.compile_seconds = 0.0

    def loss(self, flat, data):
        return model.loss(self.file.parts(flat), data, self.h)

    def scaled(self, flat, data):
        return peerlib.SCALE * self.loss(flat, data)

    def compiled(self, function, *example):
        """The executable for such arguments. Data are arguments, not constants to fold."""
        start = clock()
        out = jax.jit(function).lower(*example).compile()
        self.compile_seconds += clock() - start
        return out

    def iterate(self, begin, iteration, read):
        """begin(loss) is a state, iteration(loss, state) the next one, read(state) = (flat, evaluations). Ends after the last
        mark, or when the method has stopped moving."""
        def chunk(state, data):
            loss = lambda flat: self.scaled(flat, data)
            return jax.lax.scan(lambda s, _: (iteration(loss, s), None), state, None, CHUNK)[0]

        start = clock()
        state = jax.block_until_ready(begin(lambda flat: self.scaled(flat, self.data)))
        self.compile_seconds += clock() - start
        run = self.compiled(chunk, state, self.data)
        marks, still, before = peerlib.Marks(self.args, self.file), 0, None
        while True:
            state = jax.block_until_ready(run(state, self.data))
            flat, evaluations = read(state)
            flat = np.asarray(flat)
            still = still + 1 if before is not None and (flat == before).all() else 0
            before = flat
            if not marks.passed(flat, evaluations, end=still >= 3 or not np.isfinite(flat).all()):
                return marks.points


# ---- methods ----

def adam(problem):
    """lg-hamiltonian's plan: batches of 80, rate 1e-2 and a tenth of it after half of the epochs, eps 1e-12, norm of the
    gradient clipped at 1e-3. An epoch is one compiled call."""
    import optax
    epochs, batch = problem.args.epochs, 80
    count = problem.data.shape[-1]
    whole, rest = divmod(count, batch)
    steps = whole + (rest > 0)
    rate = optax.piecewise_constant_schedule(1e-2, {steps * (epochs // 2): 0.1})
    method = optax.chain(optax.clip_by_global_norm(1e-3), optax.adam(rate, eps=1e-12))

    def update(carry, data):
        flat, state = carry
        change, state = method.update(jax.grad(problem.loss)(flat, data), state, flat)
        return (flat + change, state), None

    def epoch(carry, key, data):
        data = data[..., jax.random.permutation(key, count)]
        body = data[..., :whole * batch].reshape(*data.shape[:-1], whole, batch)
        carry, _ = jax.lax.scan(update, carry, jnp.moveaxis(body, -2, 0))
        return update(carry, data[..., whole * batch:])[0] if rest else carry

    carry, keys = (problem.flat, method.init(problem.flat)), jax.random.split(jax.random.key(1), epochs)
    run = problem.compiled(epoch, carry, keys[0], problem.data)
    marks = peerlib.Marks(problem.args, problem.file)
    for key in keys:
        carry = run(carry, key, problem.data)
    marks.passed(jax.block_until_ready(carry)[0], epochs, end=True)
    return marks.points


def optax_lbfgs(problem):
    import optax
    method = optax.lbfgs(memory_size=problem.args.memory)

    def iteration(loss, carry):
        flat, state, n = carry
        value, g = optax.value_and_grad_from_state(loss)(flat, state=state)
        change, state = method.update(g, state, flat, value=value, grad=g, value_fn=loss)
        steps = optax.tree_utils.tree_get(state, "info").num_linesearch_steps
        return optax.apply_updates(flat, change), state, n + steps

    return problem.iterate(lambda loss: (problem.flat, method.init(problem.flat), jnp.asarray(0, jnp.int64)), iteration,
                           lambda carry: (carry[0], carry[2]))


def jaxopt_method(problem, make):
    return problem.iterate(lambda loss: (problem.flat, make(loss).init_state(problem.flat)),
                           lambda loss, carry: tuple(make(loss).update(*carry)),
                           lambda carry: (carry[0], carry[1].num_fun_eval))


def jaxopt_lbfgs(problem):
    import jaxopt
    return jaxopt_method(problem, lambda f: jaxopt.LBFGS(f, history_size=problem.args.memory, tol=0.0, linesearch="zoom"))


def jaxopt_bfgs(problem):
    import jaxopt
    return jaxopt_method(problem, lambda f: jaxopt.BFGS(f, tol=0.0, linesearch="zoom"))


class Done(Exception):
    pass


def scipy_method(problem, name, **options):
    """SciPy's, with loss and gradient compiled. Where it gives up because rounding stops the line search, it begins again
    from there."""
    import scipy.optimize
    call = problem.compiled(jax.value_and_grad(problem.scaled), problem.flat, problem.data)
    marks, calls = peerlib.Marks(problem.args, problem.file), [0]

    def function(flat):
        calls[0] += 1
        value, g = call(jnp.asarray(flat), problem.data)
        return float(value), np.asarray(g)

    def told(flat):
        if not marks.passed(flat, calls[0]):
            raise Done

    x, before = np.asarray(problem.flat), None
    try:
        while before is None or (x != before).any():
            before = x
            x = scipy.optimize.minimize(function, x, jac=True, method=name, callback=told, options=options).x
        marks.passed(x, calls[0], end=True)
    except Done:
        pass
    return marks.points


def scipy_bfgs(problem):
    return scipy_method(problem, "BFGS", gtol=0.0, maxiter=FOREVER)


def scipy_lbfgs(problem):
    return scipy_method(problem, "L-BFGS-B", gtol=0.0, ftol=0.0, maxiter=FOREVER, maxfun=FOREVER, maxcor=problem.args.memory)


def wolfe(value, slope, tell):
    """A step that satisfies the weak Wolfe conditions, by bracketing and cubic interpolation as in src/nn/minimise_search.c.
    tell(alpha) is the value and the slope there."""
    low, high, alpha = (0.0, value, slope), None, 1.0
    for _ in range(25):
        f, df = tell(alpha)
        falls = np.isfinite(f) and f <= value + 1e-4 * alpha * slope
        if falls and df >= 0.9 * slope:
            return alpha
        if falls:
            low = alpha, f, df
        else:
            high = alpha, f, df
        if high is None:
            alpha *= 2.5
            continue
        (l, fl, dl), (h, fh, dh) = low, high
        width, a = h - l, dl + dh - 3 * (fl - fh) / (l - h)
        with np.errstate(all="ignore"):
            b = np.sqrt(a * a - dl * dh)
            x = h - width * (dh + b - a) / (dh - dl + 2 * b)
        alpha = min(max(x, l + 0.1 * width), h - 0.1 * width) if np.isfinite(x) else l + 0.5 * width
    return None


def scales(n, b, h):
    """tau and phi of SSBroyden2 (Urban, Stefanou, Pons 2025)."""
    a = max(h * b - 1, 1e-16)
    r = min(1.0, h * (1 - (a / (1 + a)) ** 0.5))
    theta = max((r - 1) / a, min(1 / r, (1 - b) / b))
    sigma = 1 + a * theta
    root, k = abs(sigma) ** (1 / (1 - n)), min(1.0, 1 / b)
    return k * min(root, 1 / theta) if theta > 0 else min(k * root, sigma), (1 - theta) / (1 + a * theta)


def updated(H, s, y, hy, q, rho, tau, phi):
    """The inverse Hessian after a step."""
    v = rho * s - hy / q
    return (H - jnp.outer(hy, hy) / q + phi * q * jnp.outer(v, v)) / tau + rho * jnp.outer(s, s)


def ssbroyden(problem):
    """lg-hamiltonian's method without its restarts; loss and gradient are compiled, and the update of the inverse Hessian."""
    call = problem.compiled(jax.value_and_grad(problem.scaled), problem.flat, problem.data)
    n = problem.flat.size

    H, x = jnp.eye(n), np.asarray(problem.flat)
    start = clock()
    update = jax.jit(updated, donate_argnums=0).lower(H, x, x, x, 1.0, 1.0, 1.0, 1.0).compile()
    problem.compile_seconds += clock() - start
    marks, calls, last = peerlib.Marks(problem.args, problem.file), 1, {}
    value, g = (np.asarray(v) for v in call(jnp.asarray(x), problem.data))
    d, fresh = -g * min(1.0, 0.1 / np.linalg.norm(g)), True

    def tell(alpha):
        nonlocal calls
        calls += 1
        value, g = call(jnp.asarray(x + alpha * d), problem.data)
        last.update(value=float(value), g=np.asarray(g))
        return last["value"], float(last["g"] @ d)

    while marks.passed(x, calls):
        slope = float(g @ d)
        alpha = wolfe(float(value), slope, tell)
        if alpha is None:
            break
        s, y = alpha * d, last["g"] - g
        x, g, value, ys = x + s, last["g"], last["value"], float(s @ y)
        if fresh:
            H, fresh = jnp.eye(n) * (ys / float(y @ y)), False
            sbs = float(s @ s) * float(y @ y) / ys
        else:
            sbs = -alpha * alpha * slope
        hy = np.asarray(H @ y)
        q = float(y @ hy)
        tau, phi = scales(n, sbs / ys, q / ys)
        H = update(H, s, y, hy, q, 1 / ys, tau, phi)
        d = -np.asarray(H @ g)
    marks.passed(x, calls, end=True)
    return marks.points


METHODS = {"adam": adam, "ssbroyden": ssbroyden, "optax-lbfgs": optax_lbfgs, "jaxopt-lbfgs": jaxopt_lbfgs,
           "jaxopt-bfgs": jaxopt_bfgs, "scipy-bfgs": scipy_bfgs, "scipy-lbfgs": scipy_lbfgs}


# ---- commands ----

def train(problem):
    return dict(method=problem.args.method, points=METHODS[problem.args.method](problem))


def check(problem):
    call = jax.jit(jax.value_and_grad(problem.loss))
    value, _ = call(problem.flat, problem.data)
    point, expected = peerlib.read_gradient(problem.args.checkpoint)
    _, g = call(jnp.asarray(point), problem.data)
    return dict(loss=float(value), gradient_norm=float(np.linalg.norm(expected)),
                gradient_difference=float(np.linalg.norm(np.asarray(g) - expected) / np.linalg.norm(expected)))


def gradient(problem):
    call, times = problem.compiled(jax.value_and_grad(problem.loss), problem.flat, problem.data), []
    for _ in range(problem.args.repeats):
        start = clock()
        jax.block_until_ready(call(problem.flat, problem.data))
        times.append(clock() - start)
    return dict(median_us=1e6 * float(np.median(times)), min_us=1e6 * min(times))


COMMANDS = dict(check=check, gradient=gradient, train=train)

if __name__ == "__main__":
    parser = peerlib.parser(__doc__, COMMANDS, METHODS)
    parser.add_argument("--compiled", help="folder of executables")
    problem = Problem(parser.parse_args())
    result = COMMANDS[problem.args.command](problem)
    print(json.dumps(dict(peer="JAX " + jax.__version__, compile_seconds=problem.compile_seconds, **result)))
