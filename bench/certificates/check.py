#!/usr/bin/env python3
"""Proves the claim of a certificate again, from the file alone (docs/certificates.md describes the file).

usage: check.py [--verbose] CERTIFICATE...        exit code 0: all are proved, 1: one is not, 3: one is no certificate

The checker shares no code with liegrad. It trusts no label of a box: each box must have V > level, or lie near the
goal, or V must fall on all of it; a box without a proof is halved, at most 12 times. A box of y stands for the states
x = goal + T y. Its middle is m, and k = y - m.
  held        F = x(period) from the middle, A = dx(period)/dy over the box; D = F - x(m), E = A - T, s = 1
  continuous  F = x' at the middle, A = dx'/dy over the box; D = F, E = A, s = 0
  The change (V' if continuous) is (D + E k).P (2 x(m) - 2 goal + s D + (2 T + s E) k) for some matrix of the interval
  matrix E, also where the loop has kinks: E contains all slopes. Errors of the model are columns of E: (E, 1), (T, 0).
The flow in a step of length h: Picard's theorem gives a tube Z with X + [0, h] f(Z) in Z, and so for its Jacobian; x(h)
is a Taylor polynomial with its last coefficient over Z. Where f has a kink in Z, only x'' and the Jacobian's first
coefficient are used. Lists [value, d/d1, d/d2, ...] hold intervals, or None for an exact 0.
Sums, products, quotients and roots are IEEE operations moved outward; the other functions are balls of 90 bits (flint,
or mpmath). A bound NaN means that nothing is known: no comparison with it is true."""
import hashlib, json, math, sys, time
from fractions import Fraction
import numpy as np
try:
    import flint
    flint.ctx.prec = 90
except ImportError:
    flint = None
    import mpmath
    mpmath.mp.prec = 90
np.seterr(all='ignore')
U, TINY, BATCH, HALVINGS = 2.0 ** -52, 1e-300, 4096, 12
class Refused(Exception): pass
class I:
    __slots__ = ('l', 'h')
    def __init__(s, l, h=None): s.l, s.h = l, l if h is None else h
    def __add__(s, o): l, h = s.l + o.l, s.h + o.h; return I(l - abs(l) * U, h + abs(h) * U)   # sums below 1e-307 are exact
    def __neg__(s): return I(-s.l) if s.l is s.h else I(-s.h, -s.l)
    def __sub__(s, o): return s + -o
    def __mul__(s, o): return s.corners(o, np.multiply)
    def __truediv__(s, o):
        r = s.corners(o, np.divide); ok = (o.l > 0) | (o.h < 0); return I(np.where(ok, r.l, np.nan), np.where(ok, r.h, np.nan))
    def corners(s, o, f):
        p = [f(a, b) for a in ((s.l,) if s.l is s.h else (s.l, s.h)) for b in ((o.l,) if o.l is o.h else (o.l, o.h))]
        l = h = p[0]
        for q in p[1:]: l, h = np.minimum(l, q), np.maximum(h, q)
        e = TINY * (((s.l != 0) | (s.h != 0)) & ((o.l != 0) | (o.h != 0)))   # underflow; 0 x is 0
        return I(l - (abs(l) * U + e), h + (abs(h) * U + e))
    def square(s): m = I(np.where((s.l <= 0) & (s.h >= 0), 0 * s.l, np.minimum(abs(s.l), abs(s.h))), s.size()); r = m * m; return I(np.maximum(r.l, 0), r.h)
    def size(s): return np.maximum(-s.l, s.h)
def add(a, b): return b if a is None else a if b is None else a + b
def neg(a): return None if a is None else -a
def mul(a, b): return None if a is None or b is None else a * b
def total(terms):
    r = None
    for t in terms: r = add(r, t)
    return r
def full(a): return I(0.) if a is None else a
def cap(a, b): return I(np.fmax(a.l, b.l), np.fmin(a.h, b.h))
# functions at points: floats on both sides of the value, both equal to it where it is exact
FUNCTIONS = {n: ((lambda *a, n=n: getattr(a[0], n)(*a[1:])) if flint and n != 'atan2' else flint.arb.atan2 if flint else getattr(mpmath, n))
             for n in ('sin', 'cos', 'exp', 'log', 'tanh', 'atan2')}
