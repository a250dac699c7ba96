"""The cases of lg-bench as a strong PyTorch program runs them: vectorised, gradients in the input by hand, flat Adam.
Prints one JSON object. OpenMP, MKL and instruction sets are chosen by the environment; ../compare tries the good ones."""
import sys
import time

sys.dont_write_bytecode = True

import timing

args = timing.begin()

import torch

torch.set_num_threads(args.threads)
torch.set_flush_denormal(True)

import anomaly
import elastica
import hamiltonian
import networks

dtype = torch.float64 if args.dtype == "f64" else torch.float32


def uniform(*shape, seed=3):
    return (torch.rand(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64) * 2 - 1).to(dtype)


def batches(*default):
    return [args.batch] if args.batch else default


def compiled(function, arguments):
    """function(arguments) by torch.compile, and the seconds that took; None before PyTorch 2 or without its compiler."""
    if args.patience < 1 or not hasattr(torch, "compile"):
        return None
    try:
        torch._dynamo.reset()
        made, start = torch.compile(function, dynamic=False, fullgraph=True), time.perf_counter()
        with torch.no_grad():
            made(arguments)
        return torch.no_grad()(lambda: made(arguments)), time.perf_counter() - start
    except Exception as error:  # of many classes: no C++ compiler, an operation that it does not take
        print("torch.compile: %s" % (str(error).splitlines() or [type(error).__name__])[0], file=sys.stderr)
        return None


def second(widths, last_bias, derivative, default):
    """The gradient in the parameters of the sum of squares of a derivative in the input."""
    rows = []
    weights, biases = networks.fan_in(widths, last_bias, dtype)
    leaves = weights + (biases[:-1] if last_bias else biases)  # the last bias has no influence on a derivative
    for n in batches(*default):
        x = uniform(n, widths[0])

        def call():
            d = derivative(weights, biases, x)
            return torch.autograd.grad(d, leaves, 2 * d.detach())

        def energy(p):
            d = derivative(p[:len(weights)], p[len(weights):], x)
            return (d * d).sum()

        named = dict(name="B=%d" % n, batch=n, width=widths[1])
        forms, made = [timing.measure(call, args.repeats, args.patience, **named)], None
        if not last_bias and hasattr(torch, "func"):  # with a last bias a leaf is missing: jvp is not compiled
            made = compiled(torch.func.grad(energy), tuple(p.detach() for p in leaves))
        if made:
            forms.append(timing.measure(made[0], args.repeats, args.patience, compile_seconds=made[1], **named))
        rows.append(best(forms)[0])
        if args.patience >= 1:
            reference = networks.second_order_reference(weights, biases, x, not last_bias)
            rows[-1]["error"] = networks.difference((made[0] if made and "compile_seconds" in rows[-1] else call)(), reference)
    return rows


def mlp2():
    w = args.width or 100
    return second((3, w, w, w, 1), False, networks.potential_gradient, (1, 50, 500, 1500))


def mlp2_small():
    w = args.width or 20
    return second((3, w, w, 1), False, networks.potential_gradient, (1, 50, 500, 1500))


def jvp():
    w = args.width or 100
    return second((1, w, w, w, 2), True, networks.curve_speed, (50, 500))


class Adam:
    """One pass an operation over flat memory."""

    def __init__(self, flat):
        self.flat, self.m, self.v, self.t = flat, torch.zeros_like(flat), torch.zeros_like(flat), 0

    def step(self, g):
        self.t += 1
        self.m.lerp_(g, 0.1)
        self.v.mul_(0.999).addcmul_(g, g, value=0.001)
        denominator = self.v.sqrt().mul_((1 - 0.999**self.t)**-0.5).add_(1e-8)
        self.flat.addcdiv_(self.m, denominator, value=-1e-3 / (1 - 0.9**self.t))


def best(rows):
    """Of several ways to do the same the fastest one, first."""
    return sorted(rows, key=lambda r: r["median_us"])


def optimisers(parameters):
    """torch.optim's own forms, as far as this release has them."""
    for options in (dict(), dict(foreach=True), dict(fused=True)):
        try:
            yield str(options), torch.optim.Adam(parameters, lr=1e-3, **options)
        except (TypeError, RuntimeError):
            pass


