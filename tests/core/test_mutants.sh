#!/bin/bash
# scripts/mutants draws errors that differ, each in C outside comments and texts, and the same ones again from the same seed. It draws
# them in a copy of a part of the tree.
# ctest-labels: scripts/mutants
set -eu
cd "$LG_TEST_DIR/.."
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
cp --parents -r scripts/mutants src/core src/mpi src/settings apps/lg-fit "$copy"
cd "$copy"
drawn=$(scripts/mutants --list 200 --seed 1)
[ "$drawn" = "$(scripts/mutants --list 200 --seed 1)" ] || { echo "the same seed draws other errors"; exit 1; }
[ "$drawn" != "$(scripts/mutants --list 200 --seed 2)" ] || { echo "another seed draws the same errors"; exit 1; }
few=$(scripts/mutants --list 1000000 --room mpi) # all errors of the smallest module
[ "$(wc -l <<<"$few")" -gt 400 ] || { echo "src/mpi has few errors"; exit 1; }
[ -z "$(sort <<<"$few" | uniq -d)" ] || { echo "an error is drawn twice"; exit 1; }
python3 - "$drawn" <<'END'
import re, sys

def code_of(text):
    """The text with blanks for comments, and quotes for strings and characters: read character by character."""
    out, state, i = [], "", 0
    while i < len(text):
        pair = text[i:i + 2]
        if state == "" and pair in ("/*", "//"):
            state = pair
        if state == "" and text[i] in "'\"":
            state, shown = text[i], "'"
        elif state == "/*" and pair == "*/":
            state, shown, i = "", "  ", i + 1
        elif state in ("'", '"') and text[i] == "\\":
            shown, i = "''", i + 1
        elif state == text[i]:
            state, shown = "", "'"
        else:
            shown = text[i] if state == "" else " " if state[0] == "/" else "'"
        if text[i] == "\n":
            state, shown = state if state == "/*" else "", "\n"
        out.append(shown)
        i += 1
    return "".join(out)

kinds = set()
for line in sys.argv[1].splitlines():
    path, row, column, kind, before, after = re.fullmatch(r".*: (\S+):(\d+):(\d+) (\w+): (.*?) -> (.*)", line).groups()
    text, bare = open(path).read(), code_of(open(path).read())
    assert len(text) == len(bare), path
    at = sum(len(l) for l in text.splitlines(True)[:int(row) - 1]) + int(column) - 1
    assert re.sub(r"\s+", " ", text[at:]).startswith(before), f"the text is not there: {line}"
    assert bare[at] == text[at], f"it is in a comment or a text: {line}"
    assert not re.match(r"[ \t]*#", text.splitlines()[int(row) - 1]), f"it is in a line of the preprocessor: {line}"
    assert before != after, line
    kinds.add(kind)
assert len(kinds) == 5, f"only {kinds}"
END