def ball(name, *x):
    try:
        if flint: v = FUNCTIONS[name](*[flint.arb(float(t)) for t in x]); m = float(v.mid()); exact = v.rad() == 0 and flint.arb(m) == v
        else:
            v = FUNCTIONS[name](*[mpmath.mpf(float(t)) for t in x]); m = float(v); r = abs(v) * mpmath.mpf(2) ** -80
            exact = x[0] == (1 if name == 'log' else 0) and (len(x) == 1 or x[1] > 0)
        if exact: return m, m
        lo, hi = math.nextafter(m, -math.inf), math.nextafter(m, math.inf)
        return (lo, hi) if (flint.arb(lo) < v < flint.arb(hi) if flint else lo < v - r and v + r < hi) else (math.nan, math.nan)
    except (ValueError, OverflowError, TypeError, ZeroDivisionError): return math.nan, math.nan
def points(name, *x):
    x = np.broadcast_arrays(*x); r = np.array([ball(name, *t) for t in zip(*[a.ravel() for a in x])]).reshape(x[0].shape + (2,))
    return I(r[..., 0], r[..., 1])
def monotone(name, x):
    a = points(name, x.l); return a if x.l is x.h else I(a.l, points(name, x.h).h)
PI = I(math.pi, math.nextafter(math.pi, 4)); HALF = I(PI.l / 2, PI.h / 2)
def trig(name, x):
    a = points(name, x.l); b = a if x.l is x.h else points(name, x.h); q = (x - HALF if name == 'sin' else x) / PI   # extrema: q whole
    first, last = np.ceil(q.l), np.floor(q.h); one, more, far = last >= first, last > first, ~(x.size() < 1e15)
    return I(np.where(far | more | one & (first % 2 != 0), -1., np.maximum(-1., np.minimum(a.l, b.l))),
             np.where(far | more | one & (first % 2 == 0), 1., np.minimum(1., np.maximum(a.h, b.h))))
# lists [value, slopes...]
def dadd(a, b): return [add(p, q) for p, q in zip(a, b)]
def dneg(a): return [neg(p) for p in a]
def dsub(a, b): return dadd(a, dneg(b))
def dscale(c, a): return [mul(c, p) for p in a]
def dover(a, k): return a if k == 1 else [None if p is None else p / I(float(k)) for p in a]
def dmul(a, b): return [mul(a[0], b[0])] + [add(mul(a[0], q), mul(p, b[0])) for p, q in zip(a[1:], b[1:])]
def ddiv(a, b):
    v = None if a[0] is None else a[0] / b[0]; return [v] + [None if p is None and (q is None or v is None) else full(add(p, neg(mul(v, q)))) / b[0] for p, q in zip(a[1:], b[1:])]
def chain(a, value, slope): return [value] + [mul(slope, p) for p in a[1:]]
def conv(a, b, k, lo, hi, weight=False):
    r = [None] * len(a[0])
    for i in range(lo, hi + 1): r = dadd(r, dscale(I(float(i)), dmul(a[i], b[k - i])) if weight else dmul(a[i], b[k - i]))
    return r
def pick(t, f, a, b):   # a where t, b where f, else both
    def one(p, q): p, q = full(p), full(q); return I(np.where(t, p.l, np.where(f, q.l, np.minimum(p.l, q.l))), np.where(t, p.h, np.where(f, q.h, np.maximum(p.h, q.h))))
    return [None if p is None and q is None else one(p, q) for p, q in zip(a, b)]
# Coefficient k of an operation in time: of its operands' coefficients x, its earlier ones y and those of a second series z.
def op_mul(k, x, y, z):
    if x[0] is x[1] and k == 0: a = x[0][0]; return [None if a[0] is None else a[0].square()] + [mul(I(2.), mul(a[0], p)) for p in a[1:]]
    return conv(x[0], x[1], k, 0, k)
def op_sqrt(k, x, y, z):
    if k == 0: v = full(x[0][0][0]); r = I(np.sqrt(v.l), np.sqrt(v.h)); r = I(r.l - abs(r.l) * U, r.h + abs(r.h) * U); return chain(x[0][0], r, I(.5) / r)
    return ddiv(dsub(x[0][k], conv(y, y, k, 1, k - 1)), dadd(y[0], y[0]))
def op_exp(k, x, y, z):
    if k == 0: v = monotone('exp', full(x[0][0][0])); return chain(x[0][0], v, v)
    return dover(conv(x[0], y, k, 1, k, True), k)
def op_log(k, x, y, z):
    if k == 0: v = full(x[0][0][0]); return chain(x[0][0], monotone('log', v), I(1.) / v)
    return ddiv(dsub(x[0][k], dover(conv(y, x[0], k, 1, k - 1, True), k)), x[0][0])
def op_trig(name, other, sign):   # z = cos or -sin: both have y' = z x', z' = -y x'
    def op(k, x, y, z):
        if k == 0:
            v = full(x[0][0][0]); p, q = trig(name, v), trig(other, v) * I(sign)
            z.append(chain(x[0][0], q, -p)); return chain(x[0][0], p, q)
        z.append(dneg(dover(conv(x[0], y, k, 1, k, True), k))); return dover(conv(x[0], z, k, 1, k, True), k)
    return op
