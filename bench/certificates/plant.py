#!/usr/bin/env python3
"""Plants changes in certificates, each with the hashes renewed, and counts which the checker does not prove.

usage: plant.py CERTIFICATE...        exit code 0: nothing false is proved, and something of each kind is found

A change that is proved afresh needs a reason, which is checked: the claim is unchanged and other hints of its proof do, it
is a part of the first claim, or motions from thousands of states, by Runge-Kutta steps in floats, agree with it."""
import copy, hashlib, json, os, subprocess, sys, tempfile, time
import numpy as np
np.seterr(all='ignore')
CHECK = os.path.join(os.path.dirname(os.path.abspath(__file__)), 'check.py')
KINDS = ('coefficient', 'box', 'level', 'controller', 'plant', 'tree', 'form')
SECONDS = 300
# ---- the attack: floats, and no line of the checker ----
F = {'add': np.add, 'sub': np.subtract, 'mul': np.multiply, 'div': np.divide, 'neg': np.negative, 'max': np.maximum,
     'ge': lambda a, b: (a >= b) * 1., 'select': lambda c, a, b: np.where(c != 0, a, b), 'atan2': np.arctan2,
     'sign': lambda a: np.where(a >= 0, 1., -1.), 'sigmoid': lambda a: .5 + .5 * np.tanh(.5 * a)}
def program(what, x):
    v = []
    for op, *a in what['code']:
        if op == 'in': v.append(x[a[0]])
        elif op == 'number': v.append(np.full(x.shape[1:], float(a[0])))
        elif op == 'pow': v.append(v[a[0]] ** a[1])
        else: v.append((F.get(op) or getattr(np, op))(*(v[i] for i in a)))
    return np.array([v[i] for i in what['outputs']]).reshape((len(what['outputs']),) + x.shape[1:])
def refuted(c, states=4000, steps=64):
    """What is false in the claim of a certificate, or None"""
    n, P, goal = c['states'], np.array(c['P'], float), np.array(c['goal'], float)[:, None]
    e, level, eps = np.array(c['error'], float)[:, None, None], c['level'], c['eps']
    rng = np.random.default_rng(64)
    if np.any(P != P.T) or min(np.linalg.eigvalsh(P)) <= 0 or not 0 < eps < level: return 'its set is no ellipsoid'
    reach = np.sqrt(level * np.diag(np.linalg.inv(P)))
    for g, r, l, h in zip(goal[:, 0], reach, c['low'], c['high']):
        if l is not None and g - r < l or h is not None and g + r > h: return 'the set leaves the box'
    def f(x, u): return program(c['rate'], np.vstack([x, u]))
    def V(y): return np.einsum('i...,ij,j...', y, P, y)
    def control(x): return program(c['control'], x) if c['inputs'] else np.zeros((0, x.shape[1]))
    if c['converges'] and (e.any() or abs(f(goal, control(goal))).max() > 1e-9): return 'the goal is no equilibrium'
    d = rng.standard_normal((n, states)); d /= np.sqrt(V(d))
    low = 0 if c['converges'] else eps   # motions that converge by a proof of this kind fall in all of the set
    y = d * np.sqrt(np.where(rng.random(states) < .5, level, low + (level - low) * rng.random(states)) * (1 - 1e-12))
    x = goal + y
    signs = np.array(np.meshgrid(*[[-1, 1]] * n)).reshape(n, 1, -1) if e.any() else np.zeros((n, 1, 1))
    u, top, size = control(x), V(y), V(y)
    if c['loop'] == 'continuous':
        bad = ~((2 * np.einsum('iab,ij,ja->ab', f(x, u)[:, :, None] + signs * e, P, y)).max(1) < 0)
    else:
        h = c['period'] / steps
        for _ in range(steps):
            a = f(x, u); b = f(x + h / 2 * a, u); g = f(x + h / 2 * b, u)
            x = x + h / 6 * (a + 2 * b + 2 * g + f(x + h * g, u))
            top = np.maximum(top, V(x - goal))
        bad = ~(V((x - goal)[:, :, None] + signs * e).max(1) < size)
        if c.get('between') is not None and not (top.max() <= c['between']): return 'V between samples is larger'
    return f'V rises from {int(bad.sum())} of {states} states' if bad.any() else None
