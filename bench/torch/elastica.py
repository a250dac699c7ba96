"""An epoch of training surrogates of the elastica: curves, initial weights and order of the samples as lg-bench
elastica-... writes them, the same loss, optimiser and batches. Networks are those of liegrad/networks.h; weights lie in
one flat vector, (in, out), y = x W + b. The derivative along the beam is carried forward by hand."""
import math
import statistics
import time

import torch

from networks import tanh_backward
from timing import row

INTERVALS, LENGTH, CENTRE = 50, 3.3, 1.5
EXPERIMENTS = {  # curves, batch, inputs, embedding, hidden, layers, outputs, rate, gamma, architectures
    "elastica-discrete": (900, 32, 8, 0, 879, 4, 4 * (INTERVALS - 1), 1.378e-3, 4.242e-3, ("mlp",)),
    "elastica-continuous": (900, 1024, 9, 190, 190, 5, 2, 3.025e-3, 2e-2, ("mult-affine", "mult")),
    "elastica-angle": (900, 20, 3, 143, 143, 7, 1, 3.007e-3, 0.0, ("mult", "mult-affine")),
}
STEPS = {"mlp": 1, "mult": 1, "mult-affine": 2}
TAU = 2 * math.pi


class Network:
    def __init__(self, kind, flat, inputs, embedding, hidden, layers, outputs):
        first = embedding or inputs
        shapes = [(inputs, embedding)] if embedding else []
        shapes += [(first, hidden)] * (1 if kind == "mlp" else 3)
        shapes += [(hidden, hidden)] * (layers * STEPS[kind]) + [(hidden, outputs)]
        self.kind, self.embedding, self.flat, self.leaves, self.dense, at = kind, embedding, flat, [], [], 0
        self.gradient = torch.zeros_like(flat)
        for a, b in shapes:
            weight, bias = self.leaf(at, (a, b)), self.leaf(at + a * b, (b,))
            at += a * b + b
            self.dense.append((weight, bias))
        assert at == flat.numel()

    def leaf(self, at, shape):
        """A view of the flat vector whose gradient is a view of the flat gradient."""
        n = math.prod(shape)
        leaf = self.flat[at:at + n].view(shape).detach().requires_grad_()
        leaf.grad = self.gradient[at:at + n].view(shape)
        self.leaves.append(leaf)
        return leaf

    def value(self, x):
        dense = iter(self.dense[:-1])
        act = lambda h: torch.tanh(linear(next(dense), h))
        if self.embedding:
            x = torch.sin(linear(next(dense), x) * TAU)
        if self.kind == "mlp":
            h = act(x)
            for w in dense:
                h = torch.tanh(linear(w, h))
        else:
            u, v, h = act(x), act(x), act(x)
            d = v - u
            for w in dense:
                z = torch.tanh(linear(w, h))
                if self.kind == "mult-affine":
                    z = linear(next(dense), z)
                h = torch.addcmul(u, z, d)
        return linear(self.dense[-1], h)

    def value_and_derivative(self, x, scale):
        """And the derivative by the first input, times `scale`."""
        dense = iter(self.dense[:-1])
        w, b = next(dense)
        y = linear((w, b), x) * TAU
        x, dx = torch.sin(y), torch.cos(y) * (w[0:1] * (TAU * scale))

        def act(h, dh):
            w, b = next(dense)
            h = torch.tanh(torch.addmm(b, h, w))
            return h, tanh_backward(dh.mm(w), h)

        (u, du), (v, dv), (h, dh) = act(x, dx), act(x, dx), act(x, dx)
        d, dd = v - u, dv - du
        for w, b in dense:
            z = torch.tanh(torch.addmm(b, h, w))
            dz = tanh_backward(dh.mm(w), z)
            if self.kind == "mult-affine":
                w, b = next(dense)
                z, dz = torch.addmm(b, z, w), dz.mm(w)
            h, dh = torch.addcmul(u, z, d), torch.addcmul(torch.addcmul(du, dz, d), z, dd)
        w, b = self.dense[-1]
        return torch.addmm(b, h, w), dh.mm(w)


def linear(layer, x):
    return torch.addmm(layer[1], x, layer[0])


