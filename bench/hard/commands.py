"""The rows of bench/hard-cases that drive commands."""
import json
import os
import shlex
import subprocess
import tempfile

ROWS = []
EXITS = {0: "LG_OK"}


class Row:
    """Files that are written into an empty folder, commands that are run there one after the other, and what is asked of the last
    one: a number of its JSON object near `want`, or an exit code with a sentence on stderr or in `warnings`."""

    def __init__(self, room, case, lines, files, how, metric, allows, ask):
        self.room, self.case, self.lines, self.files, self.how = room, case, lines, files, how
        self.metric, self.allows, self.ask = metric, allows, ask
        ROWS.append(self)

    def measure(self, programs, cache):
        with tempfile.TemporaryDirectory(dir=cache) as folder:
            for name, text in self.files.items():
                with open(os.path.join(folder, name), "w") as file:
                    file.write(text)
            for line in self.lines:
                words = shlex.split(line)
                words[0] = os.path.join(programs, words[0])
                done = subprocess.run(words + ["--json"], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                      timeout=900)
        return [self.case, self.how, self.metric, self.ask(done), self.allows, ("command", self.case)]


def at(value, path):
    """A number of an object by its path, "free_run.q1"."""
    for name in path.split("."):
        value = value[int(name) if isinstance(value, list) else name]
    return value


def number(room, case, path, want, allows, *lines, metric="relative", how="closed form", **files):
    """`path` of the last command's JSON is `want`."""
    def ask(done):
        if done.returncode:
            return float("inf")
        got = at(json.loads(done.stdout), path)
        if got is None:
            return float("inf")
        return abs(got - want) / (abs(want) if metric == "relative" else 1)
    Row(room, case, lines, renamed(files), how, metric, allows, ask)


def told(room, case, code, sentence, *lines, **files):
    """The last command ends with the exit code, and says the sentence."""
    def ask(done):
        return 0.0 if done.returncode == code and sentence in done.stderr + done.stdout else float("inf")
    Row(room, case, lines, renamed(files), "exit %d, told" % code, "told", 0, ask)


def renamed(files):
    """scene_yaml -> scene.yaml"""
    return {".".join(name.rsplit("_", 1)): text for name, text in files.items()}


# ---- tables ----

def table(rows=200, cell=None, row=50):
    """a, b, y = 2 a - b, of a lattice; `cell` in one row."""
    lines = ["a,b,y"]
    for i in range(rows):
        a, b = (0.618034 * i) % 1 * 2 - 1, (0.414214 * i) % 1 * 2 - 1
        lines.append("%.6f,%.6f,%s" % (a, b, "%.17g" % (2 * a - b) if cell is None or i != row else cell))
    return "\n".join(lines) + "\n"


TRAIN = "lg-fit train t.csv --outputs y --out m.h5 --epochs 50"
number("tables", "y = 2 a - b, exact", "rmse.y", 0, 1e-6, TRAIN, metric="absolute", t_csv=table())
told("tables", "one cell of 1e308", 0, "1e+308", TRAIN, t_csv=table(cell="1e308"))
told("tables", "constant output", 0, "constant", TRAIN, t_csv="a,b,y\n" + "".join("%d,%d,3\n" % (i, i * i % 7) for i in range(50)))
