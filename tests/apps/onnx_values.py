#!/usr/bin/env python3
"""Evaluates an ONNX file of elementwise operators on one row of scalars.

onnx_values.py FILE.onnx < POINTS: a line of POINTS has one number per input; a line of the answer has one number per
output. A number that is one per row has the
shape [1], one that all rows share has []. Written from the specification of ONNX, with the standard library alone.
"""
import math
import struct
import sys

nan = math.nan


def fields(data):
    """The fields of a protobuf message: (number, value)."""
    at = 0

    def varint():
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(data):
        key = varint()
        if key & 7 == 0:
            yield key >> 3, varint()
        else:
            length = varint()
            yield key >> 3, data[at:at + length]
            at += length


def guarded(f):
    def call(*x):
        try:
            return f(*x)
        except OverflowError:
            return math.inf
        except ValueError:
            return nan
    return call


def divide(a, b):
    if b != 0:
        return a / b
    return nan if a == 0 or a != a else math.copysign(math.inf, a) * math.copysign(1, b)


def log(x):
    return -math.inf if x == 0 else math.log(x)


def power(x, c):
    if x == 0 and c < 0:
        odd = c == int(c) and int(c) % 2
        return math.copysign(math.inf, x) if odd else math.inf
    if x < 0 and x != -math.inf and c == c and c != int(c):
        return nan
    try:
        return math.pow(x, c)
    except OverflowError:
        return -math.inf if x < 0 and int(c) % 2 else math.inf


def sigmoid(x):
    return 1 / (1 + math.exp(-x)) if x >= 0 else math.exp(x) / (1 + math.exp(x)) if x == x else nan


def largest(*x):
    return nan if any(v != v for v in x) else max(x)


operators = {
    "Identity": lambda x: x, "Neg": lambda x: -x, "Abs": abs, "Sqrt": math.sqrt, "Exp": math.exp, "Log": log,
    "Sin": math.sin, "Cos": math.cos, "Tanh": math.tanh, "Atan": math.atan, "Sigmoid": sigmoid,
    "Relu": lambda x: largest(x, 0.0), "IsNaN": lambda x: float(x != x), "Cast": lambda x: x,
    "Add": lambda a, b: a + b, "Sub": lambda a, b: a - b, "Mul": lambda a, b: a * b, "Div": divide,
    "Pow": power, "Max": largest, "Greater": lambda a, b: float(a > b), "Less": lambda a, b: float(a < b),
    "GreaterOrEqual": lambda a, b: float(a >= b), "Equal": lambda a, b: float(a == b),
    "Or": lambda a, b: float(a != 0 or b != 0), "Where": lambda c, a, b: a if c != 0 else b,
    "Gather": lambda shape, axis: shape[axis], "Expand": lambda x, rows: x, "Reshape": lambda x, shape: x,
}


def parts(message, *numbers):
    return [value for number, value in fields(message) if number in numbers]


def main():
    with open(sys.argv[1], "rb") as file:
        graph = parts(file.read(), 7)[0]
    constants, shapes, nodes = {}, {}, []
    for tensor in parts(graph, 5):
        raw, form = parts(tensor, 9)[0], {1: "<f", 7: "<q", 11: "<d"}[parts(tensor, 2)[0]]
        if len(raw) == struct.calcsize(form):
            constants[parts(tensor, 8)[0]] = struct.unpack(form, raw)[0]
    for port in parts(graph, 11):
        dims = parts(parts(parts(parts(port, 2)[0], 1)[0], 2)[0], 1)
        shapes[parts(port, 1)[0]] = [1] * len(dims)
    for node in parts(graph, 1):
        if parts(node, 4)[0] == b"Shape":
            constants[parts(node, 2)[0]] = shapes[parts(node, 1)[0]]
            continue
        nodes.append((guarded(operators[parts(node, 4)[0].decode()]), parts(node, 1), parts(node, 2)[0]))
    inputs, outputs = ([parts(port, 1)[0] for port in parts(graph, k)] for k in (11, 12))
    for line in sys.stdin:
        values = dict(constants)
        values.update(zip(inputs, map(float, line.split())))
        for operator, take, give in nodes:
            values[give] = operator(*(values[name] for name in take))
        print(*(repr(values[name]) for name in outputs))


main()
