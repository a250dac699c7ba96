"""Training a learned Hamiltonian: commutator-free Lie group integrator on (T*S^2)^k, Stormer-Verlet on R^2n. Same data,
same initial weights, same loss, optimiser and schedule as lg-bench hamiltonian; E1 is judged by lg-bench."""
import math
import time

import torch

from networks import potential_gradient
from timing import row

EXPERIMENTS = {  # links, N, M, t_end, hidden, decay
    "hamiltonian": (1, 500, 5, 0.1, (100, 100, 100), 50),
    "hamiltonian-small": (1, 500, 5, 0.1, (20, 20), 50),
    "hamiltonian-double": (2, 500, 5, 0.1, (100, 100, 100), 50),
    "hamiltonian-quartic": (2, 900, 6, 0.3, (100, 50, 50), 30),
}


class Parameters:
    """Leaves that are views of one flat vector: Adam runs once over all of them."""

    def __init__(self, flat, widths, kinetic):
        self.flat, self.leaves, at = flat, [], 0
        self.weights, self.biases, self.kinetic = [], [], []
        for l, (a, b) in enumerate(zip(widths, widths[1:])):
            at = self.take(self.weights, at, (a, b))
            if l + 2 < len(widths):
                at = self.take(self.biases, at, (b,))
        for shape in kinetic:
            at = self.take(self.kinetic, at, shape)
        assert at == flat.numel()

    def take(self, where, at, shape):
        n = math.prod(shape)
        leaf = self.flat[at:at + n].view(shape).detach().requires_grad_()
        where.append(leaf)
        self.leaves.append(leaf)
        return at + n


def stumpff_table(dtype):
    """c_1, c_1, c_2, c_2, c_2, c_3 in rows (for q, p, eta): Horner's coefficients in |u|^2, good for |u| <= 1.5."""
    f = math.factorial
    rows = [[(-1)**j / f(k + 2 * j) for k in (1, 1, 2, 2, 2, 3)] for j in range(9)]
    return torch.tensor(rows, dtype=dtype).view(9, 2, 3, 1)


class Chain:
    def __init__(self, links, dtype):
        self.k, self.table = links, stumpff_table(dtype)

    def prepare(self, p, h):
        """What a batch needs once. The step is folded in: the field below is h times the field."""
        gamma, b = p.kinetic
        m = gamma.t().mm(gamma) + torch.diag(torch.relu(b))
        if self.k == 1:
            self.W = h / m
        elif self.k == 2:
            m = m.flatten()
            a, c, d = m[0], m[1], m[3]
            det = a * d - c * c
            self.W = torch.stack((d, -c, -c, a)).view(2, 2) * (h / det)
        else:
            self.W = h * torch.linalg.inv(m)
        self.weights, self.biases = (*p.weights[:-1], h * p.weights[-1]), p.biases

    def kinetic(self, q, p):
        if self.k == 1:
            return p * self.W, None
        Wp = torch.matmul(self.W, p)
        u = (q * Wp).sum(-1)
        S = self.W * q.matmul(q.transpose(1, 2))
        if self.k == 2:
            s = S.view(-1, 4)
            a, c, d = s[:, 0:1], s[:, 1:2], s[:, 3:4]
            lam = torch.cat((d * u[:, 0:1] - c * u[:, 1:2], a * u[:, 1:2] - c * u[:, 0:1]), 1) / (a * d - c * c)
        else:
            lam = torch.linalg.solve(S, u)
        lam = lam.unsqueeze(-1)
        return torch.matmul(self.W, p - q * lam), lam

    def field(self, z):
        """h f: z (B, k, 2, 3) -> (B, k, 2, 3): xi = q x v, eta = g x q + v x p."""
        q, p = z.unbind(2)
        g = potential_gradient(self.weights, self.biases, q.reshape(-1, 3 * self.k)).view_as(q)
        v, lam = self.kinetic(q, p)
        if lam is not None:
            g = g - v * lam
        x = torch.linalg.cross(torch.stack((q, g, v), 2), torch.stack((v, q, p), 2))
        return torch.stack((x[:, :, 0], x[:, :, 1] + x[:, :, 2]), 2)

    def act(self, a, z):
        """exp(u, eta) . (q, p) = (R q, R p + (V eta) x R q)"""
        u, eta = a[:, :, 0:1], a[:, :, 1:2]
        y = torch.cat((z, eta), 2)
        x1 = torch.linalg.cross(u.expand_as(y), y)
        x2 = torch.linalg.cross(u.expand_as(y), x1)
        w = (u * u).sum(-1, keepdim=True).unsqueeze(2)
        c = self.table[5]
        for j in range(4, -1, -1):
            c = torch.addcmul(self.table[j], c, w)
        c1, c2 = c.unbind(2)
        r = torch.addcmul(torch.addcmul(y, c1, x1), c2, x2)
        q, p, t = r.unbind(2)
        return torch.stack((q, p + torch.linalg.cross(t, q)), 2)

    def step(self, z):
        f1 = self.field(z)
        y2 = self.act(0.5 * f1, z)
        f2 = self.field(y2)
        f3 = self.field(self.act(0.5 * f2, z))
        f4 = self.field(self.act(torch.sub(f3, f1, alpha=0.5), y2))
        both, other, odd = (f2 + f3) / 6, (f1 + f4) / 12, (f1 - f4) / 6
        return self.act(both + other - odd, self.act(both + other + odd, z))

    def predict(self, x, h, steps):
        z, out = x.view(-1, self.k, 2, 3), []
        for _ in range(steps):
            z = self.step(z)
            out.append(z)
        return torch.stack(out, 1).flatten(2)