# ---- the changes ----
HINTS = ('proof', 'claim', 'names', 'liegrad')
def reason(c, d):
    """Why the claim of d is true where c's is, or None"""
    differ = {k for k in {*c, *d} if c.get(k) != d.get(k)}
    if differ <= {*HINTS}: return 'the same claim by other hints'
    if differ <= {'level'} and d['eps'] < d['level'] < c['level']: return 'a smaller set'
    if differ <= {'eps'} and c['eps'] < d['eps'] < d['level']: return 'V falls on less'
    if differ <= {'eps'} and c['converges'] and 0 < d['eps'] < c['eps']: return 'V falls in all of N'
    if differ & {'P', 'goal', 'low', 'high', 'error', 'converges'}: return None
    return None if refuted(d) else 'no state of 4000 refutes it'
def changes(c):
    """(kind, name, change of the decoded certificate, the sentence of a change that must never be proved or None)"""
    def at(*path, of):
        def change(d):
            for k in path[:-1]: d = d[k]
            d[path[-1]] = of(d[path[-1]])
        return change
    def output(part, entries):   # the last output is replaced by the last of some entries
        def change(d):
            k, code = len(d[part]['code']), d[part]['code']
            code.extend(entries(d[part]['outputs'][-1], k)); d[part]['outputs'][-1] = len(code) - 1
        return change
    tree = c['proof']['tree']
    leaf = next(i for i, t in enumerate(tree) if any(q.isdigit() or q == 'n' for q in t))
    split = next(i for i, t in enumerate(tree) if any('a' <= q <= 'm' for q in t)) if len(tree) > 1 else None
    for part, kind in (('rate', 'plant'), ('control', 'controller')):
        for j, e in enumerate(c[part]['code']):
            for by in (-1, 1.05, 20) if e[0] == 'number' and e[1] else ():
                yield 'coefficient', f'{part}: number {j} times {by}', at(part, 'code', j, 1, of=lambda v, by=by: by * v), 0
        yield kind, f'{part}: the hash of the first', lambda d, part=part: d[part]['code'].append(['number', 0]), 1
        if not c[part]['outputs']: continue
        yield kind, f'{part}: its last output .001 larger', output(part, lambda o, k: [['number', .001], ['add', o, k]]), 0
        for by in (-1, 50):
            yield kind, f'{part}: its last output times {by}', output(
                part, lambda o, k, by=by: [['number', by], ['mul', o, k]]), 0
    yield 'plant', 'time runs backward', lambda d: (
        d['rate']['code'].extend([['neg', i] for i in d['rate']['outputs']]),
        d['rate'].__setitem__('outputs', [len(d['rate']['code']) - d['states'] + i for i in range(d['states'])])), 1
    yield 'plant', 'errors of the model as large as the set', at('error', of=lambda v: [
        2e3 * q for q in np.sqrt(c['level'] * np.diag(np.linalg.inv(c['P'])))]), 1
    yield 'level', 'level 10 % larger', at('level', of=lambda v: 1.1 * v), 1
    yield 'level', 'level 10 % smaller', at('level', of=lambda v: .9 * v), 0
    yield 'level', 'eps 4 times larger', at('eps', of=lambda v: 4 * v), 0
    yield 'level', 'eps half', at('eps', of=lambda v: .5 * v), 0
    yield 'level', 'eps above the level', at('eps', of=lambda v: 2 * c['level']), 1
    yield 'form', 'P not symmetric', at('P', 0, 1, of=lambda v: 1.01 * v + 1e-9), 1
    yield 'form', 'P: the first diagonal entry negative', at('P', 0, 0, of=lambda v: -v), 1
    yield 'form', 'P: the first diagonal entry half', at('P', 0, 0, of=lambda v: .5 * v), 1
    yield 'form', 'T: the first entry half', at('proof', 'T', 0, 0, of=lambda v: .5 * v), 0
    yield 'form', 'even is no truth value', at('proof', 'even', of=lambda v: -1), 1
    reach = np.sqrt(c['level'] * np.diag(np.linalg.inv(c['P'])))
    yield 'box', 'goal moved', at('goal', 0, of=lambda v: v + .05 * reach[0]), 1
    yield 'box', 'the box of states smaller', at('high', 0, of=lambda v: c['goal'][0] + .9 * reach[0]), 1
    yield 'box', 'the root box smaller', at('proof', 'high', -1, of=lambda v: .9 * v), 1
    yield 'box', 'N 1000 times larger', at('proof', 'near', of=lambda v: [1000 * q for q in v]), 0
    yield 'box', 'N a tenth', at('proof', 'near', of=lambda v: [.1 * q for q in v]), 1
    if split is not None: yield 'tree', 'a split box made a leaf', at('proof', 'tree', split, of=lambda t: '0' + t[1:]), 0
    yield 'tree', 'a leaf removed', at('proof', 'tree', leaf, of=lambda t: t[:-1]), 1
    yield 'tree', 'the last boxes removed', at('proof', 'tree', of=lambda t: t[:-1]), 1
    yield 'tree', 'the number of boxes', at('proof', 'boxes', of=lambda v: v + 1), 1
    yield 'tree', 'every leaf is outside', at(
        'proof', 'tree', of=lambda t: [''.join('o' if q.isdigit() else q for q in s) for s in t]), 0
    if c['loop'] == 'held':
        yield 'level', 'between below the level', at('between', of=lambda v: .9 * c['level']), 1
        yield 'form', 'another order', at('proof', 'order', of=lambda v: 2), 0
        yield 'plant', 'a period 20 times longer', at('period', of=lambda v: 20 * v), 0
