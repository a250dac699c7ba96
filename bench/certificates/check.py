#!/usr/bin/env python3
"""Proves the claim of a certificate again, from the file alone, without liegrad; it trusts no label of a box.

usage: check.py CERTIFICATE...        exit code 0: all are proved, 1: one is not, 3: one is no certificate

A box without a proof is halved, at most HALVINGS times. A box holds y of states x = goal + T y; m: its middle, k = y - m.
  held        F = x(period) from the middle, J = dx(period)/dy over the box; D = F - x(m), E = J - T, s = 1
  continuous  F = x' at the middle, J = dx'/dy over the box; D = F, E = J, s = 0
V(x(period)) - V(x), or V', is (D + E k).P (2 T m + s D + (2 T + s E) k) for a matrix in the interval matrix E, which
contains all slopes, also those of kinks. Errors of the model are further columns: 1 of E, 0 of T.
Flow: motions stay in Z for a time h if Z contains X + [0, h] f(Z) (Picard); so do their slopes. x(h) is a Taylor
polynomial whose last coefficient is taken over Z; with a kink of f in Z the last one is x'', that of slopes the first.
Sums, products and quotients are IEEE operations, moved outward; other functions are balls of 90 bits (flint, or mpmath
with an error of 2^-80). A bound NaN means that nothing is known: comparisons with it are false."""
import hashlib, json, math, sys, time
import numpy as np
try:
    import flint
    flint.ctx.prec = 90
except ImportError:
    import mpmath
    flint, mpmath.mp.prec = None, 90
np.seterr(all='ignore')
U, TINY, BATCH, HALVINGS = 2.0 ** -52, 1e-300, 4096, 12
class Refused(Exception): pass
class I:   # arrays of intervals. [value, slopes] x boxes: a value with its slopes; rows x columns x boxes: matrices
    def __init__(s, l, h=None): s.l = np.asarray(l, float); s.h = s.l if h is None else np.asarray(h, float)
    def __getitem__(s, i): return I(s.l[i]) if s.l is s.h else I(s.l[i], s.h[i])
    def zero(s): return s.l.shape[-1:] == (1,) and not (s.l.any() or s.h.any())
    def __add__(s, o):   # sums below 1e-300 are exact
        if s.zero() and s.l.ndim == o.l.ndim: return o
        if o.zero() and s.l.ndim == o.l.ndim: return s
        l, h = s.l + o.l, s.h + o.h
        return I(l - abs(l) * U, h + abs(h) * U)
    def __neg__(s): return I(-s.l) if s.l is s.h else I(-s.h, -s.l)
    def __sub__(s, o): return s + -o
    def corners(s, o, f):
        p = [f(a, b) for a in ([s.l] if s.l is s.h else [s.l, s.h]) for b in ([o.l] if o.l is o.h else [o.l, o.h])]
        l = h = p[0]
        for q in p[1:]: l, h = np.minimum(l, q), np.maximum(h, q)
        e = TINY * (((s.l != 0) | (s.h != 0)) & ((o.l != 0) | (o.h != 0)))   # underflow; 0 x stays 0
        return I(l - (abs(l) * U + e), h + (abs(h) * U + e))
    def __mul__(s, o):
        for a, b in ((s, o), (o, s)):
            if a.zero(): return I(np.zeros(np.broadcast_shapes(a.l.shape, b.l.shape[:-1] + (1,) * (b.l.ndim > 0))))
        return s.corners(o, np.multiply)
    def __truediv__(s, o):
        r, ok = s.corners(o, np.divide), (o.l > 0) | (o.h < 0)
        return I(np.where(ok, r.l, np.nan), np.where(ok, r.h, np.nan))
    def __matmul__(s, o):
        r = I(np.zeros((len(s.l), o.l.shape[1], 1)))
        for k in range(len(o.l)): r = r + s[:, k:k + 1] * o[k:k + 1]
        return r
    def turn(s): return I(s.l.swapaxes(0, 1), s.h.swapaxes(0, 1))
    def size(s): return I(np.maximum(-s.l, s.h))
    def square(s):
        a, r = np.where((s.l <= 0) & (s.h >= 0), 0, np.minimum(abs(s.l), abs(s.h))), s.size()
        r = I(a, r.h) * I(a, r.h)
        return I(np.maximum(r.l, 0), r.h)