def normalised(boundary):
    x = boundary.clone()
    x[:, [0, 4]] = (x[:, [0, 4]] - CENTRE) / CENTRE
    return x


# ---- samples and losses; `index` says which samples are a batch ----


class Discrete:
    def __init__(self, boundary, q, v, gamma):
        self.x, self.gamma = normalised(boundary), gamma
        self.target = torch.cat((q[:, 1:-1].flatten(1), v[:, 1:-1].flatten(1)), 1)
        self.samples = len(self.x)

    def loss(self, net, index):
        d = net.value(self.x[index]) - self.target[index]
        nodes = torch.nn.functional.pad(d.view(len(d), 2, -1), (2, 2))
        rough = nodes[:, :, 2:] - nodes[:, :, :-2]
        return d.square().mean() + self.gamma * rough.square().mean()


class Continuous:
    def __init__(self, boundary, q, v, gamma):
        n, nodes = q.shape[:2]
        s = torch.arange(nodes, dtype=torch.float64) / INTERVALS
        s = s.to(q.dtype).view(1, nodes, 1).expand(n, nodes, 1)
        x = normalised(boundary).view(n, 1, 8).expand(n, nodes, 8)
        self.x, self.gamma = torch.cat((s, x), 2).reshape(-1, 9), gamma
        self.q, self.v = q.reshape(-1, 2), v.reshape(-1, 2)
        self.samples = len(self.x)

    def loss(self, net, index):
        mse = torch.nn.functional.mse_loss
        q, v = net.value_and_derivative(self.x[index], 1 / LENGTH)
        excess = v.square().sum(1) - 1
        return mse(q, self.q[index]) + mse(v, self.v[index]) + 0.5 * self.gamma * excess.square().mean()


class Angle:
    """`each`: every node has 10 panels of 3 Gauss points of its own, as the published program. Otherwise one set of
    points, 3 on each interval between two nodes, serves all nodes of a curve."""

    def __init__(self, boundary, q, v, gamma, each):
        self.q, self.v, self.each = q, v, each
        self.ends = torch.stack((torch.atan2(boundary[:, 3], boundary[:, 2]),
                                 torch.atan2(boundary[:, 7], boundary[:, 6])), 1) / math.pi
        root = math.sqrt(0.6)
        gauss = torch.tensor(((1 - root) / 2, 0.5, (1 + root) / 2), dtype=torch.float64)
        weight = torch.tensor((5 / 18, 8 / 18, 5 / 18), dtype=torch.float64)
        nodes = torch.arange(INTERVALS + 1, dtype=torch.float64) * LENGTH / INTERVALS
        if each:
            panels = (torch.arange(10, dtype=torch.float64).view(10, 1) + gauss).reshape(-1) / 10
            points, self.weight = nodes.view(-1, 1) * panels, nodes.view(-1, 1) * (weight / 10).repeat(10)
        else:
            starts = torch.arange(INTERVALS, dtype=torch.float64).view(-1, 1)
            points, self.weight = (starts + gauss) * LENGTH / INTERVALS, weight.view(1, 3) * LENGTH / INTERVALS
        self.weight = self.weight.to(q.dtype)
        self.s = torch.cat((nodes, points.flatten())).to(q.dtype)
        self.samples = len(q)

    def loss(self, net, index):
        ends, n, places = self.ends[index], len(index), len(self.s)
        x = torch.cat((ends.view(n, 1, 2).expand(n, places, 2), self.s.view(1, places, 1).expand(n, places, 1)), 2)
        angle = net.value(x.view(-1, 3)).view(n, places) * math.pi
        tangent = torch.stack((torch.cos(angle), torch.sin(angle)))  # (2, n, places)
        v, inner = tangent[:, :, :INTERVALS + 1], tangent[:, :, INTERVALS + 1:]
        parts = (inner.view(2, n, -1, self.weight.shape[1]) * self.weight).sum(3)
        if not self.each:
            parts = torch.nn.functional.pad(parts.cumsum(2), (1, 0))
        given_q, given_v = self.q[index].permute(2, 0, 1), self.v[index].permute(2, 0, 1)
        start = given_q[:, :, :1]
        mse = torch.nn.functional.mse_loss
        return mse(parts + start, given_q) + mse(v, given_v)


