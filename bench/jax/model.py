"""The learned Hamiltonian of one spherical pendulum in JAX, as liegrad/hamiltonian.h states it: H = |p|^2/(2 m) + V(q),
m = gamma^2 + max(0, b), V a network with tanh; CF4 on T*S^2; the loss is the mean squared difference over trajectories,
coordinates and points without the first one. Arrays are (3, B): components first, so that elementwise work runs along the
batch."""
import math

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

TERMS = 9  # of the series of c_1, c_2, c_3 in |u|^2: rounding is reached for |u| <= 1.5


def cross(a, b):
    return jnp.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))


def potential_gradient(net, q):
    """dV/dq by hand: the training's gradient then needs one reverse pass. net: W, b, W, b, ..., W."""
    h, values = q, []
    for w, b in zip(net[:-1:2], net[1::2]):
        h = jnp.tanh(w.T @ h + b[:, None])
        values.append(h)
    g = net[-1] * (1 - h * h)
    for w, h in zip(net[-3:0:-2], values[-2::-1]):
        g = (w @ g) * (1 - h * h)
    return net[0] @ g


def field(parts, q, p):
    """(xi, eta) = (q x v, g x q + v x p)"""
    *net, gamma, b = parts
    v = p / (gamma.reshape(()) ** 2 + jax.nn.relu(b.reshape(())))
    g = potential_gradient(net, q)
    return jnp.stack((cross(q, v), cross(g, q) + cross(v, p)))


def stumpff(k, w):
    """c_k(w) = sum_j (-w)^j / (k + 2 j)!"""
    c = 0.0
    for j in reversed(range(TERMS)):
        c = c * w + (-1) ** j / math.factorial(k + 2 * j)
    return c


def act(a, q, p):
    """exp(u, eta) . (q, p) = (R q, R p + (V eta) x R q)"""
    u, eta = a
    w = (u * u).sum(0)
    c1, c2, c3 = (stumpff(k, w) for k in (1, 2, 3))

    def turn(y, a, b):
        x = cross(u, y)
        return y + a * x + b * cross(u, x)

    q, p, t = turn(q, c1, c2), turn(p, c1, c2), turn(eta, c2, c3)
    return q, p + cross(t, q)


def step(parts, h, q, p):
    """CF4: Celledoni, Marthinsen, Owren, Future Gener. Comput. Syst. 19 (2003) 341."""
    f = lambda q, p: h * field(parts, q, p)
    f1 = f(q, p)
    y2 = act(0.5 * f1, q, p)
    f2 = f(*y2)
    f3 = f(*act(0.5 * f2, q, p))
    f4 = f(*act(f3 - 0.5 * f1, *y2))
    both, other, odd = (f2 + f3) / 6, (f1 + f4) / 12, (f1 - f4) / 6
    return act(both + other - odd, *act(both + other + odd, q, p))


def loss(parts, data, h):
    """data (M, 2, 3, B). A step is computed again in the reverse pass: half the time of keeping what it needs."""
    again = jax.checkpoint(lambda parts, q, p: step(parts, h, q, p))

    def advance(y, truth):
        q, p = again(parts, *y)
        return (q, p), ((jnp.stack((q, p)) - truth) ** 2).sum()

    _, parts_of_loss = jax.lax.scan(advance, (data[0, 0], data[0, 1]), data[1:])
    return parts_of_loss.sum() / data[1:].size