def cap(a, b): return I(np.fmax(a.l, b.l), np.fmin(a.h, b.h))
def join(*parts, axis=-2):
    boxes = max(p.l.shape[-1] for p in parts)
    wide = [[np.broadcast_to(a, a.shape[:-1] + (boxes,)) for a in (p.l, p.h)] for p in parts]
    return I(np.concatenate([w[0] for w in wide], axis), np.concatenate([w[1] for w in wide], axis))
def pick(t, f, a, b):   # a where t, b where f, else both
    return I(*[np.where(t, p, np.where(f, q, g(p, q))) for p, q, g in ((a.l, b.l, np.minimum), (a.h, b.h, np.maximum))])
def ball(name, *x):   # a function at a point: a float and its error, 0 where it is exact: sin 0 = 0
    try:
        if flint:
            v = getattr(flint.arb(x[0]), name)(*map(flint.arb, x[1:]))
            m, r = float(v.mid()), float(v.rad())
        else:
            m = float(getattr(mpmath, name)(*map(mpmath.mpf, x)))
            r = 0 if x[0] == (name == 'log') and x[-1] >= 0 else abs(m) * 2 ** -80
        return m, 0 if r == 0 and m in (0, 1) else 4 * U * abs(m) + TINY if r <= abs(m) * 2 ** -60 + TINY / 4 else math.nan
    except (ValueError, OverflowError, TypeError, ZeroDivisionError): return math.nan, math.nan
def points(name, *x):
    r = np.array([ball(name, *t) for t in zip(*[a.ravel().tolist() for a in x])]).reshape(x[0].shape + (2,))
    return I(r[..., 0] - r[..., 1], r[..., 0] + r[..., 1])
def ends(name, x):
    a = points(name, x.l)
    return (a, a) if x.l is x.h else (a, points(name, x.h))
def monotone(name, x):
    a, b = ends(name, x)
    return I(a.l, b.h)
PI = I(math.pi, math.nextafter(math.pi, 4))
def trig(name, x):
    (a, b), q = ends(name, x), (x - PI * I(.5) if name == 'sin' else x) / PI   # extrema are at whole numbers q
    first, last = np.ceil(q.l), np.floor(q.h)
    both, one = (last > first) | ~(x.size().h < 1e15), last >= first
    return I(np.where(both | one & (first % 2 != 0), -1, np.maximum(-1, np.minimum(a.l, b.l))),
             np.where(both | one & (first % 2 == 0), 1, np.minimum(1, np.maximum(a.h, b.h))))
# Operations: coefficient k in time from the operands' coefficients x, the earlier ones y and those of the slope, z
def chain(x, value, slope): return join(value, slope * x[1:]) if len(x.l) > 1 else value
def dmul(a, b): r = a[:1] * b; return r if len(r.l) < 2 else join(r[:1], r[1:] + a[1:] * b[:1])
def ddiv(a, b): v = a[:1] / b[:1]; return v if len(a.l) < 2 else join(v, (a[1:] - v * b[1:]) / b[:1])
def conv(a, b, k, low=0, high=None):   # sum of a_i b_(k - i)
    return sum((dmul(a[i], b[k - i]) for i in range(low, k + 1 if high is None else high)), I(np.zeros((len(b[0].l), 1))))
def rate_of(a, b, k): return conv([q * I(i) for i, q in enumerate(a[:k + 1])], b, k, 1) / I(k)   # coefficient k of int a' b
def op_mul(k, x, y, z):
    if k or x[0] is not x[1]: return conv(x[0], x[1], k)
    return chain(x[0][0], x[0][0][:1].square(), x[0][0][:1] * I(2))
def op_atan2(k, x, y, z):   # z = a^2 + b^2; angle of the point (b, a)
    a, b = x
    z.append(op_mul(k, [a, a], y, z) + op_mul(k, [b, b], y, z))
    if k: return ddiv(rate_of(a, b, k) - rate_of(b, a, k) - rate_of(y + [z[0] * I(0)], z, k), z[0])
    a, b = a[0], b[0]
    c = [points('atan2', *np.broadcast_arrays(s[:1], t[:1])) for s in (a.l, a.h) for t in (b.l, b.h)]
    v = I(np.minimum.reduce([q.l for q in c]), np.maximum.reduce([q.h for q in c]))
    return v if len(a.l) < 2 else join(v, (b[:1] * a[1:] - a[:1] * b[1:]) / z[0][:1])
