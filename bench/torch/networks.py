"""Networks whose gradient in the input is written by hand, so that training needs one backward pass."""
import numpy
import torch

tanh_backward = torch.ops.aten.tanh_backward  # (g, h) -> g (1 - h^2) in one pass


def potential_gradient(weights, biases, x):
    """d sum V / dx of V: tanh layers, last one linear without bias. weights[l] (in, out)."""
    h, values = x, []
    for w, b in zip(weights[:-1], biases):
        h = torch.tanh(torch.addmm(b, h, w))
        values.append(h)
    g = tanh_backward(weights[-1].t().expand_as(h), values[-1])
    for l in range(len(values) - 1, 0, -1):
        g = tanh_backward(g.mm(weights[l].t()), values[l - 1])
    return g.mm(weights[0].t())


def curve_speed(weights, biases, s):
    """dq/ds of q: tanh layers, last one linear; s (B, 1). The tangent is carried forward by hand."""
    h = torch.tanh(torch.addmm(biases[0], s, weights[0]))
    d = tanh_backward(weights[0].expand_as(h), h)
    for w, b in zip(weights[1:-1], biases[1:]):
        h = torch.tanh(torch.addmm(b, h, w))
        d = tanh_backward(d.mm(w), h)
    return d.mm(weights[-1])


def fan_in(widths, last_bias, dtype, seed=1):
    gen = torch.Generator().manual_seed(seed)
    u = lambda shape, n: ((torch.rand(shape, generator=gen, dtype=torch.float64) * 2 - 1) / n**0.5).to(dtype)
    weights = [u((a, b), a).requires_grad_() for a, b in zip(widths, widths[1:])]
    biases = [u((b,), a).requires_grad_() for a, b in zip(widths, widths[1:])]
    return weights, biases if last_bias else biases[:-1]


def second_order_reference(weights, biases, x, of_input):
    """d/dtheta of sum |dV/dx|^2 (of_input) or sum |dq/ds|^2 in extended precision: the reverse of a tangent, with the
    tangent's direction or the cotangent held fixed at twice the derivative. Weights first, then hidden biases."""
    wide = lambda t: t.detach().numpy().astype(numpy.longdouble)
    W, b, x = [wide(w) for w in weights], [wide(v) for v in biases], wide(x)
    h = [x]
    for l in range(len(W) - 1):
        h.append(numpy.tanh(h[-1] @ W[l] + b[l]))
    slope = [1 - a * a for a in h[1:]]
    if of_input:
        g = numpy.ones((len(x), 1), numpy.longdouble) @ W[-1].T
        for l in range(len(W) - 2, -1, -1):
            g = (g * slope[l]) @ W[l].T
        tangent, cotangent = 2 * g, numpy.ones((len(x), 1), numpy.longdouble)
    else:
        tangent, cotangent = numpy.ones_like(x), None
    d, z = [tangent], []
    for l in range(len(W) - 1):
        z.append(d[-1] @ W[l])
        d.append(slope[l] * z[-1])
    if cotangent is None:
        cotangent = 2 * (d[-1] @ W[-1])
    dbar, hbar = cotangent @ W[-1].T, numpy.zeros_like(h[-1])
    dW, db = [None] * len(W), [None] * (len(W) - 1)
    dW[-1] = d[-1].T @ cotangent
    for l in range(len(W) - 2, -1, -1):
        zbar = hbar * slope[l] - 2 * h[l + 1] * slope[l] * dbar * z[l]
        dzbar = dbar * slope[l]
        dW[l], db[l] = h[l].T @ zbar + d[l].T @ dzbar, zbar.sum(0)
        hbar, dbar = zbar @ W[l].T, dzbar @ W[l].T
    return dW + db


def difference(found, reference):
    """max |x - r| / max |r| over all arrays."""
    pairs = [(f.detach().numpy().astype(numpy.longdouble), r) for f, r in zip(found, reference)]
    return float(max(numpy.abs(f - r).max() for f, r in pairs) / max(numpy.abs(r).max() for _, r in pairs))
