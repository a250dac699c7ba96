#!/usr/bin/env python3
"""check.py CERTIFICATE...: proves certificates again, from their files alone (README.md: how).
Exit code 0: all are proved, 1: one is not, 3: it is no certificate. NaN: not known; comparisons are false."""
import hashlib, json, math, re, sys, time
import numpy as np
try: from flint import arb, ctx
except ImportError: import mpmath as mp; arb, ctx = None, mp.mp
ctx.prec, _ = 90, np.seterr(all='ignore')
U, TINY, BATCH, HALVINGS, LEAVES, TRUTH = 2.0 ** -52, 1e-300, 4096, 12, [*'on01234'], ['even', 'converges']
class Refused(Exception): pass
class I:   # intervals: [value, slopes] x boxes, or matrices: rows x columns x boxes
    def __init__(s, l, h=None): s.l = np.asarray(l, float); s.h = s.l if h is None else h
    def __getitem__(s, i): return I(s.l[i]) if s.l is s.h else I(s.l[i], s.h[i])
    def __add__(s, o): l, h = s.l + o.l, s.h + o.h; return I(l - abs(l) * U, h + abs(h) * U)
    def __neg__(s): return I(-s.l) if s.l is s.h else I(-s.h, -s.l)
    def __sub__(s, o): return s + -o
    def corners(s, o, f):
        p = [f(a, b) for a in (s.l, s.h) for b in ((o.l,) if o.l is o.h else (o.l, o.h))]
        l, h = np.minimum.reduce(p), np.maximum.reduce(p)
        e = TINY * (((s.l != 0) | (s.h != 0)) & ((o.l != 0) | (o.h != 0)))   # underflow; 0 x stays 0
        return I(l - (abs(l) * U + e), h + (abs(h) * U + e))
    def __mul__(s, o):
        for a, b in ((s, o), (o, s)):   # a constant 0
            if a.l.shape[-1:] == (1,) and not (a.l.any() or a.h.any()):
                return I(np.zeros(np.broadcast_shapes(a.l.shape, b.l.shape[:-1] + (1,) * (b.l.ndim > 0))))
        return s.corners(o, np.multiply)
    def __truediv__(s, o): return pick((o.l > 0) | (o.h < 0), False, s.corners(o, np.divide), I(np.nan))
    def __matmul__(s, o):
        return sum((s[:, k:k + 1] * o[k:k + 1] for k in range(len(o.l))), I(np.zeros((len(s.l), 1, 1))))
    def turn(s): return I(s.l.swapaxes(0, 1), s.h.swapaxes(0, 1))
    def size(s): return I(np.maximum(-s.l, s.h))
    def square(s): r = I(np.maximum(np.maximum(s.l, -s.h), 0), s.size().h); return cap(r * r, I(0, np.inf))
def least(*a): return np.minimum.reduce(np.broadcast_arrays(2, *a))
def cap(a, b): return I(np.fmax(a.l, b.l), np.fmin(a.h, b.h))
def join(*parts, axis=-2):
    wide = np.zeros((1,) * (parts[0].l.ndim - 1) + (max(p.l.shape[-1] for p in parts),))
    return I(*[np.concatenate([q + wide for q in a], axis) for a in zip(*[(p.l, p.h) for p in parts])])
def pick(t, f, a, b):   # a where t, b where f, else both
    return I(np.where(t, a.l, np.where(f, b.l, np.minimum(a.l, b.l))),
             np.where(t, a.h, np.where(f, b.h, np.maximum(a.h, b.h))))
def ball(name, *x):   # a function at a point: a float and its error, 0 where it is exact: sin 0 = 0
    try:
        v = getattr(arb, name)(*map(arb, x)) if arb else getattr(mp, name)(*map(mp.mpf, x))
        m, sharp = float(v), not arb or v.rad() < abs(float(v)) * 2 ** -60 + TINY / 4
        if m in (0, 1) and (v.rad() == 0 if arb else x[0] == (name == 'log') and x[-1] >= 0): return m, 0
        return m, 4 * U * abs(m) + TINY if sharp else math.nan
    except (ValueError, ArithmeticError, TypeError): return math.nan, math.nan