def larger(a, b): return a[0].l[0] > b[0].h[0]
def op_max(k, x, y, z):
    (a, b), r = x, pick(larger(*x), larger(*x[::-1]), x[0][k], x[1][k])
    return r if k else join(I(np.maximum(a[0].l, b[0].l)[:1], np.maximum(a[0].h, b[0].h)[:1]), r[1:])
def op_ge(k, x, y, z):
    v = I(np.where(larger(*x), 1, 0), np.where(larger(*x[::-1]), 0, 1))[None]
    return x[0][k] * I(0) if k else join(v, x[0][0][1:] * I(0))
def op_select(k, x, y, z):
    return pick((x[0][0].l[0] > 0) | (x[0][0].h[0] < 0), (x[0][0].l[0] == 0) & (x[0][0].h[0] == 0), x[1][k], x[2][k])
def function(values, later):   # values: y, slope z and its slope; later: z_k
    def op(k, x, y, z):
        v = None if k else values(x[0][0][:1])
        r = rate_of(x[0], z, k) if k else chain(x[0][0], *v[:2])
        z.append(later(k, x[0], y + [r], z) if k else chain(x[0][0], *v[1:]))
        return r
    return op
def of_exp(v): e = monotone('exp', v); return e, e, e
def of_log(v): return monotone('log', v), I(1) / v, -(I(1) / v.square())
def of_sin(v): s, c = trig('sin', v), trig('cos', v); return s, c, -s
def of_cos(v): s, c = trig('sin', v), trig('cos', v); return c, -s, -c
def of_tanh(v): t = cap(monotone('tanh', v), I(-1, 1)); w = I(1) - t.square(); return t, w, t * w * I(-2)
def turning(k, x, y, z): return -rate_of(x, y, k)
OPS = {'add': lambda k, x, y, z: x[0][k] + x[1][k], 'neg': lambda k, x, y, z: -x[0][k], 'mul': op_mul,
       'div': lambda k, x, y, z: ddiv(x[0][k] - conv(y, x[1], k, 0, k), x[1][0]),
       'exp': function(of_exp, lambda k, x, y, z: y[k]), 'sin': function(of_sin, turning), 'cos': function(of_cos, turning),
       'log': function(of_log, lambda k, x, y, z: ddiv(-conv(z, x, k, 0, k), x[0])), 'atan2': op_atan2, 'max': op_max,
       'tanh': function(of_tanh, lambda k, x, y, z: -conv(y, y, k)), 'ge': op_ge, 'select': op_select}
COUNT = {'in': 0, 'number': 0, 'select': 3, **{n: 2 for n in ('add', 'sub', 'mul', 'div', 'atan2', 'max', 'ge')}}
# Where an operation is smooth, from the bounds of its operands; elsewhere max has a kink and the others have no slope
SMOOTH = {'log': lambda l, h: l[0] > 0, 'div': lambda l, h: (l[1] > 0) | (h[1] < 0),
          'atan2': lambda l, h: (l[1] > 0) | (l[0] > 0) | (h[0] < 0),
          **{n: lambda l, h: (l[0] > h[1]) | (l[1] > h[0]) for n in ('max', 'ge')}}
