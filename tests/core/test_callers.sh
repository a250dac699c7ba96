#!/bin/bash
# Every public function must have a caller outside its own file and the tests: another source file, an app, an example, a
# benchmark or README.md. A function without a caller should be private or removed. Calls in comments do not count.
# Functions defined by macros (for each kind of model) are not checked.
set -u
cd "$(dirname "$0")/../.." || exit 1

# Prints "public NAME", "own NAME FILE" and "names NAME FILE".
words() {
    find include src apps examples bench tests/gradcheck \( -name '*.c' -o -name '*.h' -o -name '*.inc' -o -name '*.cpp' \) | sort | xargs awk '
        FNR == 1 { comment = declared = 0 }
        {
            line = $0
            code = ""
            while (line != "") { # remove comments
                at = index(line, comment ? "*/" : "/*")
                if (!comment) code = code (at ? substr(line, 1, at - 1) : line)
                line = at ? substr(line, at + 2) : ""
                if (at) comment = !comment
            }
            public = FILENAME ~ /^include/
            defines = FILENAME ~ /^src.*[.]c$/ && code ~ /^[a-z]/ && code !~ /^static|;/
            if (code ~ /^LG_API/) declared = code !~ /^LG_API extern/
            while (match(code, /lg_[a-z0-9_]+[(]?/)) {
                name = substr(code, RSTART, RLENGTH)
                code = substr(code, RSTART + RLENGTH)
                call = sub(/[(]$/, "", name)
                if (public && declared && call) { print "public", name; declared = 0 }
                if (defines && call) { print "own", name, FILENAME; defines = 0 }
                if (!public) print "names", name, FILENAME
            }
        }'
    grep -oE '\blg_[a-z0-9_]+' README.md | sed 's/.*/names & README.md/'
}

words | sort -u | awk '
    $1 == "public" { public[$2] = 1 }
    $1 == "own" { own[$2] = $3 }
    $1 == "names" { named[$2] = named[$2] " " $3 }
    END {
        for (name in public) {
            if (!(name in own)) continue
            others = named[name] " "
            sub(" " own[name] " ", " ", others)
            checked++
            if (others ~ /^ *$/) { print name " is public, and only " own[name] " calls it"; wrong = 1 }
        }
        if (checked < 500) { print checked " public functions found: too few"; wrong = 1 }
        print checked " public functions"
        exit wrong
    }'