def points(name, *x):
    r = np.array([ball(name, *t) for t in zip(*[a.ravel().tolist() for a in x])]).reshape(x[0].shape + (2,))
    return I(r[..., 0] - r[..., 1], r[..., 0] + r[..., 1])
def monotone(name, x): return I(points(name, x.l).l, points(name, x.h).h)
def trig(name, x, pi=I(math.pi, math.nextafter(math.pi, 4))):
    a, b, q = points(name, x.l), points(name, x.h), (x - pi * I(.5) if name == 'sin' else x) / pi
    first, last = np.ceil(q.l), np.floor(q.h)   # extrema are at whole numbers q
    both, one = (last > first) | ~(x.size().h < 1e15), last >= first
    return I(np.where(both | one & (first % 2 != 0), -1, np.maximum(-1, np.minimum(a.l, b.l))),
             np.where(both | one & (first % 2 == 0), 1, np.minimum(1, np.maximum(a.h, b.h))))
# Operations: coefficient k in time from the operands' ones x, the earlier ones y and the slope's z
def chain(x, value, slope): return join(value, slope * x[1:])
def dmul(a, b): r = a[:1] * b; return join(r[:1], r[1:] + a[1:] * b[:1])
def ddiv(a, b): v = a[:1] / b[:1]; return join(v, (a[1:] - v * b[1:]) / b[:1])
def conv(a, b, k, low, high):   # sum of a_i b_(k - i)
    return sum((dmul(a[i], b[k - i]) for i in range(low, high)), I(np.zeros((len(b[0].l), 1))))
def rate_of(a, b, k): return conv([q * I(i) for i, q in enumerate(a[:k + 1])], b, k, 1, k + 1) / I(k)
def op_mul(k, x, y, z):
    if k or x[0] is not x[1]: return conv(x[0], x[1], k, 0, k + 1)
    return chain(x[0][0], x[0][0][:1].square(), x[0][0][:1] * I(2))
def op_atan2(k, x, y, z):   # angle of the point (b, a); z = a^2 + b^2
    a, b = x
    z.append(op_mul(k, [a, a], y, z) + op_mul(k, [b, b], y, z))
    if k: return ddiv(rate_of(a, b, k) - rate_of(b, a, k) - rate_of(y + [z[0] * I(0)], z, k), z[0])
    a, b = a[0], b[0]
    c = [points('atan2', *np.broadcast_arrays(p[:1], q[:1])) for p in (a.l, a.h) for q in (b.l, b.h)]
    v = I(np.minimum.reduce([q.l for q in c]), np.maximum.reduce([q.h for q in c]))
    return join(v, (b[:1] * a[1:] - a[:1] * b[1:]) / z[0][:1])
def larger(a, b): return a[0].l[0] > b[0].h[0]
def op_max(k, x, y, z):
    r, ends = pick(larger(*x), larger(*x[::-1]), x[0][k], x[1][k]), [(v[0].l[:1], v[0].h[:1]) for v in x]
    return r if k else join(I(*map(np.maximum, *ends)), r[1:])
def op_ge(k, x, y, z):
    return join(I(larger(*x) * 1., ~larger(*x[::-1]) * 1.)[None] * I(k == 0), x[0][0][1:] * I(0))
def op_select(k, x, y, z):
    l, h = x[0][0].l[0], x[0][0].h[0]
    return pick((l > 0) | (h < 0), (l == 0) & (h == 0), x[1][k], x[2][k])
def function(values, later):   # values: y, slope z and its slope; later: z_k
    def op(k, x, y, z):
        v = None if k else values(x[0][0][:1])
        r = rate_of(x[0], z, k) if k else chain(x[0][0], *v[:2])
        z.append(later(k, x[0], y + [r], z) if k else chain(x[0][0], *v[1:]))
        return r
    return op