class Separable:
    def __init__(self, n):
        self.n = n

    def prepare(self, p, h):
        a = p.kinetic[0]
        self.K, self.p = a.t().mm(a), p

    def predict(self, x, h, steps):
        gradient = lambda q: potential_gradient(self.p.weights, self.p.biases, q)
        q, p, out = x[:, :self.n], x[:, self.n:], []
        g = gradient(q)
        for _ in range(steps):  # the force at the end of a step is that at the start of the next
            p = torch.sub(p, g, alpha=0.5 * h)
            q = torch.addmm(q, p, self.K, alpha=h)
            g = gradient(q)
            p = torch.sub(p, g, alpha=0.5 * h)
            out.append(torch.cat((q, p), 1))
        return torch.stack(out, 1)


def adam_step(flat, grads, m, v, step, lr, clip, eps):
    g = torch.cat([x.reshape(-1) for x in grads])
    if clip > 0:
        norm = g.norm()
        g = g * (clip / norm).clamp(max=1.0)
    m.lerp_(g, 0.1)
    v.mul_(0.999).addcmul_(g, g, value=0.001)
    c1, c2 = 1 - 0.9**step, 1 - 0.999**step
    flat.addcdiv_(m, v.sqrt().mul_(c2**-0.5).add_(eps), value=-lr / c1)


def run(args):
    links, N, M, t_end, hidden, decay = EXPERIMENTS[args.case]
    dtype = torch.float64 if args.dtype == "f64" else torch.float32
    quartic = args.case == "hamiltonian-quartic"
    inputs = links if quartic else 3 * links
    dim = 2 * inputs
    data = torch.frombuffer(bytearray(open(args.inputs + ".data", "rb").read()), dtype=torch.float64)
    flat = torch.frombuffer(bytearray(open(args.inputs + ".weights", "rb").read()), dtype=torch.float64)
    data, flat = data.view(N, M, dim).to(dtype), flat.to(dtype).clone()
    params = Parameters(flat, (inputs, *hidden, 1), ((links, links),) if quartic else ((links, links), (links,)))
    model = Separable(links) if quartic else Chain(links, dtype)
    h, batch = t_end / (M - 1), args.batch or (50 if quartic else 80)
    m, v, step = torch.zeros_like(flat), torch.zeros_like(flat), 0
    gen = torch.Generator().manual_seed(1)
    losses, times = [], []

    def loss_of(x):
        model.prepare(params, h)
        predicted = model.predict(x[:, 0], h, M - 1)
        return torch.nn.functional.mse_loss(predicted, x[:, 1:])

    for epoch in range(args.epochs):
        start = time.perf_counter()
        lr, total = 1e-2 * 0.1**(epoch // decay), 0.0
        for index in torch.randperm(N, generator=gen).split(batch):
            x, step = data[index], step + 1
            loss = loss_of(x)
            grads = torch.autograd.grad(loss, params.leaves)
            with torch.no_grad():
                adam_step(flat, grads, m, v, step, lr, 1e-3, 1e-12)
            total += loss.detach() * len(index)
        losses.append(float(total) / N)
        times.append(1e6 * (time.perf_counter() - start))
    if args.out:
        open(args.out, "wb").write(flat.double().numpy().tobytes())
    return [row(times[1:], name="epoch", batch=batch, inner=1, loss=losses[-1], losses=losses)]