def verdict(folder, c, renew=True):
    for k, of in (('rate', 'plant'), ('control', 'controller')):
        if renew: c[of]['sha256'] = hashlib.sha256(json.dumps(c[k]).encode()).hexdigest()
    name = os.path.join(folder, 'planted.json')
    with open(name, 'w', encoding='utf-8') as f: json.dump(c, f)
    try: return subprocess.run([sys.executable, CHECK, name], capture_output=True, text=True, timeout=SECONDS)
    except subprocess.TimeoutExpired as e: return subprocess.CompletedProcess(e.cmd, 2, f'NOT PROVED in {SECONDS} s', '')
def main(names):
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            t0, found, false, late, afresh = time.time(), dict.fromkeys(KINDS, 0), 0, 0, []
            with open(name, encoding='utf-8') as f: c = json.load(f)
            whole = verdict(folder, copy.deepcopy(c))
            said = [whole.stdout.strip()] if whole.returncode else []
            if refuted(c): said.append(f'the certificate: {refuted(c)}')
            for kind, what, change, never in changes(c):
                d = copy.deepcopy(c)
                change(d)
                hashes = 'hash' not in what
                r, why = verdict(folder, d, hashes), None
                if r.returncode in (1, 3) and not r.stderr: found[kind] += 1
                elif r.returncode == 2: late += 1
                elif r.returncode == 0 and not never and (why := reason(c, {**d, 'plant': c['plant'],
                                                                           'controller': c['controller']})):
                    afresh.append(f'{what} ({why})')
                else: said.append(f'{what}: {r.stdout.strip()} {r.stderr.strip()[-300:]}')
                false += not why and hashes and kind in ('coefficient', 'plant', 'controller') and refuted(d) is not None
            said += [f'no change of the kind {k} is found' for k, v in found.items() if not v]
            for s in said: wrong += 1; print(f'{name}: {s}')
            print(f'{name}: {sum(found.values())} changes found (' + ', '.join(f'{k} {v}' for k, v in found.items()) +
                  f'), {late} not proved in {SECONDS} s; {false} of plant and controller are refuted by motions; '
                  f'{time.time() - t0:.0f} s')
            for s in afresh: print(f'    proved afresh: {s}')
            sys.stdout.flush()
    return wrong > 0
if __name__ == '__main__': sys.exit(main(sys.argv[1:]))