def of_exp(v): return (monotone('exp', v),) * 3
def of_log(v): return monotone('log', v), I(1) / v, -(I(1) / v.square())
def of_sin(v): s, c = trig('sin', v), trig('cos', v); return s, c, -s
def of_cos(v): s, c = trig('sin', v), trig('cos', v); return c, -s, -c
def of_tanh(v): t = cap(monotone('tanh', v), I(-1, 1)); w = I(1) - t.square(); return t, w, t * w * I(-2)
def turning(k, x, y, z): return -rate_of(x, y, k)
def inverse(k, x, y, z): return ddiv(-conv(z, x, k, 0, k), x[0])
OPS = {'add': lambda k, x, y, z: x[0][k] + x[1][k], 'neg': lambda k, x, y, z: -x[0][k], 'mul': op_mul,
       'div': lambda k, x, y, z: ddiv(x[0][k] - conv(y, x[1], k, 0, k), x[1][0]), 'atan2': op_atan2,
       'exp': function(of_exp, lambda k, x, y, z: y[k]), 'sin': function(of_sin, turning), 'max': op_max,
       'tanh': function(of_tanh, lambda k, x, y, z: -op_mul(k, [y, y], y, z)), 'select': op_select,
       'cos': function(of_cos, turning), 'log': function(of_log, inverse), 'ge': op_ge}
COUNT = {'in': 0, 'number': 0, 'select': 3, **dict.fromkeys('add sub mul div atan2 max ge'.split(), 2)}
# Where an operation is smooth, from its operands' bounds; elsewhere max has a kink and the others no slope
SMOOTH = {'log': lambda l, h: l[0] > 0, 'div': lambda l, h: (l[1] > 0) | (h[1] < 0),
          'atan2': lambda l, h: (l[1] > 0) | (l[0] > 0) | (h[0] < 0),
          **dict.fromkeys(('max', 'ge'), lambda l, h: (l[0] > h[1]) | (l[1] > h[0]))}
class Program:
    def __init__(s, what, inputs, outputs):
        s.code, new = [], []
        def p(*e): s.code.append(e); return len(s.code) - 1
        if what['inputs'] != inputs or len(what['outputs']) != outputs: raise ValueError('inputs or outputs')
        for j, (op, *a) in enumerate(what['code']):
            n = COUNT.get(op, 1)
            x = [new[i] for i in a[:n] if type(i) is int and 0 <= i < j]
            if op == 'in' and a[0] not in range(inputs) or len(x) != n or not all(map(math.isfinite, a)) \
                    or len(a) != n + (op in ('in', 'number', 'pow')): raise ValueError(f'entry {j}')
            if op in OPS or n == 0: r = p(op, *(x or a))
            elif op == 'sub': r = p('add', x[0], p('neg', x[1]))
            elif op == 'abs': r = p('max', p('max', x[0], p('neg', x[0])), p('number', 0))
            elif op == 'sign': o = p('number', 0); r = p('add', p('ge', x[0], o), p('neg', p('ge', o, x[0])))
            elif op == 'sigmoid':
                r = p('add', o := p('number', .5), p('mul', o, p('tanh', p('mul', o, x[0]))))
            elif op == 'pow' and a[1] in (2, 3): r = p('mul', x[0], p('mul', *x, *x) if a[1] == 3 else x[0])
            elif op in ('pow', 'sqrt'): r = p('exp', p('mul', p('number', (*a, .5)[1]), p('log', *x)))
            else: raise Refused(f'the checker has no operation {op}')
            new.append(r)
        s.outputs = [new[i] for i in what['outputs']]
    def coefficients(s, k, xs, u, C):   # of outputs; C: coefficients, slope's, flag of entries
        rows = xs[0].l.shape[1]
        for j, (op, *a) in enumerate(s.code):
            if k == 0: C.append([[], [], 2])
            x = [C[i] for i in a] if op in OPS else []
            if op == 'number': r = I(np.array([[0 if k else a[0]]] + [[0]] * (rows - 1)))
            elif op == 'in': r = xs[k][a[0]] if a[0] < len(xs[k].l) else u[a[0] - len(xs[k].l)] * I(k == 0)
            else: r = OPS[op](k, [c[0] for c in x], C[j][0], C[j][1])
            C[j][0].append(r)
            if x and k == 0: C[j][2] = s.flag(op, [c[0][0][0] for c in x], [c[2] for c in x])
        return join(I(np.zeros((0, rows, 1))), *[C[i][0][k][None] for i in s.outputs], axis=0)
    @staticmethod
    def flag(op, v, f):   # 2: smooth on the box, 1: with kinks, 0: not Lipschitz or not defined
        m, l, h = least(*f), [q.l for q in v], [q.h for q in v]
        if op != 'select': return np.where(op not in SMOOTH or SMOOTH[op](l, h), m, (m > 0) * (op == 'max'))
        no = np.where((l[0] == 0) & (h[0] == 0), np.minimum(f[0], f[2]), 0)
        return np.where((l[0] > 0) | (h[0] < 0), np.minimum(f[0], f[1]), no)
    def value(s, x, u=None): return s.coefficients(0, [x], u, C := []), least(*[C[i][2] for i in s.outputs])
