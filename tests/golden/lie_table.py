#!/usr/bin/env python3
"""Writes lie_table.h beside itself: maps of so(3) and se(3) and their cotangents in 120 digits (mpmath) at inputs that are
exact doubles, or exact floats. `value` and `slope` are what rounding allows: units of the type times the size of the result
and what a unit's change of each number of u makes of it."""
import os
import struct
import mpmath as mp

mp.mp.dps = 120
PI = 3.141592653589793
ANGLES = {"0": 0.0, "1e-310": 1e-310, "1e-160": 1e-160, "1e-9": 1e-9, "1e-4": 1e-4, "1e-3": 1e-3, "1": 1.0, "3.3": 3.3,
          "3.7": 3.7, "4.1": 4.1, "pi - 1e-8": PI - 1e-8, "pi - 1e-12": PI - 1e-12, "pi": PI, "pi + 1e-12": PI + 1e-12,
          "2 pi - 1e-9": 2 * PI - 1e-9, "2 pi": 2 * PI, "2 pi + 1e-9": 2 * PI + 1e-9,
          "1e3": 1e3, "1e8": 1e8, "1e13": 1e13, "1e15": 1e15}
SINGLE = ("0", "1e-9", "1", "3.7", "pi - 1e-12", "1e3")
AXIS, V, Q, P, G = (0.48, -0.64, 0.6), (0.5, -1.25, 0.75), (0.625, 0.375, -0.5), (-0.25, 1.0, 0.875), (1.0, -0.5, 0.25)
DELTA = mp.mpf(10)**-40


def single(x):
    return struct.unpack("f", struct.pack("f", x))[0]


def dot(a, b):
    return mp.fsum(x * y for x, y in zip(a, b))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def add(*terms):
    return [mp.fsum(column) for column in zip(*terms)]


def times(c, a):
    return [c * x for x in a]


def series(k, w):
    return mp.fsum((-w)**j / mp.factorial(k + 2 * j) for j in range(60))


def stumpff(w):
    """c_0 ... c_3"""
    if w < 1:
        return [series(k, w) for k in range(4)]
    x = mp.sqrt(w)
    c = [mp.cos(x), mp.sin(x) / x]
    return c + [(1 - c[0]) / w, (1 - c[1]) / w]


def function(g1, g2, u, b):
    first = cross(u, b)
    return add(b, times(g1, first), times(g2, cross(u, first)))


def exp(u, x):
    c = stumpff(dot(u, u))
    return function(c[1], c[2], u, x)


def dexp(u, v):
    c = stumpff(dot(u, u))
    return function(c[2], c[3], u, v)


def dexpinv(A, B):
    """g_2 = (1 - (x/2) cot(x/2))/w = (c_2/2 - (c_1 - c_2) / ...): by the Stumpff functions of w/4, c_0 and c_1."""
    w = dot(A, A)
    c = [series(k, w / 4) for k in range(4)] if w < 1 else stumpff(w / 4)
    # (x/2) cot(x/2) = c_0/c_1, and c_1 - c_0 = (w/4) (c_2 - c_3)
    return function(mp.mpf(-1) / 2, (c[2] - c[3]) / (4 * c[1]), A, B)


def se3_act(u, v, q, p):
    return add(exp(u, p), cross(dexp(u, v), exp(u, q)))


def se3_dexpinv(A, a, B, b):
    ahead, behind = (dexpinv(add(A, times(s * DELTA, a)), B) for s in (1, -1))
    return add(dexpinv(A, b), times(1 / (2 * DELTA), add(ahead, times(-1, behind))))


MAPS = [("LG_K_SO3_EXP", exp, (Q, )), ("LG_K_SO3_DEXP", dexp, (V, )), ("LG_K_SE3_ACT", se3_act, (V, Q, P)),
        ("LG_K_SO3_DEXPINV", dexpinv, (Q, )), ("LG_K_SE3_DEXPINV", se3_dexpinv, (V, Q, P))]


def moved(inputs, k, i, by):
    out = [list(x) for x in inputs]
    out[k][i] += by
    return out


def gradient(f, inputs, g):
    """Of g . f, to 50 digits."""
    h = mp.mpf(10)**-25
    return [[(dot(g, f(*moved(inputs, k, i, h))) - dot(g, f(*moved(inputs, k, i, -h)))) / (2 * h) for i in range(3)]
            for k in range(len(inputs))]


def reach(f, inputs, unit):
    """How far f moves when each number of u moves by a unit of its size."""
    base, total = f(*inputs), mp.mpf(0)
    for i in range(3):
        by = inputs[0][i] * unit
        total += max(abs(a - b) for a, b in zip(f(*moved(inputs, 0, i, by)), base))
    return total


def flat(rows):
    return [x for row in rows for x in row]


def number(x):
    return "0.0" if x == 0 else mp.nstr(x, 20, min_fixed=0, max_fixed=0)


def row(name, f, more, angle, value, is_single):
    cut = single if is_single else float
    unit = mp.mpf(2)**(-24 if is_single else -53)
    inputs = [[mp.mpf(cut(value * a)) for a in AXIS]] + [[mp.mpf(x) for x in m] for m in more]
    g = [mp.mpf(x) for x in G]
    result, slopes = f(*inputs), gradient(f, inputs, g)
    size = max(abs(x) for x in result) + max(abs(x) for m in more for x in m)
    steep = max(abs(x) for x in flat(slopes)) + 2
    allowed = unit * size + reach(f, inputs, unit)
    slack = unit * steep + reach(lambda *x: flat(gradient(f, x, g)), inputs, unit)
    u = ", ".join(float(x).hex() for x in inputs[0])
    slopes = flat(slopes) + [mp.mpf(0)] * (12 - 3 * len(slopes))
    return '    {%s, %d, "%s", {%s}, {%s}, {%s}, %s, %s},' % (
        name, is_single, angle, u, ", ".join(map(number, result)), ", ".join(map(number, slopes)), mp.nstr(allowed, 4), mp.nstr(slack, 4))


def listed(x):
    return "{%s}" % ", ".join(map(repr, x))


def main():
    lines = ["/* Written by lie_table.py: do not edit. */", "/* clang-format off */", "#ifndef LG_LIE_TABLE_H", "#define LG_LIE_TABLE_H", "",
             "/* The other inputs of maps with two inputs and of maps with four, and the cotangent of the result. */",
             "static const double lie_table_q[3] = %s, lie_table_v[3] = %s;" % (listed(Q), listed(V)),
             "static const double lie_table_p[3] = %s, lie_table_g[3] = %s;" % (listed(P), listed(G)), "",
             "static const struct {", "    int map, single; /* inputs are floats */", "    const char *angle;", "    double u[3], y[3];",
             "    double slope[12];         /* cotangents of the inputs */", "    double allowed, slack;    /* what rounding may change: y, slope */",
             "} lie_table[] = {"]
    for name, f, more in MAPS:
        for angle, value in ANGLES.items():
            lines.append(row(name, f, more, angle, value, False))
        for angle in SINGLE:
            lines.append(row(name, f, more, angle, ANGLES[angle], True))
    lines += ["};", "", "#endif"]
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "lie_table.h"), "w") as out:
        out.write("\n".join(lines) + "\n")


main()
