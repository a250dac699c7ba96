"""A graph of ONNX as a function of PyTorch: the plain operators that lg-export writes. Real numbers become tensors of `dtype`;
what a shape is computed from stays in NumPy, so that tracing sees numbers."""
import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper


def numbers(*values):
    return all(isinstance(v, np.ndarray) for v in values)


def taken(x, axis, places):
    """Places that follow each other are a view; others a copy."""
    places = [int(i) % x.shape[axis] for i in np.ravel(places)]
    if places == list(range(places[0], places[0] + len(places))):
        return x.narrow(axis, places[0], len(places))
    return x.index_select(axis, torch.tensor(places))


def gather(x, places, axis=0):
    if numbers(x):
        return np.take(x, places, axis)
    out = taken(x, axis, places)
    return out if places.ndim == 1 else out.squeeze(axis)


def cut(x, starts, ends, axes=None, steps=None):
    axes = range(len(starts)) if axes is None else axes
    for k, axis in enumerate(axes):
        which = np.arange(x.shape[axis])[slice(int(starts[k]), int(ends[k]), 1 if steps is None else int(steps[k]))]
        x = taken(x, int(axis), which)
    return x


def concat(*parts, axis):
    return np.concatenate(parts, axis) if numbers(*parts) else torch.cat(parts, axis)


def reshape(x, shape):
    return x.reshape([x.shape[i] if n == 0 else int(n) for i, n in enumerate(shape)])


def pad(x, pads, value=None, mode=b"constant"):
    half = len(pads) // 2
    both = [int(pads[i + side * half]) for i in reversed(range(half)) for side in (0, 1)]
    return torch.nn.functional.pad(x, both, value=0.0 if value is None else float(value))


def gemm(a, b, c=0.0, alpha=1.0, beta=1.0, transA=0, transB=0):
    """Not torch.addmm, which fails in a frozen TorchScript of PyTorch 2.15 when the bias has one axis."""
    product = (a.T if transA else a) @ (b.T if transB else b)
    return product + c if alpha == beta == 1 else alpha * product + beta * c


def squeeze(x, axes):
    return x.squeeze(tuple(int(i) for i in axes))


def unsqueeze(x, axes):
    for axis in sorted(int(i) for i in axes):
        x = x.unsqueeze(axis)
    return x


def expand(x, shape):
    return torch.broadcast_to(x, torch.broadcast_shapes(x.shape, tuple(int(i) for i in shape)))


OPERATORS = {
    "Add": lambda a, b: a + b, "Sub": lambda a, b: a - b, "Mul": lambda a, b: a * b, "Div": lambda a, b: a / b,
    "Neg": lambda a: -a, "MatMul": lambda a, b: a @ b, "Identity": lambda a: a, "Gemm": gemm, "Concat": concat, "Slice": cut,
    "Gather": gather, "Reshape": reshape, "Pad": pad, "Squeeze": squeeze, "Unsqueeze": unsqueeze, "Expand": expand,
    "Shape": lambda a: np.array(a.shape), "Transpose": lambda a, perm: a.permute(perm), "Sin": torch.sin, "Cos": torch.cos,
    "Tanh": torch.tanh, "Sqrt": torch.sqrt, "Exp": torch.exp, "Where": torch.where,
    "ReduceSum": lambda a, axes, keepdims=1: a.sum([int(i) for i in axes], bool(keepdims)),
}


def load(path, dtype):
    """The function of the graph's inputs, all (rows, n), to its first output."""
    graph = onnx.load(path).graph
    real = lambda a: torch.tensor(a, dtype=dtype) if a.dtype.kind == "f" else a
    constants = {t.name: real(numpy_helper.to_array(t)) for t in graph.initializer}
    nodes = [(OPERATORS[n.op_type], list(n.input), n.output[0],
              {a.name: helper.get_attribute_value(a) for a in n.attribute}) for n in graph.node]

    def function(*inputs):
        values = dict(constants, **{i.name: x for i, x in zip(graph.input, inputs)})
        for operator, names, out, attributes in nodes:
            values[out] = operator(*[values[name] if name else None for name in names], **attributes)
        return values[graph.output[0].name]
    return function
