#!/bin/bash
# bench/certificates/check.py proves a certificate of lg-control again, and finds changes planted in it.
# ctest-labels: bench/certificates src/certify apps/lg-control
set -u
export LC_ALL=C
check=$LG_TEST_DIR/../bench/certificates/check.py
python=${LIEGRAD_PYTHON:-python3}
"$python" -c 'import numpy' 2>/dev/null || python=/usr/bin/python3 # another Python does not see Debian's packages
"$python" -c 'import numpy' 2>/dev/null || { echo "Python has no numpy (Debian: python3-numpy)"; exit 77; }
"$python" -c 'import flint' 2>/dev/null || "$python" -c 'import mpmath' 2>/dev/null ||
    { echo "Python has neither flint nor mpmath (Debian: python3-mpmath)"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/plant.yaml" <<'EOF'
columns: {time: t}
coordinates: [{name: th, kind: angle, velocity: w}]
inputs: {columns: [u]}
mass: {kind: known, values: [0.0375]}
potential: {kind: known, form: polynomial, of: th, degree: 1, values: [0, 0.73575]}
damping: {kind: known, values: [0.1]}
input_map: {kind: known, values: [[1]]}
EOF
cat >"$work/task.yaml" <<'EOF'
plant: plant.yaml
period: 0.01
horizon: 5
starts: {th: [-3.14, 3.14], w: [-1, 1]}
limits: {u: 0.75}
cost: {th: 1, w: 0.02, u: 0.02}
success: {th: 0.05, hold: 1, within: 8}
controller: {kind: lqr}
EOF
cd "$work" || exit 1
# certified TASK CERTIFICATE [ORDER]: makes a certificate, with the given order of its Taylor polynomials, and proves it again.
certified() {
    "$LG_BIN_DIR/lg-control" certify "$1" --box th=1.5,w=12 --certificate "$2" >said 2>&1 || { cat said; exit 1; }
    [ $# = 2 ] || sed -i "s/\"order\": *[0-9]*/\"order\": $3/" "$2"
    "$python" "$check" "$2" >said || { cat said; exit 1; }
    grep -q "^PROVED $2: level .* boxes, .* s\$" said || { cat said; exit 1; }
}
certified task.yaml whole.json
# With a shorter period a polynomial of degree 2 is enough, and the checker takes a fourth of the time: changes are planted in this one.
sed 's/^period: .*/period: 0.002/' task.yaml >short.yaml
certified short.yaml short.json 2
# What is wrong, the change of the certificate c, 1 if the hashes are renewed, and a piece of what the checker has to say.
status=0
planted() {
    "$python" - "$2" "$3" <<'EOF'
import hashlib, json, sys
c = json.load(open('short.json'))
exec(sys.argv[1])
if sys.argv[2] == '1':
    for k, of in (('rate', 'plant'), ('control', 'controller')):
        c[of]['sha256'] = hashlib.sha256(json.dumps(c[k]).encode()).hexdigest()
json.dump(c, open('planted.json', 'w'))
EOF
    "$python" "$check" planted.json >said
    [ $? -eq 1 ] && grep -q "^NOT PROVED planted.json: .*$4" said || { echo "$1:"; cat said; status=1; }
}
planted "the controller pushes to the other side" \
    "k = c['control']; k['code'].append(['neg', k['outputs'][0]]); k['outputs'] = [len(k['code']) - 1]" 1 'no proof in the box'
planted "another level" "c['level'] *= 1.2" 1 'leaves the '
planted "another plant with the hash of the first" "c['rate']['code'].append(['number', 1])" 0 '"rate" has another hash'
# Each of these is found by one part of the checker alone: labels of leaves, the root box, the argument near the goal.
back="r = c['rate']; k = len(r['code']); r['code'] += [['neg', i] for i in r['outputs']]; r['outputs'] = [k, k + 1]; p = c['proof']"
planted "time runs backward and every leaf is said to lie outside" \
    "$back; c['converges'] = False; p['tree'] = [''.join(q if q in 'ab' else 'o' for q in t) for t in p['tree']]" 1 'no proof in the box'
planted "a smaller root box" "p = c['proof']; p['high'] = [.9 * v for v in p['high']]; p['low'] = [.9 * v for v in p['low']]" 1 \
    'leaves the root'
planted "time runs backward and N holds the root box" "$back; p['near'] = [2, 2]" 1 'no proof in the box'
# An oscillator without damping: its Taylor polynomial of degree 3 falls over a period of 1, its motion does not.
planted "an oscillator without damping" "
c.update(loop='held', period=1, between=2, goal=[0, 0], low=[-9, -9], high=[9, 9], P=[[1, 0], [0, 1]], level=1, eps=.5,
         error=[0, 0], converges=True, states=2, inputs=1,
         rate={'inputs': 3, 'code': [['in', 0], ['in', 1], ['neg', 0]], 'outputs': [1, 2]},
         control={'inputs': 2, 'code': [['in', 0], ['sub', 0, 0]], 'outputs': [1]})
c['proof'].update(T=[[1, 0], [0, 1]], order=4, steps=1, near=[2, 2], even=False, low=[-1.5, -1.5], high=[1.5, 1.5], boxes=1,
                  tree=['n'])" 1 'no proof in the box'
# What a tube is said to hold: x' = a x goes to x e^(a h), and x' = x x leaves all numbers at t = 1/x.
"$python" - "$check" >said <<'EOF' || { echo "a tube:"; cat said; status=1; }
import importlib.util, math, sys
import numpy as np
sys.dont_write_bytecode = True
spec = importlib.util.spec_from_file_location('check', sys.argv[1])
check = importlib.util.module_from_spec(spec)
spec.loader.exec_module(check)
boxes = [(1, 1), (.5, 1), (-1, 2), (-1, -.25)]
def tube(factor, h):   # x' = factor x, or x' = x x
    code = [['in', 0], ['number', factor or 0], ['mul', 0, 1 if factor else 0]]
    rate = check.Program({'inputs': 1, 'code': code, 'outputs': [2]}, 1, 1)
    low, high = np.array(boxes, float).T.reshape(2, 1, 1, -1)
    w, flag = check.tube(rate, check.I(low, high), check.I(np.zeros((0, 1, 1))), h)
    return w.l[0, 0], w.h[0, 0], np.broadcast_to(flag, len(boxes))
wrong, held = [], 0
for a in [s * 2.0 ** k for s in (-1, 1) for k in range(-6, 9)]:
    for (x, y), l, h, flag in zip(boxes, *tube(a, 1)):
        held += flag > 0
        if flag > 0 and not (l <= min(x, x * math.exp(a)) and max(y, y * math.exp(a)) <= h): wrong.append(a)
if any(tube(None, 2)[2][:3] > 0): wrong.append('x x')
if not tube(None, .1)[2].all() or held < 30: wrong.append('short steps have no tube')
if wrong: print('no tubes for the rates', wrong)
sys.exit(bool(wrong))
EOF
# No certificates: exit code 3 and one line, never a traceback.
wrong() {
    "$python" "$check" wrong.json >said 2>errors
    [ $? -eq 3 ] && [ ! -s errors ] && grep -q "^wrong.json is no certificate: .*$2" said ||
        { echo "$1:"; cat said errors; status=1; }
}
sed 's/"level"/"level": 1, "level"/' whole.json >wrong.json; wrong "a key twice" 'a key comes twice'
sed 's/"even": *[a-z]*/"even": -1/' whole.json >wrong.json; wrong "a parity that examines no half" 'another type'
sed 's/"converges": *[a-z]*/"converges": []/' whole.json >wrong.json; wrong "a claim that is no truth value" 'another type'
"$python" -c 'print("[" * 200000)' >wrong.json; wrong "nested lists" ''
echo '[]' >wrong.json; wrong "a list" ''
exit $status