def op_tanh(k, x, y, z):   # z = 1 - y^2
    if k == 0:
        v = monotone('tanh', full(x[0][0][0])); v = I(np.maximum(v.l, -1.), np.minimum(v.h, 1.)); r = chain(x[0][0], v, I(1.) - v.square()); z.append(chain(r, I(1.) - v.square(), I(-2.) * v)); return r
    r = dover(conv(x[0], z, k, 1, k, True), k); z.append(dneg(conv(y + [r], y + [r], k, 0, k))); return r
def op_atan2(k, x, y, z):   # of (a, b): angle of the point (b, a); z = a^2 + b^2
    a, b = x
    if k == 0:
        p, q = full(a[0][0]), full(b[0][0]); c = [points('atan2', s, t) for s in (p.l, p.h) for t in (q.l, q.h)]; r = p.square() + q.square()
        z.append(dadd(op_mul(0, [a, a], y, z), op_mul(0, [b, b], y, z))); u = I(np.minimum.reduce([i.l for i in c]), np.maximum.reduce([i.h for i in c]))
        return [u] + [None if s is None and t is None else full(add(mul(q, s), neg(mul(p, t)))) / r for s, t in zip(a[0][1:], b[0][1:])]
    z.append(dadd(conv(a, a, k, 0, k), conv(b, b, k, 0, k)))
    return ddiv(dover(dsub(dsub(conv(a, b, k, 1, k, True), conv(b, a, k, 1, k, True)), conv(y, z, k, 1, k - 1, True)), k), z[0])
def larger(a, b): return full(a[0]).l > full(b[0]).h
def op_max(k, x, y, z):
    a, b = x[0], x[1]; r = pick(larger(a[0], b[0]), larger(b[0], a[0]), a[k], b[k]); p, q = full(a[0][0]), full(b[0][0])
    return r if k else [I(np.maximum(p.l, q.l), np.maximum(p.h, q.h))] + r[1:]
def op_abs(k, x, y, z):
    v = full(x[0][0][0]); r = pick(v.l > 0, v.h < 0, x[0][k], dneg(x[0][k])); return r if k else [I(np.maximum(np.maximum(v.l, -v.h), 0), v.size())] + r[1:]
def op_ge(k, x, y, z):
    r = [None] * len(x[0][0]); t, f = larger(x[0][0], x[1][0]), larger(x[1][0], x[0][0]); return r if k else [I(np.where(t, 1., 0.), np.where(f, 0., 1.))] + r[1:]
def op_select(k, x, y, z): v = full(x[0][0][0]); return pick((v.l > 0) | (v.h < 0), (v.l == 0) & (v.h == 0), x[1][k], x[2][k])
OPS = {'add': lambda k, x, y, z: dadd(x[0][k], x[1][k]), 'sub': lambda k, x, y, z: dsub(x[0][k], x[1][k]), 'neg': lambda k, x, y, z: dneg(x[0][k]),
       'mul': op_mul, 'div': lambda k, x, y, z: ddiv(dsub(x[0][k], conv(y, x[1], k, 0, k - 1)), [full(x[1][0][0])] + x[1][0][1:]), 'sqrt': op_sqrt,
       'exp': op_exp, 'log': op_log, 'sin': op_trig('sin', 'cos', 1.), 'cos': op_trig('cos', 'sin', -1.), 'tanh': op_tanh, 'atan2': op_atan2,
       'max': op_max, 'abs': op_abs, 'ge': op_ge, 'select': op_select}
OPERANDS = {'ge': 2, 'select': 3, **{n: 2 for n in ('add', 'sub', 'mul', 'div', 'atan2', 'max')}}