def tube(rate, x, u, h):
    y = x
    for t in range(4):   # where this is no tube, steps are halved
        f, flag = rate.value(y, u)
        w = x + I(0, h) * f
        inside = ((y.l <= w.l) & (w.h <= y.h)).all((0, 1))
        if t and inside.all(): break
        d = .1 * 2 ** max(1, t) * (np.maximum(x.l - w.l, 0) + np.maximum(w.h - x.h, 0)) + 1e-13 * w.size().h
        y = I(np.where(inside, y.l, w.l - d), np.where(inside, y.h, w.h + d))
    return w, np.where(inside, flag, 0)
def step(rate, x, u, h, p, slopes):   # (x(t) - x(0))/t, slopes by x(0), u: of t; flag
    one, n = I(np.eye(len(x.l) + len(u.l))[:, :, None]), len(x.l)
    X, W = (join(x, one[:n]), join(u, one[n:])) if slopes else (x, u)
    z, flag = tube(rate, X, W, h)
    def series(x, order):
        C, xs = [], [x]
        for k in range(order): xs.append(rate.coefficients(k, xs, W, C) / I(k + 1))
        return xs
    A, B, smooth = series(X, p - 1), series(z, p), (flag == 2) & (p > 1)
    if not np.all(smooth):
        f = join(z[:, :1], rate.value(z[:, :1], u)[0])
        second = rate.value(f, join(u, u * I(0)))[0][:, 1:]   # x'' = f_x f, by one slope along f
        low, first = rate.value(x, u)[0], B[1][:, 1:]
    def at(t):
        c = B[p]
        for k in range(p - 1, 0, -1): c = A[k] + t * c
        return c if np.all(smooth) else pick(smooth, ~smooth, c, join(low + t * I(.5) * second, first))
    return at, flag
def definite(a):   # every symmetric matrix in it is positive definite
    return not len(a.l) or (a.l[0, 0] > 0) & definite(a[1:, 1:] - a[1:, :1] * a[:1, 1:] / a[:1, :1])
def quadratic(Q, y):
    n = range(len(y.l))
    return sum((Q[i, j] * (y[i, 0].square() if i == j else y[i, 0] * y[j, 0]) for i in n for j in n), I(0))
def halves(lo, hi, j):   # of boxes along coordinates j: the lower ones, then the upper ones
    c, l, h = np.arange(len(j)), lo.copy(), hi.copy()
    l[j, c] = h[j, c] = .5 * lo[j, c] + .5 * hi[j, c]
    return np.hstack([lo, l]), np.hstack([h, hi])
