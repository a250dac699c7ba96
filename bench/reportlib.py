"""What the scripts behind the pages of docs/reports share: running a program, a cache of trained models, tables between the
markers of a page, plots, options."""
import argparse
import json
import os
import shutil
import statistics
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor

import benchlib as lib
from figurelib import draw


def spread(values, show):
    """The median, and least and largest where there are several."""
    middle = show(statistics.median(values))
    return middle if len(values) == 1 else "%s (%s to %s)" % (middle, show(min(values)), show(max(values)))


def processor(bench):
    """What the figures were measured on, with the kernels that lg-bench chose."""
    text = subprocess.run(["lscpu"], stdout=subprocess.PIPE, text=True, env=dict(os.environ, LC_ALL="C")).stdout
    said = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)
    name, family, model, count = (said.get(key, "?").strip() for key in ("Model name", "CPU family", "Model", "CPU(s)"))
    kernels = lib.Ours(bench)("node", "--repeats", 1)["kernels"]
    return "%s (family %s, model %s), %s processors; %s" % (name, family, model, count, kernels)


class Study:
    """What `program` makes of one subject: tables of `page_file`.md (by default `page`.md), data/`page`.json and
    plots/`page`-*.svg below `out`. PARTS: by name the methods that fill `tables` and `data`. `also`: other pages with places
    for tables. `prefix`: stands before the names in markers, where several scripts fill one page. SHOWN: by the name of a table
    a function of (head, rows) that gives the head and the rows of the page; None: the table is in the data only."""
    page = program = page_file = None
    prefix = ""
    also = ()
    PARTS = {}
    SHOWN = {}

    def __init__(self, args, out):
        self.args, self.out, self.cache = args, out, args.cache
        self.bench = lib.find_lg_bench(args.build)
        self.path = os.path.join(os.path.dirname(self.bench), self.program)
        self.seeds = (1,) if args.quick else (1, 2, 3)
        self.tables, self.data = {}, {}

    @staticmethod
    def options(parser):
        """A page's own options."""

    def run(self, *words):
        result = lib.run([self.path, *map(str, words), "--json"])
        if result is None:
            raise SystemExit("%s %s failed" % (self.program, words[0]))
        return result

    def trained(self, data, words, *fixed):
        """The file and what training printed; trained once. `fixed`: options that do not change the model."""
        name = "-".join([os.path.basename(data)[:-3], *map(str, words)])
        stem = os.path.join(self.cache, name.replace("--", "").replace(" ", "_").replace("/", "_"))
        if not os.path.exists(stem + ".json"):
            result = self.run("train", data, *words, *fixed, "--out", stem + ".h5")
            with open(stem + ".json", "w") as file:
                json.dump(result, file)
        with open(stem + ".json") as file:
            return dict(json.load(file), file=stem + ".h5")

    def parallel(self, function, tasks):
        """[function(*task)], --jobs at a time, in the order of the tasks."""
        with ThreadPoolExecutor(self.args.jobs) as pool:
            return list(pool.map(lambda task: function(*task), tasks))

    def note(self, name, head, rows):
        """All rows for the data, what SHOWN chooses of them for the page."""
        self.data[name] = [dict(zip(head, row)) for row in rows]
        choose = self.SHOWN.get(name, lambda head, rows: (head, rows))
        if choose:
            self.tables[name] = lib.table(*choose(head, rows))

    def plot(self, name):
        folder = os.path.join(self.out, "plots")
        os.makedirs(folder, exist_ok=True)
        path = os.path.join(folder, "%s-%s.svg" % (self.page, name))
        if os.path.exists(path):  # programs replace a plot only if its data are beside it
            os.remove(path)
        return path

    def panel(self, name, panels, **size):
        draw(self.plot(name), len(panels), panels, **size)

    def sweep(self):
        """What gnuplot was given stays out of the report."""
        folder = os.path.dirname(self.plot("x"))
        for name in os.listdir(folder):
            if name.startswith(self.page + "-") and not name.endswith(".svg"):
                os.remove(os.path.join(folder, name))

    def write(self):
        os.makedirs(os.path.join(self.out, "data"), exist_ok=True)
        path = os.path.join(self.out, "data", self.page + ".json")
        before = json.load(open(path)) if os.path.exists(path) else {}
        with open(path, "w") as file:
            json.dump(dict(before, **self.data), file, indent=1)
            file.write("\n")
        left = set(self.tables)
        for page in self.pages():
            left -= self.fill(os.path.join(self.out, page + ".md"))
        for name in left:
            lib.say("%s.md has no place for the table '%s'" % (self.pages()[0], name))

    @classmethod
    def pages(cls):
        """The names of the pages, without .md."""
        return cls.page_file or cls.page, *cls.also

    def fill(self, path):
        """Puts the tables between their markers in a page; the names of those that have a place there."""
        with open(path) as file:
            text = file.read()
        placed = set()
        for name, body in self.tables.items():
            begin, end = ("<!-- %s %s%s -->" % (word, self.prefix, name) for word in ("begin", "end"))
            begin += "\n"
            if begin in text:
                before, rest = text.split(begin, 1)
                text = before + begin + body + "\n" + rest[rest.index(end):]
                placed.add(name)
        with open(path, "w") as file:
            file.write(text)
        return placed


def main(study, doc):
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--build")
    parser.add_argument("--out", help="folder of %s.md" % study.pages()[0])
    parser.add_argument("--cache", help="folder of data and models (a temporary one)")
    parser.add_argument("--only", help="parts, separated by commas")
    study.options(parser)
    args = parser.parse_args()
    reports = os.path.join(lib.ROOT, "docs", "reports")
    out = args.out or (tempfile.mkdtemp(prefix="liegrad-report-") if args.quick else reports)
    if os.path.abspath(out) != reports:
        os.makedirs(out, exist_ok=True)
        for page in study.pages():
            shutil.copy(os.path.join(reports, page + ".md"), out)
    with lib.workspace() as folder:
        args.cache = args.cache or folder
        os.makedirs(args.cache, exist_ok=True)
        made = study(args, out)
        for part in args.only.split(",") if args.only else study.PARTS:
            lib.say("%s ..." % part)
            study.PARTS[part](made)
            made.write()
