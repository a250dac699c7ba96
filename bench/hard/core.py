"""Rows of cases.txt: what a case is, and what its conditioning allows (references.py)."""
import struct

import mpmath as mp

mp.mp.dps = 50
U64, U32 = 2.0**-53, 2.0**-24
TINY = {U64: 2.0**-1074, U32: 2.0**-149}  # the spacing of subnormal numbers
PI = 3.141592653589793
ROWS = []


def single(x):
    return struct.unpack("f", struct.pack("f", x))[0]


def numbers(values):
    return [mp.mpf(v) for v in values]


def condition(function, inputs, metric, fixed=0, normwise=False, change=mp.mpf(10)**-22):
    """Of all inputs but the first `fixed`, each changed by a part of itself, or normwise by a part of the largest of them; the
    absolute metric has no division by the size of the result."""
    base = numbers(function(*numbers(inputs)))
    size = max(abs(v) for v in base) if metric != "absolute" else mp.mpf(1)
    largest, total = max(abs(mp.mpf(x)) for x in inputs[fixed:]), mp.mpf(0)
    for j, x in enumerate(inputs):
        if j < fixed or (x == 0 and not normwise):
            continue
        moved = numbers(inputs)
        moved[j] += (largest if normwise else moved[j]) * change
        ways = [abs(a - b) / (size if metric != "each" else abs(b)) for a, b in zip(numbers(function(*moved)), base) if a != b]
        total += max(ways, default=0) / change
    return total


def rows(room, function, reference, cases, metric="relative", roundings=4, exact=False, truncation=0, fixed=0, when="ci",
         how="50 digits", kappa=None):
    """One row a case: name -> inputs. `reference`: mpmath numbers to mpmath numbers. `exact`: kappa is 0."""
    unit = U32 if "f32" in function else U64
    for case, inputs in cases.items():
        inputs = [single(x) if unit == U32 else float(x) for x in inputs]
        given = numbers(inputs)
        values = numbers(reference(*given))
        known = 0 if exact else condition(reference, inputs, metric, fixed) if kappa is None else kappa
        scale = 1 if metric != "absolute" else max([abs(v) for v in values] + [mp.mpf(1)])
        smallest = min((abs(v) for v in values if abs(v) > TINY[unit]), default=mp.mpf(1))
        underflow = 0 if metric == "absolute" else TINY[unit] / smallest
        allows = roundings * (unit * (scale + known) + underflow) + truncation
        written(room, function, case, metric, how, float(allows), when, inputs, values)


def told(room, function, cases, when="ci"):
    """Rows that end with a status: case -> (inputs, name of the status)."""
    for case, (inputs, status) in cases.items():
        written(room, function, case, "told", "refused", 0, when, inputs, status)


def written(room, function, case, metric, how, allows, when, inputs, reference):
    text = reference if isinstance(reference, str) else " ".join(mp.nstr(v, 20) for v in reference)
    ROWS.append("\t".join([room, function, case, metric, how, "%.3g" % allows, when, " ".join("%.17g" % x for x in inputs), text]))