class Program:
    """Code with few operations: powers are products, |p| of abs(a) stays, sigmoid and sign are written with others."""
    def __init__(s, what, inputs, outputs):
        s.code, new = [], []
        def put(*e): s.code.append(e); return len(s.code) - 1
        if what['inputs'] != inputs or len(what['outputs']) != outputs: raise ValueError('inputs or outputs')
        for j, (op, *a) in enumerate(what['code']):
            if op not in ('in', 'number'):
                x = [new[i] for i in a[:OPERANDS.get(op, 1)] if type(i) is int and 0 <= i < j]
                if len(x) != OPERANDS.get(op, 1) or len(a) != len(x) + (op in ('pow', 'stumpff', 'dexpinv')): raise ValueError(f'operands of entry {j}')
            if op == 'in' and not (type(a[0]) is int and 0 <= a[0] < inputs): raise ValueError(f'input of entry {j}')
            if op == 'number' and not math.isfinite(a[0]): raise ValueError(f'number of entry {j}')
            if op == 'in' or op == 'number': r = put(op, a[0] if op == 'in' else float(a[0]))
            elif op == 'pow' and a[1] == 0: r = put('number', 1.)
            elif op == 'pow' and a[1] == int(a[1]):
                r, b, q = None, x[0], int(abs(a[1]))
                while q:
                    if q & 1: r = b if r is None else put('mul', r, b)
                    q >>= 1; b = put('mul', b, b) if q else b
                if a[1] < 0: r = put('div', put('number', 1.), r)
            elif op == 'pow': r = put('exp', put('mul', put('number', float(a[1])), put('log', x[0])))
            elif op == 'sigmoid': h = put('number', .5); r = put('add', h, put('mul', h, put('tanh', put('mul', h, x[0]))))
            elif op == 'sign': z = put('number', 0.); r = put('sub', put('ge', x[0], z), put('ge', z, x[0]))
            elif op in OPS: r = put(op, *x)
            else: raise Refused(f'the checker has no {op}')
            new.append(r)
        s.outputs = [new[i] for i in what['outputs']]
    def coefficients(s, k, ins, C):   # of all entries; C: [coefficients, second series, flags]. 2: smooth, 1: kinks, 0: nothing
        zero = [None] * len(ins[0][0])
        for j, (op, *a) in enumerate(s.code):
            if k == 0: C.append([[], [], 2])
            if op in ('in', 'number'):
                C[j][0].append((ins[a[0]][k] if k < len(ins[a[0]]) else zero) if op == 'in' else zero if k or a[0] == 0 else [I(a[0])] + zero[1:]); continue
            x = [C[i][0] for i in a]; C[j][0].append(OPS[op](k, x, C[j][0], C[j][1]))
            if k == 0: C[j][2] = s.flag(op, x, [C[i][2] for i in a])
        return [C[i][0][k] for i in s.outputs]
    @staticmethod
    def flag(op, x, f):
        v = [full(i[0][0]) for i in x]; low = np.minimum.reduce(np.broadcast_arrays(*f)) if len(f) > 1 else f[0]
        if op in ('log', 'sqrt'): return np.where(v[0].l > 0, low, 0)
        if op == 'div': return np.where((v[1].l > 0) | (v[1].h < 0), low, 0)
        if op == 'atan2': return np.where((v[1].l > 0) | (v[0].l > 0) | (v[0].h < 0), low, 0)
        if op == 'abs': return np.where((v[0].l > 0) | (v[0].h < 0), low, np.minimum(low, 1))
        if op == 'max' or op == 'ge': return np.where(larger(x[0][0], x[1][0]) | larger(x[1][0], x[0][0]), low, np.minimum(low, op == 'max'))
        if op == 'select':
            t, e = (v[0].l > 0) | (v[0].h < 0), (v[0].l == 0) & (v[0].h == 0)
            return np.where(t, np.minimum(f[0], f[1]), np.where(e, np.minimum(f[0], f[2]), 0))
        return low
    def value(s, x):   # outputs [[value, slopes...], ...] and their flag
        C = []; r = s.coefficients(0, [[v] for v in x], C); return r, np.minimum.reduce(np.broadcast_arrays(*[C[i][2] for i in s.outputs])) if r else 2
    def exact(s, x):   # outputs in whole fractions; None where the value is no fraction that is known
        r = []
        for op, *a in s.code:
            v = [r[i] for i in a] if op not in ('in', 'number') else []; some = None not in v
            if op == 'in': q = x[a[0]]
            elif op == 'number': q = Fraction(a[0])
            elif op == 'mul': q = Fraction(0) if 0 in v else v[0] * v[1] if some else None
            elif op == 'select': q = None if v[0] is None else v[1] if v[0] else v[2]
            elif op == 'div': q = v[0] / v[1] if some and v[1] else None
            elif not some: q = None
            elif op in ('add', 'sub', 'neg', 'max', 'abs', 'ge'):
                q = {'add': sum, 'sub': lambda v: v[0] - v[1], 'neg': lambda v: -v[0], 'max': max, 'abs': lambda v: abs(v[0]), 'ge': lambda v: Fraction(v[0] >= v[1])}[op](v)
            elif op == 'atan2': q = Fraction(0) if v[0] == 0 and v[1] > 0 else None
            elif op == 'log': q = Fraction(0) if v[0] == 1 else None
            elif op == 'sqrt': q = v[0] if v[0] in (0, 1) else None
            else: q = Fraction(op in ('exp', 'cos')) if v[0] == 0 else None
            r.append(q)
        return [r[i] for i in s.outputs]