def adam():
    n, rows = args.width or 2500000, []
    theta, g = uniform(n), uniform(n, seed=4)
    flat = Adam(theta)
    rows.append(timing.measure(lambda: flat.step(g), args.repeats, args.patience, name="flat"))
    leaf = theta.clone().requires_grad_()
    leaf.grad = g
    for name, optimiser in optimisers([leaf]):
        try:
            rows.append(timing.measure(optimiser.step, args.repeats, args.patience, name=name))
        except RuntimeError:
            pass
    return best(rows)


def dense():
    w, n, rows = args.width or 879, args.batch or 32, []
    widths = (8, w, w, w, w, w, 196)
    x, target = uniform(n, 8), uniform(n, 196, seed=4)

    def loss(weights, biases):
        h = x
        for a, b in zip(weights[:-1], biases):
            h = torch.tanh(torch.addmm(b, h, a))
        return torch.nn.functional.mse_loss(torch.addmm(biases[-1], h, weights[-1]), target)

    weights, biases = networks.fan_in(widths, True, dtype)
    leaves = weights + biases
    with torch.no_grad():  # gradients are accumulated in place into one flat vector
        flat = torch.cat([p.reshape(-1) for p in leaves])
        total, at = torch.zeros_like(flat), 0
        for p in leaves:
            p.data = flat[at:at + p.numel()].view(p.shape)
            p.grad = total[at:at + p.numel()].view(p.shape)
            at += p.numel()
    optimiser = Adam(flat)

    def flat_step():
        total.zero_()
        loss(weights, biases).backward()
        with torch.no_grad():
            optimiser.step(total)

    rows.append(timing.measure(flat_step, args.repeats, args.patience, name="flat", batch=n, width=w))
    weights, biases = networks.fan_in(widths, True, dtype)
    for name, optimiser2 in optimisers(weights + biases):

        def step():
            optimiser2.zero_grad(set_to_none=True)
            loss(weights, biases).backward()
            optimiser2.step()

        try:
            rows.append(timing.measure(step, args.repeats, args.patience, name=name, batch=n, width=w))
        except RuntimeError:
            pass
    return best(rows)


def scalar():
    """RK4 of the planar double pendulum, 100 steps, gradient in the start, as scalar operations of one state."""
    g, h = 9.81, 0.01
    start = torch.tensor([1.0, 0.5, 0.2, -0.3], dtype=dtype)

    def field(y):
        a, b, v, w = y.unbind()
        s1, s2, c1, c2 = torch.sin(a), torch.sin(b), torch.cos(a), torch.cos(b)
        s, c = s1 * c2 - c1 * s2, c1 * c2 + s1 * s2
        r1, r2 = -w * w * s - 2 * g * s1, v * v * s - g * s2
        d = 1 / (2 - c * c)
        return torch.stack((v, w, d * (r1 - c * r2), d * (2 * r2 - c * r1)))

    def call():
        y = y0 = start.clone().requires_grad_()
        for _ in range(100):
            k1 = field(y)
            k2 = field(y + 0.5 * h * k1)
            k3 = field(y + 0.5 * h * k2)
            k4 = field(y + h * k3)
            y = y + h / 6 * (k1 + 2 * (k2 + k3) + k4)
        return torch.autograd.grad(y.sum(), y0)

    return [timing.measure(call, args.repeats or 11, args.patience, name="torch", gradient=call()[0].tolist())]


def batch1():
    """dV/dq and p/m of one state; the network's gradient by hand, no autograd."""
    w = args.width or 100
    weights, biases = networks.fan_in((3, w, w, w, 1), False, dtype)
    q, p = uniform(1, 3), uniform(1, 3, seed=4)

    def call():
        with torch.inference_mode():
            return networks.potential_gradient(weights, biases, q), p * 0.5

    return [timing.measure(call, args.repeats, args.patience, name="gradient", width=w)]


cases = dict(mlp2=mlp2, jvp=jvp, adam=adam, dense=dense, scalar=scalar, batch1=batch1)
cases["scalar-ops"], cases["mlp2-small"] = scalar, mlp2_small
if args.case in hamiltonian.EXPERIMENTS:
    rows = hamiltonian.run(args)
elif args.case in elastica.EXPERIMENTS:
    rows = elastica.run(args)
elif args.case in anomaly.EXPERIMENTS:
    rows = anomaly.run(args)
elif args.case in cases:
    rows = cases[args.case]()
else:
    raise SystemExit("no such case: " + args.case)
timing.report(args, rows)
