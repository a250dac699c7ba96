#!/usr/bin/env python3
"""Plants changes in certificates, each with the hashes renewed, and counts which the checker does not prove.

usage: plant.py CERTIFICATE...        exit code 0: every change that makes the claim wrong is found

A change that makes the claim weaker, or another claim that is true, may be proved afresh: these are listed."""
import copy, hashlib, json, os, subprocess, sys, tempfile
CHECK = os.path.join(os.path.dirname(os.path.abspath(__file__)), 'check.py')
def changes(c):
    """(name, may be proved afresh, change of the decoded certificate)"""
    def at(*path, of):
        def change(d):
            for k in path[:-1]: d = d[k]
            d[path[-1]] = of(d[path[-1]])
        return change
    p, tree = c['proof'], c['proof']['tree']
    leaf = next(i for i, t in enumerate(tree) if any(q.isdigit() for q in t))
    for part in ('rate', 'control'):
        code = c[part]['code']
        for j in [j for j, e in enumerate(code) if e[0] == 'number' and e[1]]:
            yield f'{part}: number {j} with the other sign', True, at(part, 'code', j, 1, of=lambda v: -v)
            yield f'{part}: number {j} 5 % larger', True, at(part, 'code', j, 1, of=lambda v: 1.05 * v)
        yield f'{part}: an output moved by .001', False, lambda d, part=part: (
            d[part]['code'].extend([['number', .001], ['add', d[part]['outputs'][-1], len(d[part]['code'])]]),
            d[part]['outputs'].__setitem__(-1, len(d[part]['code']) - 1))
        yield f'{part}: its last output with the other sign', False, lambda d, part=part: (
            d[part]['code'].append(['neg', d[part]['outputs'][-1]]), d[part]['outputs'].__setitem__(-1, len(d[part]['code']) - 1))
        yield f'{part}: the hash of before', False, lambda d, part=part: d[part]['code'].append(['number', 0])
    yield 'time runs backward: V rises where it fell', False, lambda d: (
        d['rate']['code'].extend([['neg', i] for i in d['rate']['outputs']]),
        d['rate'].__setitem__('outputs', [len(d['rate']['code']) - d['states'] + i for i in range(d['states'])]))
    yield 'even is no truth value, no half would be examined', False, at('proof', 'even', of=lambda v: -1)
    yield 'level 10 % larger', False, at('level', of=lambda v: 1.1 * v)
    yield 'level 10 % smaller', True, at('level', of=lambda v: .9 * v)
    yield 'eps 4 times larger', True, at('eps', of=lambda v: 4 * v)
    yield 'eps half', True, at('eps', of=lambda v: .5 * v)
    yield 'P not symmetric', False, at('P', 0, 1, of=lambda v: 1.01 * v + 1e-9)
    yield 'P: the first diagonal entry negative', False, at('P', 0, 0, of=lambda v: -v)
    yield 'P: the first diagonal entry half', False, at('P', 0, 0, of=lambda v: .5 * v)
    yield 'T: the first entry half', True, at('proof', 'T', 0, 0, of=lambda v: .5 * v)
    yield 'goal moved', False, at('goal', 0, of=lambda v: v + .05)
    yield 'the box of states smaller', False, at('high', 0, of=lambda v: .01)
    yield 'the root box smaller', False, at('proof', 'high', -1, of=lambda v: .9 * v)
    yield 'near 1000 times larger', False, at('proof', 'near', of=lambda v: [1000 * q for q in v])
    yield 'near half', False, at('proof', 'near', of=lambda v: [.1 * q for q in v])
    yield 'a split box made a leaf', True, at('proof', 'tree', leaf, of=lambda t: t.replace('a', '0', 1).replace('b', '0', 1))
    yield 'a leaf removed', False, at('proof', 'tree', leaf, of=lambda t: t[:-1])
    yield 'the last boxes removed', False, at('proof', 'tree', of=lambda t: t[:-1])
    yield 'the number of boxes', False, at('proof', 'boxes', of=lambda v: v + 1)
    yield 'every leaf is outside', True, at('proof', 'tree', of=lambda t: [''.join('o' if q.isdigit() else q for q in s) for s in t])
    yield 'a wide error of the model', False, at('error', of=lambda v: [q + .3 for q in v])
    if c['loop'] == 'held':
        yield 'between below the level', False, at('between', of=lambda v: .9 * c['level'])
        yield 'another order', True, at('proof', 'order', of=lambda v: 2)
def verdict(folder, c, renew=True):
    text = {k: json.dumps(c[k]) for k in ('rate', 'control')}
    for k, of in (('rate', 'plant'), ('control', 'controller')):
        if renew: c[of]['sha256'] = hashlib.sha256(text[k].encode()).hexdigest()
    name = os.path.join(folder, 'planted.json')
    with open(name, 'w', encoding='utf-8') as f: json.dump(c, f)
    try: return subprocess.run([sys.executable, CHECK, name], capture_output=True, text=True, timeout=600)
    except subprocess.TimeoutExpired as e: return subprocess.CompletedProcess(e.cmd, 1, 'NOT PROVED: more than 600 s', '')
def main(names):
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            with open(name, encoding='utf-8') as f: c = json.load(f)
            whole, found, afresh = verdict(folder, copy.deepcopy(c)), 0, []
            if whole.returncode: wrong += 1; print(f'{name} itself: {whole.stdout.strip()}')
            for what, may, change in changes(c):
                d = copy.deepcopy(c)
                change(d)
                r = verdict(folder, d, renew='hash' not in what)
                if r.returncode in (1, 3) and not r.stderr: found += 1
                elif may and r.returncode == 0: afresh.append(what)
                else: wrong += 1; print(f'{name}: {what}: {r.stdout.strip()} {r.stderr.strip()[-300:]}')
            print(f'{name}: {found} changes found; proved afresh: {", ".join(afresh) or "no change"}', flush=True)
    return wrong > 0
if __name__ == '__main__': sys.exit(main(sys.argv[1:]))