def contains(y, w): return (w is None and y is None) | (full(y).l <= full(w).l) & (full(w).h <= full(y).h)
def tube(rate, x, u, h, known=None):   # x, u: lists [value, slopes...]; known: the tube of the values
    n, first, y, inside, f = len(x), 1 if known else 0, x, False, 0
    if known: y = [[z] + r[1:] for z, r in zip(known, x)]
    for t in range(12):
        C = []; f = rate.coefficients(0, [[p] for p in y + u], C)
        w = [dadd(a, dscale(I(0., h), b)) for a, b in zip(x, f)]
        if t: inside = np.logical_and.reduce(np.broadcast_arrays(*[contains(p, q) for a, b in zip(y, w) for p, q in zip(a[first:], b[first:])]))
        if np.all(inside): break
        def grow(p, q, start):
            if q is None: return None
            s, p = full(start), full(p); d = .2 * 2 ** max(0, t - 2) * (np.maximum(s.l - q.l, 0) + np.maximum(q.h - s.h, 0)) + 1e-13 * q.size()
            return I(np.where(inside, p.l, q.l - d), np.where(inside, p.h, q.h + d))
        y = [(a[:1] if known else []) + [grow(p, q, r) for p, q, r in zip(a[first:], b[first:], c[first:])] for a, b, c in zip(y, w, x)]
    flag = np.minimum.reduce(np.broadcast_arrays(*[C[i][2] for i in rate.outputs]))
    return [(a[:1] if known else []) + b[first:] for a, b in zip(y, w)], np.where(inside, flag, 0)
def step(rate, x, u, h, p, slopes):   # x(t) - x(0), and its slopes by (x(0), u), for t in [0, h], as a function of t; its flag
    n, one = len(x), I(1.)
    def lists(v): return [[q] + ([one if i == j else None for j in range(len(v))] if slopes else []) for i, q in enumerate(v)]
    start = lists(x + u); X, W = start[:n], start[n:]
    Z, flag = tube(rate, [[v] for v in x], [[v] for v in u], h); values = [z[0] for z in Z]
    if slopes: Z, f = tube(rate, X, W, h, values); flag = np.minimum(flag, f)
    def series(X, order):
        C, xs = [], [[v] for v in X]
        for k in range(order):
            for q, v in zip(xs, rate.coefficients(k, xs + [[w] for w in W], C)): q.append(dover(v, k + 1))
        return xs
    A, B = series(X, p - 1), series(Z, p); kinks = bool(np.any(flag == 1)) or p < 2
    if kinks:   # x'' = f_x f by one slope along f
        f = rate.value(values + u)[0]; C = []
        G = rate.coefficients(0, [[[z, q[0]]] for z, q in zip(values, f)] + [[[v, None]] for v in u], C)
        low = [series(X, 1), series(Z, 1), G]
    def at(t):
        r = []
        for i in range(n):
            c = B[i][p]
            for k in range(p - 1, 0, -1): c = dadd(A[i][k], dscale(t, c))
            c = dscale(t, c)
            if kinks:
                v = mul(t, add(low[0][i][1][0], mul(t, mul(I(.5), low[2][i][1])))); e = [v] + dscale(t, low[1][i][1][1:])
                c = pick(flag == 2, flag < 2, c, e) if p > 1 else e
            r.append(c)
        return r
    return at, values, flag
def matmul(a, b): return [[total(mul(r[k], b[k][j]) for k in range(len(b))) for j in range(len(b[0]))] for r in a]
def plus(a, b): return [[add(p, q) for p, q in zip(r, s)] for r, s in zip(a, b)]
def turn(a): return [list(r) for r in zip(*a)]
def definite(a):   # every symmetric matrix in the interval matrix is positive definite
    a = [[full(v) for v in r] for r in a]; ok = True
    for j in range(len(a)):
        ok = ok & (a[j][j].l > 0)
        for i in range(j + 1, len(a)):
            f = a[i][j] / a[j][j]
            for k in range(j + 1, i + 1): a[i][k] = a[i][k] - f * a[k][j]; a[k][i] = a[i][k]
    return ok
