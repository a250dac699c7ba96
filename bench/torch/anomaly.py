"""Detectors of a damaged well: an epoch of training the convolutional network, its value for one window, and
scikit-learn's classical methods on the principal components of the covariance features.

The network: three blocks of convolution (kernel 5), LeakyReLU and average pooling by 2, 6 -> 12 -> 24 -> 48 channels of
300 samples, then 2 and 1 outputs, sigmoid, mean squared error, Adam; 10,913 parameters. 4944 windows, reshuffled each
epoch. Of several ways to write it in PyTorch the fastest counts."""
import copy
import math
import statistics
import time

import torch

from timing import measure, row

WINDOWS, CHANNELS, LENGTH, BLOCKS, KERNEL = 4944, 6, 300, 3, 5
LR, DECAY = 2.102e-3, 1.221e-5
METHODS = ("logistic", "tree", "svm-linear", "svm-rbf")
COMPONENTS, TEST_FRACTION = 4, 0.2
EXPERIMENTS = ("cnn", "cnn-window", "classify")
functional = torch.nn.functional


class Network(torch.nn.Module):
    """`flat`: as images of height 1, which lets convolutions run with the channels last."""

    def __init__(self, flat=False):
        super().__init__()
        torch.manual_seed(3)
        widths = [CHANNELS << k for k in range(BLOCKS + 1)]
        self.flat, length = flat, LENGTH
        make = (lambda a, b: torch.nn.Conv2d(a, b, (1, KERNEL))) if flat else (lambda a, b: torch.nn.Conv1d(a, b, KERNEL))
        self.blocks = torch.nn.ModuleList(make(a, b) for a, b in zip(widths, widths[1:]))
        for _ in range(BLOCKS):
            length = (length - KERNEL + 1) // 2
        self.plane, self.out = torch.nn.Linear(widths[-1] * length, 2), torch.nn.Linear(2, 1)

    def forward(self, x):
        for block in self.blocks:
            x = functional.leaky_relu(block(x))
            x = functional.avg_pool2d(x, (1, 2)) if self.flat else functional.avg_pool1d(x, 2)
        return torch.sigmoid(self.out(functional.leaky_relu(self.plane(x.flatten(1)))))


def network(way, dtype):
    net = Network(way != "series").to(dtype)
    return net.to(memory_format=torch.channels_last) if way == "channels last" else net


def shaped(way, x):
    x = x if way == "series" else x.unsqueeze(2)
    return x.contiguous(memory_format=torch.channels_last) if way == "channels last" else x


WAYS = ("series", "images", "channels last")


def series(count, dtype):
    generator = torch.Generator().manual_seed(5)
    label = torch.randint(0, 2, (count, 1), generator=generator).to(dtype)
    x = torch.randn(count, CHANNELS, LENGTH, generator=generator, dtype=torch.float64).to(dtype)
    return x * (1 + 0.3 * label.view(-1, 1, 1)), label


class Adam:
    """One pass an operation over flat memory: parameters and gradients are views of it."""

    def __init__(self, net):
        leaves = list(net.parameters())
        with torch.no_grad():
            order = [p.contiguous() for p in leaves]
            self.flat = torch.cat([p.reshape(-1) for p in order])
            self.gradient, at = torch.zeros_like(self.flat), 0
            for p in leaves:
                p.data = self.flat[at:at + p.numel()].view(p.shape)
                p.grad = self.gradient[at:at + p.numel()].view(p.shape)
                at += p.numel()
        self.m, self.v, self.t = torch.zeros_like(self.flat), torch.zeros_like(self.flat), 0

    def zero_grad(self):
        self.gradient.zero_()

    @torch.no_grad()
    def step(self):
        self.t += 1
        g = self.gradient.add(self.flat, alpha=DECAY)
        self.m.lerp_(g, 0.1)
        self.v.mul_(0.999).addcmul_(g, g, value=0.001)
        denominator = self.v.sqrt().mul_((1 - 0.999**self.t)**-0.5).add_(1e-8)
        self.flat.addcdiv_(self.m, denominator, value=-LR / (1 - 0.9**self.t))


def library(net):
    return torch.optim.Adam(net.parameters(), lr=LR, weight_decay=DECAY, foreach=True)


def epoch(net, optimiser, x, label, batch, limit=None):
    """Seconds and the mean loss; of the first `limit` batches only, if given."""
    start, total, seen = time.perf_counter(), 0.0, 0
    for index in torch.randperm(len(x)).split(batch)[:limit]:
        optimiser.zero_grad()
        loss = functional.mse_loss(net(x[index]), label[index])
        loss.backward()
        optimiser.step()
        total, seen = total + loss.detach() * len(index), seen + len(index)
    return time.perf_counter() - start, float(total) / seen