class Program:
    def __init__(s, what, inputs, outputs):
        s.code, new = [], []
        def put(*e): s.code.append(e); return len(s.code) - 1
        if what['inputs'] != inputs or len(what['outputs']) != outputs: raise ValueError('inputs or outputs')
        for j, (op, *a) in enumerate(what['code']):
            n = COUNT.get(op, 1)
            if len(a) != n + (op in ('in', 'number', 'pow')) or not all(type(i) is int and 0 <= i < j for i in a[:n]) \
                    or op == 'in' and a[0] not in range(inputs) or not all(map(math.isfinite, a)): raise ValueError(f'entry {j}')
            x = [new[i] for i in a[:n]]
            if op == 'sqrt': op, a = 'pow', [0, .5]
            if n == 0 or op in OPS: r = put(op, *(x or a))
            elif op == 'sub': r = put('add', x[0], put('neg', x[1]))
            elif op == 'abs': r = put('max', put('max', x[0], put('neg', x[0])), put('number', 0))
            elif op == 'sign': r = put('number', 0); r = put('add', put('ge', x[0], r), put('neg', put('ge', r, x[0])))
            elif op == 'sigmoid': r = put('number', .5); r = put('add', r, put('mul', r, put('tanh', put('mul', r, x[0]))))
            elif op == 'pow' and a[1] in range(-32, 33):
                r = x[0] if a[1] else put('number', 1)
                for i in range(int(abs(a[1])) - 1): r = put('mul', x[0], r)
                if a[1] < 0: r = put('div', put('number', 1), r)
            elif op == 'pow': r = put('exp', put('mul', put('number', a[1]), put('log', x[0])))
            else: raise Refused(f'the checker has no operation {op}')
            new.append(r)
        s.outputs = [new[i] for i in what['outputs']]
    def coefficients(s, k, xs, u, C):   # of the outputs; C: for each entry its coefficients, its slope's and its flag
        rows = xs[0].l.shape[1]
        for j, (op, *a) in enumerate(s.code):
            if k == 0: C.append([[], [], 2])
            x = [C[i] for i in a] if op in OPS else []
            if op == 'number': r = join(I([[0 if k else a[0]]]), I(np.zeros((rows - 1, 1))))
            elif op == 'in': r = xs[k][a[0]] if a[0] < len(xs[k].l) else u[a[0] - len(xs[k].l)] * I(k == 0)
            else: r = OPS[op](k, [c[0] for c in x], C[j][0], C[j][1])
            C[j][0].append(r)
            if x and k == 0: C[j][2] = s.flag(op, [c[0][0][0] for c in x], [c[2] for c in x])
        return join(*[C[i][0][k][None] for i in s.outputs], axis=0) if s.outputs else I(np.zeros((0, rows, 1)))
    @staticmethod
    def flag(op, v, f):   # 2: smooth on the box, 1: with kinks, 0: not Lipschitz or not defined
        low, l, h = np.minimum.reduce(np.broadcast_arrays(*f, 2)), [q.l for q in v], [q.h for q in v]
        if op == 'select':
            no = np.where((l[0] == 0) & (h[0] == 0), np.minimum(f[0], f[2]), 0)
            return np.where((l[0] > 0) | (h[0] < 0), np.minimum(f[0], f[1]), no)
        return np.where(SMOOTH[op](l, h), low, np.minimum(low, op == 'max')) if op in SMOOTH else low
    def value(s, x, u):
        C = []
        r = s.coefficients(0, [x], u, C)
        return r, np.minimum.reduce(np.broadcast_arrays(2, *[C[i][2] for i in s.outputs]))
def tube(rate, x, u, h, known=None):   # with slopes: the tube of values is known
    first, y = int(known is not None), x
    if first: y = join(known, x[:, 1:])
    for t in range(12):
        f, flag = rate.value(y, u)
        w = x + I(0, h) * f
        inside = ((y.l <= w.l) & (w.h <= y.h))[:, first:].all((0, 1))
        if t and inside.all(): break
        d = .2 * 2 ** max(0, t - 2) * (np.maximum(x.l - w.l, 0) + np.maximum(w.h - x.h, 0)) + 1e-13 * w.size().h
        y = I(np.where(inside, y.l, w.l - d), np.where(inside, y.h, w.h + d))
        if first: y = join(known, y[:, 1:])
    return (join(known, w[:, 1:]) if first else w), np.where(inside, flag, 0)
def series(rate, x, u, order):
    C, xs = [], [x]
    for k in range(order): xs.append(rate.coefficients(k, xs, u, C) / I(k + 1))
    return xs