class Proof:
    def __init__(s, c, texts):
        n, m = s.n, s.m = c['states'], c['inputs']; p = c['proof']; s.c = c
        def numbers(v, rows, columns=None):
            if len(v) != rows or columns and any(len(r) != columns for r in v): raise ValueError('a list has the wrong length')
            for q in v if not columns else [q for r in v for q in r]:
                if type(q) not in (int, float) or not math.isfinite(q): raise ValueError('a number is missing')
            return v
        if c['format'] != 'liegrad certificate' or c['version'] != 1: raise ValueError('another format or version')
        if c.get('stored', 0): raise Refused('the checker knows no stored inputs')
        for part, of in (('rate', 'plant'), ('control', 'controller')):
            if hashlib.sha256(texts[part].encode()).hexdigest() != c[of]['sha256']: raise Refused(f'the hash of "{part}" differs from that of "{of}"')
        s.rate, s.control = Program(c['rate'], n + m, n), Program(c['control'], n, m)
        s.held = {'held': True, 'continuous': False}[c['loop']]; s.goal = numbers(c['goal'], n); s.near = numbers(p['near'], n)
        s.level, s.eps = numbers([c['level'], c['eps']], 2); s.error = numbers(c.get('error') or [0.] * n, n)
        s.between = c.get('between') if s.held else None; s.converges = c['converges']; s.low, s.high = numbers(p['low'], n), numbers(p['high'], n)
        P, T = numbers(c['P'], n, n), numbers(p['T'], n, n); s.P, s.T = [[I(float(v)) for v in r] for r in P], [[I(float(v)) if v else None for v in r] for r in T]
        s.order, s.steps = (p['order'], p['steps']) if s.held else (1, 1)
        if s.held: s.h = numbers([c['period']], 1)[0] / s.steps
        if s.held and not (s.h > 0 and s.steps in [2 ** i for i in range(20)] and 1 <= s.order <= 20): raise ValueError('period, steps or order')
        if P != turn(P) or min(s.error) < 0 or not 0 < s.eps < s.level: raise Refused('P is not symmetric, an error is negative or the level is not above eps')
        if s.between is not None: numbers([s.between], 1)
        PT = matmul(s.P, s.T); s.Q = matmul(turn(s.T), PT); s.wide = [j for j in range(n) if s.error[j] > 0]
        s.PT2 = [[mul(I(2.), v) for v in r] + [None] * len(s.wide) for r in PT]
        bounds = [(min(g - l if l is not None else math.inf, h - g if h is not None else math.inf)) for l, g, h in zip(c['low'], s.goal, c['high'])]
        s.within('the box of states', s.P, s.level, [b if b == math.inf else math.nextafter(b, 0) for b in bounds])
        s.within('the root box', s.Q, s.level, [h if p['even'] and i == 0 and l <= 0 else min(-l, h) for i, (l, h) in enumerate(zip(s.low, s.high))])
        s.within('N', s.Q, s.eps, s.near)
    def within(s, what, Q, level, bounds):   # {y.Q y <= level} in |y_i| <= b_i: Q - (level/b_i^2) e_i e_i' is positive definite, and Q is
        for i, b in [(None, math.inf)] + list(enumerate(bounds)):
            if b == math.inf and i is not None: continue
            M = [list(r) for r in Q]
            if i is not None: M[i][i] = M[i][i] - I(level) / I(b).square() if b > 0 else I(-1.)
            if not np.all(definite(M)): raise Refused(f'P is not positive definite' if i is None else f'{{V <= {level:g}}} is not in {what}: component {i + 1}')
    def change(s, D, E, m):   # D, E as above, E by y and by errors: bound without the matrix, slopes by k, matrix
        P, PD, sums = s.P, [total(mul(p, d) for p, d in zip(r, D)) for r in s.P], s.held
        PS = [add(total(mul(p, y) for p, y in zip(r, m)), q if sums else None) for r, q in zip(s.PT2, PD)]
        both = [add(p, q) if sums else p for p, q in zip(PS, PD)]; Et, G = turn(E), turn(s.PT2)
        first = total(mul(d, p) for d, p in zip(D, PS)); g = [add(total(mul(a, b) for a, b in zip(e, both)), total(mul(a, b) for a, b in zip(q, D))) for e, q in zip(Et, G)]
        return full(first), g, matmul(Et, plus(s.PT2, matmul(P, E)) if sums else s.PT2)
    def bound(s, first, g, M, r):   # of first + g.k + k.M k, |k_i| <= r_i, from above
        t = first
        for i, a in enumerate(g):
            a, q = I(full(a).size()), I(np.minimum(full(M[i][i]).h, 0.)); line = a * r[i]; c = -q
            top, turned = line + I(full(M[i][i]).h) * r[i].square(), a.square() / (c * I(4.))
            t = t + I(np.where((q.l < 0) & (a.h < 2 * c.l * r[i].l), turned.h, top.h))
            for j in range(i):
                v = add(M[i][j], M[j][i])
                if v is not None: t = t + I(v.size()) * r[i] * r[j]
        return t.h
    def examine(s, lo, hi, steps, near):
        """Which boxes of y are proved, have a tube and are refuted (an interval of V's change at the middle above 0). near: the change is x.H x, H < 0."""
        n, N = s.n, len(lo[0]); m = [I(.5 * (a + b)) for a, b in zip(lo, hi)]; Y = [I(a, b) for a, b in zip(lo, hi)]
        r = [I(np.maximum((I(b) - c).h, (c - I(a)).h)) for a, b, c in zip(lo, hi, m)]; k = [I(-q.h, q.h) for q in r]
        def states(y): return [add(I(np.full(N, float(g))), total(mul(t, q) for t, q in zip(row, y))) for g, row in zip(s.goal, s.T)]
        V = full(total(mul(s.Q[i][j], Y[i].square() if i == j else Y[i] * Y[j]) for i in range(n) for j in range(n)))
        Vm = full(total(mul(s.Q[i][j], m[i] * m[j]) for i in range(n) for j in range(n))); start = np.minimum(V.h, s.level)
        xm, X = states(m), states(Y); one = I(1.); error = [I(float(s.error[j])) for j in s.wide]
        um = [full(v[0]) for v in s.control.value([[v] for v in xm])[0]] if s.m else []
        C = []; K = s.control.coefficients(0, [[[v] + row] for v, row in zip(X, s.T)], C)
        ok = np.minimum.reduce(np.broadcast_arrays(2, *[C[i][2] for i in s.control.outputs]))   # K: slopes by y
        U = [cap(full(q[0]), full(add(v, total(mul(a, b) for a, b in zip(q[1:], k))))) for q, v in zip(K, um)]; K = [q[1:] for q in K]
        extra = [[one if i == j else None for j in s.wide] for i in range(n)]; good = np.full(N, True)
        def judge(D, E): return s.change(D, [a + b for a, b in zip(E, extra)], m)
        if not s.held:
            D = [v[0] for v in s.rate.value([[v] for v in xm + um])[0]]; C = []
            D0 = s.rate.coefficients(0, [[[v] + t] for v, t in zip(X, s.T)] + [[[v] + t] for v, t in zip(U, K)], C)
            ok = np.minimum.reduce(np.broadcast_arrays(ok, *[C[i][2] for i in s.rate.outputs])); E = [q[1:] for q in D0]
        else:
            h, F, sums, E = s.h * s.steps / steps, xm, [None] * n, [[None] * n for _ in range(n)]   # E by y: (J - 1) T
            for i in range(steps):
                now, _, f = step(s.rate, F, um, h, s.order, False); box, Z, g = step(s.rate, X, U, h, s.order, True); ok = np.minimum.reduce(np.broadcast_arrays(ok, f, g))
                def moved(t):
                    B = box(t); J = [q[1:n + 1] for q in B]
                    return [add(a, b[0]) for a, b in zip(sums, now(t))], plus(E, plus(matmul(J, plus(s.T, E)), matmul([q[n + 1:] for q in B], K))) if s.m else plus(E, matmul(J, plus(s.T, E))), B
                if s.between is not None:
                    parts, inside = 1, False
                    while parts <= 16 and not np.all(inside | (ok == 0)):
                        inside = np.full(N, True)
                        for q in range(parts):
                            D, A, _ = moved(I(h / parts * q, h / parts * (q + 1))); rise = s.bound(*judge(D, A), r + error)
                            inside &= (I(start) + I(np.where(rise > 0, rise, np.where(rise <= 0, 0., np.nan)))).h <= s.between
                        parts *= 2
                    good &= inside
                sums, A, B = moved(I(h)); E = A; F = [full(add(a, b)) for a, b in zip(xm, sums)]
                X = [cap(full(add(a, b[0])), full(add(c, total(mul(q, v) for q, v in zip(plus([t], [e])[0], k))))) for a, b, c, t, e in zip(X, B, F, s.T, E)]
            D = sums
        first, g, M = judge(D, E)
        if near: fall = definite([[neg(add(M[i][j], M[j][i])) for j in range(n)] for i in range(n)])
        else:
            rise = s.bound(first, g, M, r + error); fall = rise < 0
            if not s.converges: fall |= (V.h < s.eps) & ((I(start) + I(rise)).h <= s.level)
        ok = np.broadcast_to(ok, N) > 0
        return ok & good & fall, ok, (first.l > 0) & (Vm.h <= s.level) & (Vm.l >= s.eps) & ~near
    def sweep(s, lo, hi, steps, near=False):   # proves boxes of y (arrays of n rows), halves where it must
        todo = [(lo[:, i:i + BATCH], hi[:, i:i + BATCH], steps, 0) for i in range(0, len(lo[0]), BATCH)]
        while todo:
            lo, hi, steps, depth = todo.pop(); s.count += len(lo[0])
            if not near:
                Y = [I(a, b) for a, b in zip(lo, hi)]; V = full(total(mul(s.Q[i][j], Y[i].square() if i == j else Y[i] * Y[j]) for i in range(s.n) for j in range(s.n)))
                inside = ~np.logical_and.reduce([(-b <= a) & (c <= b) for a, c, b in zip(lo, hi, s.near)]) if s.converges else np.full(len(lo[0]), True)
                rest = ~(V.l > s.level) & inside; lo, hi = lo[:, rest], hi[:, rest]
            if not len(lo[0]): continue
            done, ok, refuted = s.examine(lo, hi, steps, near); bad = ~done
            for at in (np.flatnonzero(refuted), np.flatnonzero(bad) if depth == HALVINGS else []):
                if len(at): raise Refused(('V rises at the middle of the box ' if refuted.any() else 'no proof near the goal in the box ' if near else 'no proof in the box ')
                                          + 'y = ' + ' x '.join(f'[{a:.9g}, {b:.9g}]' for a, b in zip(lo[:, at[0]], hi[:, at[0]])))
            for some, more in ((bad & ok, steps), (bad & ~ok, 2 * steps)):
                if not some.any(): continue
                l, h = lo[:, some], hi[:, some]; j, c = np.argmax(h - l, axis=0), np.arange(len(l[0])); mid = .5 * l[j, c] + .5 * h[j, c]; l2, h2 = l.copy(), h.copy(); h2[j, c], l2[j, c] = mid, mid
                l, h = np.hstack([l, l2]), np.hstack([h2, h]); todo += [(l[:, i:i + BATCH], h[:, i:i + BATCH], more, depth + 1) for i in range(0, len(l[0]), BATCH)]
    def prove(s):
        p, s.count, seen = s.c['proof'], 0, 0; near = np.array(s.near, float)[:, None]
        if s.converges:
            if any(s.error): raise Refused('with an error of the model nothing converges to the goal')
            goal = [Fraction(v) for v in s.goal]; u = s.control.exact(goal)
            if any(v != 0 for v in s.rate.exact(goal + u)): raise Refused('the goal is no exact equilibrium')
            s.sweep(-near, near, s.steps, True)
        lo, hi = np.array([[float(v)] for v in s.low]), np.array([[float(v)] for v in s.high])
        for text in p['tree']:
            code = np.array(list(text)); seen += len(code)
            if len(code) != len(lo[0]): raise Refused('the tree has boxes that do not fit')
            for leaf in sorted(set(text)):
                some = code == leaf
                if leaf in 'on01234': steps = s.steps * 2 ** int(leaf if leaf in '01234' else 0)
                elif not 0 <= ord(leaf) - 97 < s.n: raise Refused(f'the tree has a letter "{leaf}"')
                else: continue
                s.sweep(lo[:, some], hi[:, some], steps)
                if p['even']: s.sweep(-hi[:, some], -lo[:, some], steps)
            some = np.isin(code, list('on01234'), invert=True); l, h = lo[:, some], hi[:, some]; j = np.array([ord(q) - 97 for q in code[some]], int)
            c = np.arange(len(j)); mid = .5 * l[j, c] + .5 * h[j, c]; l2, h2 = l.copy(), h.copy(); h2[j, c], l2[j, c] = mid, mid; lo, hi = np.hstack([l, l2]), np.hstack([h2, h])
        if len(lo[0]): raise Refused('the tree ends before its boxes')
        if seen != p['boxes']: raise Refused('the tree has another number of boxes')
def members(text):   # the texts of the members of an object
    d, i, r = json.JSONDecoder(), text.index('{') + 1, {}
    while True:
        while text[i] in ' \t\r\n,': i += 1
        if text[i] == '}': return r
        key, i = d.raw_decode(text, i); i = text.index(':', i) + 1
        while text[i] in ' \t\r\n': i += 1
        if key in r: raise ValueError(f'"{key}" is there twice')
        _, e = d.raw_decode(text, i); r[key] = text[i:e]; i = e
def main(names):
    worst = 0
    for name in names:
        begin = time.time()
        try:
            with open(name, encoding='utf-8') as f: text = f.read()
            c = json.loads(text); s = Proof(c, members(text)); s.prove()
            print(f'PROVED {name}: level {s.level:.17g}, {s.count} boxes, {time.time() - begin:.1f} s', flush=True)
        except Refused as e: print(f'NOT PROVED {name}: {e}', flush=True); worst = max(worst, 1)
        except (OSError, ValueError, KeyError, TypeError, IndexError) as e: print(f'{name} is no certificate: {type(e).__name__} {e}', flush=True); worst = 3
    return worst
if __name__ == '__main__': sys.exit(main(sys.argv[1:]))