def train(args, dtype):
    x, label = series(WINDOWS, dtype)
    batch, brief = args.batch or 30, args.patience < 1
    batches, tried = math.ceil(WINDOWS / batch), []
    few = min(40, batches)
    for way in WAYS:
        data = shaped(way, x)
        for adam in (Adam, library) if way != "channels last" else (library,):
            net = network(way, dtype)
            optimiser = adam(net)
            tried.append((min(epoch(net, optimiser, data, label, batch, 8)[0] for _ in range(3)), way, adam))
    _, way, adam = min(tried, key=lambda t: t[0])
    data, net = shaped(way, x), network(way, dtype)
    optimiser, times, loss = adam(net), [], math.nan
    for _ in range(2 if brief else args.repeats or 6):
        seconds, loss = epoch(net, optimiser, data, label, batch, few if brief else None)
        times.append(1e6 * seconds * (batches / few if brief else 1))
    return [row(times[1:] or times, name="epoch", way=way, adam=adam.__name__, batch=batch, windows=WINDOWS, inner=1, loss=loss,
                parameters=sum(p.numel() for p in net.parameters()),
                seconds_per_epoch=1e-6 * statistics.median(times[1:] or times))]


def window(args, dtype):
    """The value for one window: as written, and compiled."""
    x, _ = series(1, dtype)
    rows = []
    for way in WAYS:
        net, data = network(way, dtype).eval(), shaped(way, x)
        frozen = torch.jit.freeze(torch.jit.trace(copy.deepcopy(net), data))
        forms = [(way, net), (way + ", traced", frozen)]
        try:
            forms.append((way + ", for inference", torch.jit.optimize_for_inference(
                torch.jit.trace(copy.deepcopy(net), data))))
        except RuntimeError:
            pass
        for name, form in forms:
            with torch.inference_mode():
                try:
                    for _ in range(5):
                        form(data)
                    rows.append(measure(lambda: form(data), args.repeats, min(args.patience, 1.0), name=name, batch=1))
                except RuntimeError:
                    pass
    return sorted(rows, key=lambda r: r["median_us"])


# ---- scikit-learn ----


def covariance_features(x):
    """Upper triangles of the symmetric square roots of the channels' covariances, channels scaled to unit size first."""
    import numpy as np
    x = x - x.mean(2, keepdims=True)
    x = x / np.sqrt((x * x).mean((0, 2)))[:, None]
    w, v = np.linalg.eigh(np.einsum("nil,njl->nij", x, x) / x.shape[2])
    root = np.einsum("nik,nk,njk->nij", v, np.sqrt(np.maximum(w, 0)), v)
    i, j = np.triu_indices(x.shape[1])
    return root[:, i, j]


def classify(args):
    """Fits on a random 80 % of the windows of a file with /X (n, channels, length) and /y. A row a method: the fit with
    scaling and components, as ours is timed, and `alone_us`, the method's fit on ready components."""
    try:
        import h5py
        import numpy as np
        from sklearn.decomposition import PCA
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler
        from sklearn.svm import SVC
        from sklearn.tree import DecisionTreeClassifier
    except ImportError as error:
        raise SystemExit("scikit-learn: skipped, %s" % error)
    with h5py.File(args.inputs) as file:
        features, label = covariance_features(file["X"][...].astype("f8")), file["y"][...].ravel()
    order = np.random.default_rng(1).permutation(len(label))
    cut = round(TEST_FRACTION * len(label))
    test, chosen = order[:cut], order[cut:]
    x, y = features[chosen], label[chosen]
    methods = {"logistic": lambda: LogisticRegression(C=1.0), "tree": lambda: DecisionTreeClassifier(random_state=0),
               "svm-linear": lambda: SVC(kernel="linear", C=1.0), "svm-rbf": lambda: SVC(C=1.0)}
    ready = make_pipeline(StandardScaler(), PCA(COMPONENTS)).fit_transform(x)
    rows = []
    for name in METHODS:
        whole = lambda: make_pipeline(StandardScaler(), PCA(COMPONENTS), methods[name]())
        alone = measure(lambda: methods[name]().fit(ready, y), args.repeats, min(args.patience, 1.5), name=name)
        rows.append(measure(lambda: whole().fit(x, y), args.repeats, min(args.patience, 1.5), name=name, windows=len(y),
                            alone_us=alone["median_us"], accuracy=float(whole().fit(x, y).score(features[test], label[test]))))
    return rows


def run(args):
    dtype = torch.float64 if args.dtype == "f64" else torch.float32
    if args.case == "classify":
        return classify(args)
    return train(args, dtype) if args.case == "cnn" else window(args, dtype)
