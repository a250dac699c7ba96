"""Training of the spherical pendulum's Hamiltonian by PyTorch from the weights of a model file, with the model of
hamiltonian.py; the commands of ../jax/peer.py. One core, one thread. Prints one JSON object."""
import json
import os
import sys

sys.dont_write_bytecode = True
sys.path[1:1] = [os.path.dirname(os.path.dirname(os.path.abspath(__file__)))]

import peerlib
from peerlib import clock

peerlib.pin()

import numpy as np
import torch

import hamiltonian

torch.set_num_threads(1)


class Problem:
    def __init__(self, args):
        self.args, self.file = args, peerlib.ModelFile(args.model)
        data, self.h = peerlib.read_data(args.data)
        self.data = torch.from_numpy(data)
        self.model = hamiltonian.Chain(1, torch.float64)
        self.at(self.file.flat)

    def at(self, flat):
        """Leaves at these numbers; they are views of self.flat."""
        self.flat = torch.from_numpy(flat.copy())
        self.theta = hamiltonian.Parameters(self.flat, self.file.widths, ((1, 1), (1,)))

    def loss(self, data=None):
        data = self.data if data is None else data
        self.model.prepare(self.theta, self.h)
        predicted = self.model.predict(data[:, 0], self.h, data.shape[1] - 1)
        return torch.nn.functional.mse_loss(predicted, data[:, 1:])

    def gradient(self, data=None):
        loss = self.loss(data)
        return loss, torch.autograd.grad(loss, self.theta.leaves)


def adam(problem):
    """lg-hamiltonian's plan, as in hamiltonian.py."""
    epochs, flat, step = problem.args.epochs, problem.flat, 0
    m, v = torch.zeros_like(flat), torch.zeros_like(flat)
    gen, marks = torch.Generator().manual_seed(1), peerlib.Marks(problem.args, problem.file)
    for epoch in range(epochs):
        rate = 1e-2 * (0.1 if epoch >= epochs // 2 else 1)
        for index in torch.randperm(len(problem.data), generator=gen).split(80):
            _, grads = problem.gradient(problem.data[index])
            step += 1
            with torch.no_grad():
                hamiltonian.adam_step(flat, grads, m, v, step, rate, 1e-3, 1e-12)
    marks.passed(flat.numpy(), epochs, end=True)
    return marks.points


def lbfgs(problem):
    """torch.optim.LBFGS with its line search, on the scaled loss; where that stops moving, training ends."""
    method = torch.optim.LBFGS(problem.theta.leaves, lr=1, max_iter=10, max_eval=10**9, tolerance_grad=0, tolerance_change=0,
                               history_size=problem.args.memory, line_search_fn="strong_wolfe")
    calls, marks, still = [0], peerlib.Marks(problem.args, problem.file), 0

    def closure():
        calls[0] += 1
        loss, grads = problem.gradient()
        for leaf, g in zip(problem.theta.leaves, grads):
            leaf.grad = peerlib.SCALE * g
        return peerlib.SCALE * loss.detach()

    while True:
        before = problem.flat.clone()
        method.step(closure)
        still = still + 1 if torch.equal(before, problem.flat) else 0
        if not marks.passed(problem.flat.numpy(), calls[0], end=still >= 3 or not torch.isfinite(problem.flat).all()):
            return marks.points


METHODS = {"adam": adam, "torch-lbfgs": lbfgs}


def train(problem):
    return dict(method=problem.args.method, points=METHODS[problem.args.method](problem))


def check(problem):
    point, expected = peerlib.read_gradient(problem.args.checkpoint)
    loss = problem.loss().item()
    problem.at(point)
    g = np.concatenate([x.numpy().ravel() for x in problem.gradient()[1]])  # leaves are in the order of the flat vector
    return dict(loss=loss, gradient_norm=float(np.linalg.norm(expected)),
                gradient_difference=float(np.linalg.norm(g - expected) / np.linalg.norm(expected)))


def gradient(problem):
    times = []
    for _ in range(problem.args.repeats):
        start = clock()
        problem.gradient()
        times.append(clock() - start)
    return dict(median_us=1e6 * float(np.median(times)), min_us=1e6 * min(times))


COMMANDS = dict(check=check, gradient=gradient, train=train)

if __name__ == "__main__":
    problem = Problem(peerlib.parser(__doc__, COMMANDS, METHODS).parse_args())
    result = COMMANDS[problem.args.command](problem)
    print(json.dumps(dict(peer="PyTorch " + torch.__version__, compile_seconds=0.0, **result)))