# ---- training ----


class Flat:
    """Adam in one pass an operation over flat memory."""

    def __init__(self, net, lr):
        self.net, self.lr, self.t = net, lr, 0
        self.m, self.v = torch.zeros_like(net.flat), torch.zeros_like(net.flat)

    def zero(self):
        self.net.gradient.zero_()

    @torch.no_grad()
    def step(self):
        self.t += 1
        g = self.net.gradient
        self.m.lerp_(g, 0.1)
        self.v.mul_(0.999).addcmul_(g, g, value=0.001)
        denominator = self.v.sqrt().mul_((1 - 0.999**self.t)**-0.5).add_(1e-8)
        self.net.flat.addcdiv_(self.m, denominator, value=-self.lr / (1 - 0.9**self.t))


class Foreach:
    """PyTorch's own, over lists of tensors."""

    def __init__(self, net, lr):
        self.optimiser = torch.optim.Adam(net.leaves, lr=lr, foreach=True)

    def zero(self):
        self.optimiser.zero_grad(set_to_none=True)

    def step(self):
        self.optimiser.step()


def train(make, data, optimiser, lr, batches, epochs):
    """Losses and seconds of each epoch."""
    net = make()
    adam = optimiser(net, lr)
    losses, seconds = [], []
    for _ in range(epochs):
        start, total = time.perf_counter(), 0.0
        for index in batches:
            adam.zero()
            loss = data.loss(net, index)
            loss.backward()
            adam.step()
            total += loss.detach() * len(index)
        losses.append(float(total) / sum(map(len, batches)))
        seconds.append(time.perf_counter() - start)
    return losses, seconds


def fastest(make, data, lr, batches):
    """Of both forms of Adam the one that takes less time for a few batches."""
    few = batches[:6]
    return min((Flat, Foreach), key=lambda o: min(train(make, data, o, lr, few, 3)[1]))


def doubles(path, dtype):
    return torch.frombuffer(bytearray(open(path, "rb").read()), dtype=torch.float64).to(dtype)


def run(args):
    n, batch, inputs, embedding, hidden, layers, outputs, lr, gamma, kinds = EXPERIMENTS[args.case]
    dtype, nodes = torch.float64 if args.dtype == "f64" else torch.float32, INTERVALS + 1
    boundary, q, v = doubles(args.inputs + ".data", dtype).split((8 * n, 2 * nodes * n, 2 * nodes * n))
    arrays = (boundary.view(n, 8), q.view(n, nodes, 2), v.view(n, nodes, 2), gamma)
    order = doubles(args.inputs + ".order", torch.int64)
    batch, rows, brief = args.batch or batch, [], args.patience < 1
    variants = [("", lambda: Angle(*arrays, False)), (" each", lambda: Angle(*arrays, True))]
    if args.case != "elastica-angle":
        variants = [("", lambda: (Discrete if args.case == "elastica-discrete" else Continuous)(*arrays))]
    for kind in kinds[:1] if brief else kinds:
        weights = doubles("%s.%s" % (args.inputs, kind), dtype)
        make = lambda: Network(kind, weights.clone(), inputs, embedding, hidden, layers, outputs)
        for suffix, open_data in variants[:1] if brief else variants:
            data = open_data()
            batches = order.split(batch)
            whole = len(batches)
            if suffix:  # each batch is the same work: the time of an epoch is told by a few
                batches = batches[:3]
            optimiser = Flat if suffix else fastest(make, data, lr, batches)
            losses, seconds = train(make, data, optimiser, lr, batches, 2 if suffix else args.epochs)
            times = [1e6 * s * whole / len(batches) for s in seconds[1:]]
            if suffix:
                more = dict(timed_batches=len(batches), of_batches=whole)
            else:
                more = dict(loss=losses[-1], losses=losses)
            rows.append(row(times, name=kind + suffix, batch=batch, width=hidden, inner=1, parameters=len(weights),
                            adam=optimiser.__name__, seconds_per_epoch=1e-6 * statistics.median(times), **more))
    return rows