def step(rate, x, u, h, p, slopes):   # (x(t) - x(0))/t with its slopes by x(0) and u, a function of t in [0, h]; its flag
    n, size = len(x.l), len(x.l) + len(u.l)
    z, flag = tube(rate, x, u, h)
    X, W, values = x, u, z
    if slopes:
        one = I(np.eye(size)[:, :, None])
        X, W = join(x, one[:n]), join(u, one[n:])
        z, f = tube(rate, X, W, h, values)
        flag = np.minimum(flag, f)
    A, B = series(rate, X, W, p - 1), series(rate, z, W, p)
    if p < 2 or (flag == 1).any():
        f = rate.value(values, u)[0]
        second = rate.value(join(values, f), join(u, u * I(0)))[0][:, 1:]   # x'' = f_x f, by one slope along f
        low, first = rate.value(x, u)[0], rate.value(z, W)[0][:, 1:]
    def at(t):
        c = B[p]
        for k in range(p - 1, 0, -1): c = A[k] + t * c
        smooth = (flag == 2) & (p > 1)
        return c if np.all(smooth) else pick(smooth, ~smooth, c, join(low + t * I(.5) * second, first))
    return at, flag
def definite(a):   # every symmetric matrix in it is positive definite
    n, ok, a = len(a.l), True, [[a[i, j] for j in range(len(a.l))] for i in range(len(a.l))]
    for j in range(n):
        ok = ok & (a[j][j].l > 0)
        for i in range(j + 1, n):
            for k in range(j + 1, i + 1): a[i][k] = a[k][i] = a[i][k] - a[i][j] / a[j][j] * a[j][k]
    return ok
def quadratic(Q, y):
    n = len(y.l)
    r = I(0)
    for i in range(n):
        for j in range(n): r = r + Q[i, j] * (y[i, 0].square() if i == j else y[i, 0] * y[j, 0])
    return r
def halves(lo, hi, j):   # of boxes along coordinates j: the lower ones, then the upper ones
    c, l, h = np.arange(len(j)), lo.copy(), hi.copy()
    l[j, c] = h[j, c] = .5 * lo[j, c] + .5 * hi[j, c]
    return np.hstack([lo, l]), np.hstack([h, hi])
