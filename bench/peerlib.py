"""What peers that train from a model file share: the file's weights as liegrad's flat vector, data, marks of time. They run
on one core and count seconds of CPU, which other work on the machine does not stretch as it does those of the clock."""
import argparse
import os
import shutil
import sys
import time

sys.dont_write_bytecode = True

import h5py
import numpy as np

clock = time.process_time
# Of the loss that quasi-Newton methods of peers get, about 1 over its usual size. Ours is scale-free; BFGS in SciPy and jaxopt
# begins with H = I (with this factor SciPy's E1 after 5 s was 8e-11 instead of 5e-7), and torch.optim.LBFGS forgets pairs with
# y.s <= 1e-10.
SCALE = 1e6


def pin():
    """One core, and one thread for whatever reads these variables when it loads."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"


def pin_jax():
    """pin(), and JAX on the processor with one thread. Call it before JAX is imported."""
    pin()
    os.environ["XLA_FLAGS"] = " ".join(filter(None, (os.environ.get("XLA_FLAGS"), "--xla_cpu_multi_thread_eigen=false")))
    os.environ["JAX_PLATFORMS"] = "cpu"


class ModelFile:
    """A learned Hamiltonian of one pendulum, Flat vector: weight (in, out) and bias of each layer, gamma, b."""

    def __init__(self, path):
        self.path = path
        with h5py.File(path, "r") as file:
            count = len(file["model/potential"])
            self.names = [n for i in range(1, count + 1) for n in self.layer(file, i)] + ["model/mass/gamma", "model/mass/b"]
            arrays = [np.array(file[n]) for n in self.names]
        self.shapes = [a.shape for a in arrays]
        self.widths = [s[0] for s in self.shapes[:-2] if len(s) == 2] + [1]
        self.flat = np.concatenate([a.ravel() for a in arrays])

    @staticmethod
    def layer(file, i):
        return ["model/potential/layer%d/%s" % (i, n) for n in ("weight", "bias") if n in file["model/potential/layer%d" % i]]

    def parts(self, flat):
        """The arrays, in order; flat may be an array of any library."""
        out, at = [], 0
        for shape in self.shapes:
            n = int(np.prod(shape))
            out.append(flat[at:at + n].reshape(shape))
            at += n
        return out

    def write(self, path, flat):
        """A copy of the file with these weights: lg-hamiltonian evaluates it."""
        shutil.copy(self.path, path)
        with h5py.File(path, "r+") as file:
            for name, part in zip(self.names, self.parts(np.asarray(flat))):
                file[name][...] = part


def read_data(path):
    """(N, M, 6) and the time between points."""
    with h5py.File(path, "r") as file:
        t, y = np.array(file["t"]), np.array(file["trajectories"])
    return y, float(t[1] - t[0])


def read_gradient(path):
    """Of a checkpoint of a quasi-Newton method: the point where it stood, and the gradient there, as flat vectors."""
    with h5py.File(path, "r") as file:
        return np.array(file["fit/minimise/x"]), np.array(file["fit/minimise/gradient"])


class Marks:
    """The clock of a training, and (from_start) of its process: `passed(flat, evaluations)` keeps the weights when the next
    mark has passed, and says whether there are more. What the keeping takes does not count."""

    def __init__(self, args, model):
        self.seconds = [float(m) for m in args.marks.split(",")] if args.marks else [0.0]
        self.model, self.out, self.points = model, args.out, []
        self.start, self.kept = clock(), 0.0  # kept: what the keeping took

    def passed(self, flat, evaluations, end=False):
        now = clock()
        spent = now - self.start
        if self.seconds and (end or spent >= self.seconds[0]):
            self.seconds = [] if end else [m for m in self.seconds if m > spent]
            path = "%s-%d.h5" % (self.out, len(self.points))
            self.model.write(path, flat)
            self.points.append(dict(seconds=spent, from_start=now - self.kept, evaluations=int(evaluations), file=path))
        self.start += clock() - now
        self.kept += clock() - now
        return bool(self.seconds)


def parser(doc, commands, methods):
    out = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    out.add_argument("command", choices=commands)
    out.add_argument("model")
    out.add_argument("data")
    out.add_argument("--checkpoint", help="check: of training by ssbroyden or lbfgs, which keeps the gradient")
    out.add_argument("--method", choices=methods, default="adam")
    out.add_argument("--memory", type=int, default=100, help="pairs that L-BFGS keeps")
    out.add_argument("--epochs", type=int, default=100)
    out.add_argument("--marks", help="seconds, separated by commas; without it one mark at the end")
    out.add_argument("--repeats", type=int, default=51)
    out.add_argument("--out", default="peer", help="prefix of the models that are written")
    return out