class Proof:
    def __init__(s, c, text):
        n, m, p, s.count, s.held = c['states'], c['inputs'], c['proof'], 0, c['loop'] == 'held'
        if c['format'] != 'liegrad certificate' or c['version'] != 1: raise ValueError('another format')
        if c['loop'] not in ('held', 'continuous') or c.get('stored', 0) != 0: raise Refused('another loop')
        for part, of in (('rate', 'plant'), ('control', 'controller')):   # the text of the part has the hash
            for i in (q.end() for q in re.finditer(f'"{part}"\\s*:\\s*', text)):
                v, e = json.JSONDecoder().raw_decode(text, i)
                if v == c[part] and hashlib.sha256(text[i:e].encode()).hexdigest() == c[of]['sha256']: break
            else: raise Refused(f'"{part}" has another hash')
        s.rate = Program(c['rate'], n + m, n)
        s.control = Program(c['control'], n if m else c['control']['inputs'], m)
        s.n, s.converges, s.tree, s.boxes, s.even = n, c['converges'], p['tree'], p['boxes'], p['even']
        s.level, s.eps, (P, T) = c['level'], c['eps'], np.array([c['P'], p['T']], float).reshape(2, n, n, 1)
        s.goal, near, s.low, s.high, error = v = np.array(
            [c['goal'], p['near'], p['low'], p['high'], c['error']], float)
        s.period, s.order, s.steps, s.between = 1, 1, 1, None
        if s.held: s.period, s.order, s.steps, s.between = c['period'], p['order'], p['steps'], c['between']
        if not (np.isfinite(v).all() and np.isfinite(P + T).all() and v.shape == (5, n) and min(error) >= 0
                and 0 < s.eps < s.level < math.inf and (P == P.swapaxes(0, 1)).all() and s.period > 0
                and s.steps in [1 << i for i in range(20)] and 0 < s.order < 20): raise Refused('numbers')
        s.P, s.T, s.near, s.errors = I(P), I(T), near[:, None], I(error[:, None])
        s.extra, s.Q, root = I(np.eye(n)[..., None]), s.T.turn() @ (s.P @ s.T), np.minimum(-s.low, s.high)
        if s.even and s.low[0] <= 0: root[0] = s.high[0]
        ends = [math.nextafter(min(g - (-1e300 if l is None else l), (1e300 if h is None else h) - g), 0)
                for l, g, h in zip(c['low'], s.goal, c['high'], strict=True)]
        for name, Q, v, at in (('the box', s.P, s.level, ends), ('the root', s.Q, s.level, root),
                               ('N', s.Q, s.eps, near)):
            for one, b in zip(np.eye(n), at):   # |y_i| <= b where y.Q y <= v: Q - v/b^2 e_i e_i' is definite
                if not (b > 0 and definite(Q - I(np.diag(one)[:, :, None]) * (I(v) / I(b)) / I(b)).all()):
                    raise Refused(f'{{V <= {v:g}}} is no ellipsoid or leaves {name}')
    def change(s, D, E, S, G, r):   # (D + E k).P (S + G k): its maximum for |k_i| <= r_i, and its matrix
        PS, PG = s.P @ S, s.P @ G
        top, g, M = (D.turn() @ PS)[0, 0], (E.turn() @ PS + PG.turn() @ D)[:, 0], E.turn() @ PG
        for i in range(len(r.l)):
            a, q = g[i].size(), I(M.h[i, i])
            end, turn = a * r[i] + q * r[i].square(), a.square() / (q * I(-4))
            top = top + I(np.where((q.h < 0) & (a.h < -2 * q.h * r.h[i]), turn.h, end.h))
            for j in range(i): top = top + (M[i, j] + M[j, i]).size() * r[i] * r[j]
        return top.h, M
    def examine(s, lo, hi, steps, near):   # which boxes are proved, and which have a tube
        N, middle, two, good = lo.shape[1], I(.5 * (lo + hi))[:, None], I(2), True
        Y, k = I(lo[:, None], hi[:, None]), I((I(lo[:, None]) - middle).l, (I(hi[:, None]) - middle).h)
        goal, r, m = I(s.goal[:, None, None] + np.zeros(N)), k.size()[:, 0], s.T @ middle
        x, X, V = goal + m, goal + s.T @ Y, quadratic(s.Q, Y).h
        u, (K, ok), level = s.control.value(x)[0], s.control.value(join(X, s.T)), I(np.minimum(V, s.level))
        w, K = cap(K[:, :1], u + K[:, 1:] @ k), K[:, 1:]
        if s.held:
            h, rise, F, D, A = s.period / steps, np.zeros(N), x, m * I(0), s.T   # A = dx/dy
            for i in range(steps):
                (now, f), (box, g) = step(s.rate, F, u, h, s.order, 0), step(s.rate, X, w, h, s.order, 1)
                ok = least(ok, f, g)
                def parts(t): b = box(t); return now(t), b[:, 1:s.n + 1] @ A + b[:, s.n + 1:] @ K, b[:, :1]
                for count in (1, 2, 4, 8) if s.between is not None else ():
                    inside = np.full(N, True)
                    for t in (I(h / count * j, h / count * (j + 1)) for j in range(count)):
                        d, e, _ = parts(t)
                        v = s.change(d, e, (m + D) * two + t * d, A * two + t * e, r)[0]
                        inside &= (level + I(rise) + I(t.h) * I(np.where(v <= 0, 0, v))).h <= s.between
                    if (inside | (ok == 0)).all(): break
                good = good if s.between is None else good & inside
                d, e, b = parts(I(h))
                D, A = D + I(h) * d, A + I(h) * e
                F, X = x + D, cap(X + I(h) * b, x + D + A @ k)
                rise = s.change(D, A - s.T, m * two + D, A + s.T, r)[0]
            E, S, G = join(A - s.T, s.extra), m * two + D, join(A + s.T, s.extra)
        else:
            D, (A, f) = s.rate.value(x, u)[0], s.rate.value(join(X, s.T), join(w, K))
            E, S, G, ok = join(A[:, 1:], s.extra), m * two, join(s.T * two, s.extra * I(0)), np.minimum(ok, f)
        rise, M = s.change(D, E, S, G, join(r, s.errors, axis=0))
        fall = definite(-(M + M.turn())[:s.n, :s.n]) if near else rise < 0
        if not s.converges: fall = fall | (V < s.eps) & ((level + I(rise)).h <= s.level)
        return (ok > 0) & good & fall, (ok > 0) & np.full(N, True)
    def sweep(s, lo, hi, steps, near=False, depth=0, n=BATCH):   # columns of lo, hi are boxes of y; n: most at a time
        for l, h in [(lo[:, i:i + n], hi[:, i:i + n]) for i in range(0, lo.shape[1], n)]:
            s.count += l.shape[1]
            if not near:
                rest = ~(quadratic(s.Q, I(l[:, None], h[:, None])).l > s.level)
                if s.converges: rest &= ~((l >= -s.near) & (h <= s.near)).all(0)
                l, h = l[:, rest], h[:, rest]
            if not l.size: continue
            done, tubes = s.examine(l, h, steps << depth // 4, near)
            if depth == HALVINGS and not done.all():
                box = zip(*[q[:, np.argmin(done)] for q in (l, h)])
                raise Refused('no proof in the box y = ' + ' x '.join(f'[{a:.9g}, {b:.9g}]' for a, b in box))
            for some, more in ((~done & tubes, steps), (~done & ~tubes, min(2 * steps, 64 * s.steps))):
                s.sweep(*halves(l[:, some], h[:, some], np.argmax(h - l, 0)[some]), more, near, depth + 1, max(64, n // 2))
    def prove(s):
        lo, hi, seen, x = s.low[:, None], s.high[:, None], 0, I(s.goal[:, None, None])
        if s.converges:
            f = s.rate.value(x, s.control.value(x)[0])[0]   # sin 0, 0 x and sums of zeros are exactly 0
            if s.errors.l.any() or f.l.any() or f.h.any(): raise Refused('the goal is no exact equilibrium')
            s.sweep(-s.near, s.near, s.steps, True)
        for text in s.tree:
            code, seen = np.array(list(text)), seen + len(text)
            if len(code) - lo.shape[1] or {*text} - {*LEAVES, *'abcdefghijklm'[:s.n]}: raise Refused('tree')
            for leaf in sorted({*text} & {*LEAVES}):
                l, h, steps = lo[:, code == leaf], hi[:, code == leaf], s.steps << int('0' + leaf.strip('on'))
                for a, b in ((l, h), (-h, -l))[:1 + s.even]: s.sweep(a, b, steps)
            cut = ~np.isin(code, LEAVES)
            lo, hi = halves(lo[:, cut], hi[:, cut], np.array([ord(q) - 97 for q in code[cut]], int))
        if lo.size or seen != s.boxes: raise Refused('the tree does not have its boxes')
def unique(pairs):
    if len({k for k, _ in pairs}) < len(pairs) or any((type(v) is bool) != (k in TRUTH) for k, v in pairs):
        raise ValueError('a key comes twice, or a value has another type')
    return dict(pairs)
def main(name):
    t0 = time.time()
    try:
        with open(name, encoding='utf-8') as f: text = f.read()
        s = Proof(json.loads(text, object_pairs_hook=unique), text)
        print(f'PROVED {name}: level {s.level:.9g}, {s.prove() or s.count} boxes, {time.time() - t0:.1f} s')
    except Refused as e: return print(f'NOT PROVED {name}: {e}', flush=True) or 1
    except Exception as e:   # whatever a wrong file leads to
        return print(f'{name} is no certificate: {type(e).__name__}: {e}', flush=True) or 3
if __name__ == '__main__': sys.exit(max(main(n) or 0 for n in sys.argv[1:]))