class Proof:
    def __init__(s, c, texts):
        n, m, p = c['states'], c['inputs'], c['proof']
        def numbers(v, *shape):
            v = np.array(v, float)
            if v.shape != shape or not np.isfinite(v).all(): raise ValueError('numbers are missing')
            return v
        if c['format'] != 'liegrad certificate' or c['version'] != 1: raise ValueError('another format or version')
        for part, of in (('rate', 'plant'), ('control', 'controller')):
            if hashlib.sha256(texts[part].encode()).hexdigest() != c[of]['sha256']:
                raise Refused(f'the hash of "{part}" is not that of "{of}"')
        if c.get('stored', 0): raise Refused('the checker knows no stored inputs')
        s.rate, s.control, s.n = Program(c['rate'], n + m, n), Program(c['control'], n, m), n
        s.held, s.converges, s.tree, s.boxes, s.even = c['loop'] == 'held', c['converges'], p['tree'], p['boxes'], p['even']
        if not s.held and c['loop'] != 'continuous': raise ValueError('"loop"')
        s.goal, s.near, s.low, s.high = [numbers(v, n) for v in (c['goal'], p['near'], p['low'], p['high'])]
        s.level, s.eps, error = c['level'], c['eps'], numbers(c.get('error') or [0] * n, n)
        P, T = numbers(c['P'], n, n), numbers(p['T'], n, n)
        if s.held: s.period, s.order, s.steps, s.between = c['period'], p['order'], p['steps'], c.get('between')
        else: s.period, s.order, s.steps, s.between = 1, 1, 1, None
        numbers([s.level, s.eps, s.period, s.between or 0], 4)
        if not (s.steps in [2 ** i for i in range(20)] and 1 <= s.order <= 20 and s.period > 0 and min(error) >= 0): raise ValueError('a setting')
        if not ((P == P.T).all() and 0 < s.eps < s.level): raise Refused('P is not symmetric or the level is not above eps')
        wide = error > 0
        s.P, s.T, s.Q = I(P[:, :, None]), I(T[:, :, None]), None
        s.Q, s.errors, s.extra = s.T.turn() @ (s.P @ s.T), I(error[wide, None]), I(np.eye(n)[:, wide, None])
        ends = [min(math.inf if l is None else math.nextafter(g - l, 0), math.inf if h is None else math.nextafter(h - g, 0))
                for l, g, h in zip(c['low'], s.goal, c['high'])]
        root = np.minimum(-s.low, s.high)
        if s.even and s.low[0] <= 0: root[0] = s.high[0]
        for what, Q, level, b in (('the box of states', s.P, s.level, ends), ('the root box', s.Q, s.level, root), ('N', s.Q, s.eps, s.near)):
            for i in range(n):   # {y.Q y <= level} in |y_i| <= b_i: Q - (level/b_i^2) e_i e_i' is positive definite
                one = np.zeros((n, n, 1))
                one[i, i] = 1
                if not (b[i] > 0 and definite(Q - (I(one) * (I(level) / I(b[i]).square()) if b[i] < math.inf else I(0 * one))).all()):
                    raise Refused(f'{{V <= {level:g}}} is not in {what} (component {i + 1}), or P is not positive definite')
    def change(s, D, E, S, G, r):   # (D + E k).P (S + G k): its largest value for |k_i| <= r_i, and its matrix
        PS, PG = s.P @ S, s.P @ G
        top, g, M = (D.turn() @ PS)[0, 0], (E.turn() @ PS + PG.turn() @ D)[:, 0], E.turn() @ PG
        for i in range(len(r.l)):
            a, q = g[i].size(), I(M.h[i, i])
            end, turn = a * r[i] + q * r[i].square(), a.square() / (q * I(-4))
            top = top + I(np.where((q.h < 0) & (a.h < -2 * q.h * r.h[i] * (1 - 4 * U)), turn.h, end.h))
            for j in range(i): top = top + (M[i, j] + M[j, i]).size() * r[i] * r[j]
        return top.h, M
    def examine(s, lo, hi, steps, near):   # boxes: proved; with a tube
        N, mid, two = lo.shape[1], .5 * (lo + hi), I(2)
        y, Y, k = I(mid[:, None]), I(lo[:, None], hi[:, None]), I((I(lo) - I(mid)).l[:, None], (I(hi) - I(mid)).h[:, None])
        goal, r, V, m = I(s.goal[:, None, None] + np.zeros(N)), k.size()[:, 0], quadratic(s.Q, Y).h, s.T @ y
        x, X, level = goal + m, goal + s.T @ Y, np.minimum(V, s.level)
        u = s.control.value(x, I(np.zeros((0, 1, 1))))[0]
        K, ok = s.control.value(join(X, s.T), I(np.zeros((0, 1, 1))))
        w, K = cap(K[:, :1], u + K[:, 1:] @ k), K[:, 1:]
        if s.held:
            h, good, rise, F, D, A = s.period / steps, np.full(N, True), np.zeros(N), x, m * I(0), s.T   # A: dx/dy
            for i in range(steps):
                (now, f), (box, g) = step(s.rate, F, u, h, s.order, False), step(s.rate, X, w, h, s.order, True)
                ok = np.minimum.reduce(np.broadcast_arrays(ok, f, g))
                def slopes(t): return box(t)[:, 1:s.n + 1] @ A + box(t)[:, s.n + 1:] @ K
                for parts in (1, 2, 4, 8) if s.between is not None else ():
                    inside = np.full(N, True)
                    for j in range(parts):
                        t = I(h / parts * j, h / parts * (j + 1))
                        d, e = now(t), slopes(t)
                        v = s.change(d, e, (m + D) * two + t * d, A * two + t * e, r)[0]
                        inside &= (I(level) + I(rise) + I(t.h) * I(np.where(v <= 0, 0, v))).h <= s.between
                    if (inside | (ok == 0)).all(): break
                good = good & inside if s.between is not None else good
                t = I(h)
                X, D, A = X + t * box(t)[:, :1], D + t * now(t), A + t * slopes(t)
                F = x + D
                X, rise = cap(X, F + A @ k), s.change(D, A - s.T, m * two + D, A + s.T, r)[0]
            E, S, G = join(A - s.T, s.extra), m * two + D, join(A + s.T, s.extra)
        else:
            D, good = s.rate.value(x, u)[0], True
            E, f = s.rate.value(join(X, s.T), join(w, K))
            E, S, G, ok = join(E[:, 1:], s.extra), m * two, join(s.T * two, s.extra * I(0)), np.minimum(ok, f)
        rise, M = s.change(D, E, S, G, join(r, s.errors, axis=0))
        fall = definite(-(M + M.turn())) if near else rise < 0
        if not s.converges: fall = fall | (V < s.eps) & ((I(level) + I(rise)).h <= s.level)
        ok = np.broadcast_to(ok, N) > 0
        return ok & good & fall, ok
    def sweep(s, lo, hi, steps, near=False):   # columns of lo, hi are boxes of y
        todo = [(lo, hi, steps, 0)]
        while todo:
            lo, hi, steps, depth = todo.pop()
            if lo.shape[1] > BATCH: todo += [(lo[:, BATCH:], hi[:, BATCH:], steps, depth), (lo[:, :BATCH], hi[:, :BATCH], steps, depth)]; continue
            s.count += lo.shape[1]
            if not near:
                rest = ~(quadratic(s.Q, I(lo[:, None], hi[:, None])).l > s.level)
                if s.converges: rest = rest & ~((lo >= -s.near[:, None]) & (hi <= s.near[:, None])).all(0)
                lo, hi = lo[:, rest], hi[:, rest]
            if not lo.size: continue
            done, tubes = s.examine(lo, hi, steps, near)
            if depth == HALVINGS and not done.all():
                box = zip(*[q[:, np.argmin(done)] for q in (lo, hi)])
                raise Refused('no proof in the box y = ' + ' x '.join(f'[{a:.9g}, {b:.9g}]' for a, b in box))
            for some, more in ((~done & tubes, steps), (~done & ~tubes, 2 * steps)):
                if some.any(): todo.append((*halves(lo[:, some], hi[:, some], np.argmax((hi - lo)[:, some], 0)), more, depth + 1))
    def prove(s):
        s.count, seen, lo, hi = 0, 0, s.low[:, None], s.high[:, None]
        if s.converges:
            x = I(s.goal[:, None, None])
            f = s.rate.value(x, s.control.value(x, [])[0])[0]   # sin 0, 0 x and sums of zeros are exactly 0
            if s.errors.l.size or (f.l != 0).any() or (f.h != 0).any(): raise Refused('the goal is no exact equilibrium')
            s.sweep(-s.near[:, None], s.near[:, None], s.steps, True)
        for text in s.tree:
            code, seen = np.array(list(text)), seen + len(text)
            if len(code) != lo.shape[1] or not set(text) <= set('on01234' + 'abcdefghijklm'[:s.n]): raise Refused('the tree does not fit its boxes')
            for leaf in sorted(set(text) & set('on01234')):
                l, h, steps = lo[:, code == leaf], hi[:, code == leaf], s.steps * 2 ** int(leaf if leaf.isdigit() else 0)
                for a, b in ((l, h), (-h, -l))[:1 + s.even]: s.sweep(a, b, steps)
            cut = code[~np.isin(code, list('on01234'))]
            lo, hi = (q[:, ~np.isin(code, list('on01234'))] for q in (lo, hi))
            lo, hi = halves(lo, hi, np.array([ord(q) - 97 for q in cut], int))
        if lo.size or seen != s.boxes: raise Refused('the tree does not have its boxes')
def members(text):   # the texts of the members of an object
    d, i, r = json.JSONDecoder(), text.index('{') + 1, {}
    skip = lambda i: i + len(text[i:]) - len(text[i:].lstrip(' \t\r\n,:'))
    while text[(i := skip(i))] != '}':
        key, i = d.raw_decode(text, i)
        i = skip(i)
        if key in r: raise ValueError(f'"{key}" is there twice')
        _, e = d.raw_decode(text, i)
        r[key], i = text[i:e], e
    return r
def main(names):
    worst = 0
    for name in names:
        begin = time.time()
        try:
            with open(name, encoding='utf-8') as f: text = f.read()
            s = Proof(json.loads(text), members(text))
            s.prove()
            print(f'PROVED {name}: level {s.level:.17g}, {s.count} boxes, {time.time() - begin:.1f} s', flush=True)
        except Refused as e: print(f'NOT PROVED {name}: {e}', flush=True); worst = max(worst, 1)
        except (OSError, ValueError, KeyError, TypeError, IndexError) as e:
            print(f'{name} is no certificate: {type(e).__name__}: {e}', flush=True)
            worst = 3
    return worst
if __name__ == '__main__': sys.exit(main(sys.argv[1:]))
