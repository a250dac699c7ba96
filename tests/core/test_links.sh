#!/bin/bash
# Relative links of the pages lead to a file or folder of the tree, and an anchor (#name) to a heading of that page. Code
# is not looked at, nor are links to the web. GitHub makes the anchor of a heading: lower case, no punctuation but - and
# _, spaces become -, and a repeated anchor gets -1, -2, ...
set -u
export LC_ALL=C
cd "$(dirname "$0")/../.." || exit 1

# Reads pages; prints "anchor PAGE#NAME" for each heading, and "link PAGE LINE TARGET PATH" for each relative link, where
# PATH is the target from the root of the tree, with its anchor.
links_and_anchors() {
    awk '
        function path_of(page, target,    at, anchor, parts, kept, n, i, k, path) {
            at = index(target, "#")
            anchor = at ? substr(target, at) : ""
            if (at) target = substr(target, 1, at - 1)
            if (target == "") return page anchor
            sub(/[^\/]*$/, "", page)
            n = split(page target, parts, "/")
            k = 0
            for (i = 1; i <= n; i++)
                if (parts[i] == ".." && k > 0 && kept[k] != "..") k--
                else if (parts[i] != "." && parts[i] != "") kept[++k] = parts[i]
            path = k > 0 ? kept[1] : "."
            for (i = 2; i <= k; i++) path = path "/" kept[i]
            return path anchor
        }
        function link(target) {
            sub(/[ \t].*$/, "", target) # a title
            gsub(/^<|>$/, "", target)
            if (target == "") print "link", FILENAME, FNR, "()", "()"
            else if (target !~ /^[a-z]+:/) print "link", FILENAME, FNR, target, path_of(FILENAME, target)
        }
        FNR == 1 { fence = "" }
        /^ *(```|~~~)/ {
            mark = $0
            sub(/^ */, "", mark)
            mark = substr(mark, 1, 3)
            if (fence == "") fence = mark
            else if (fence == mark) fence = ""
            next
        }
        fence != "" { next }
        /^#+ / {
            name = tolower($0)
            sub(/^#+ +/, "", name)
            sub(/ +#* *$/, "", name)
            gsub(/\]\([^)]*\)/, "", name)
            gsub(/[^a-z0-9 _\200-\377-]/, "", name)
            gsub(/ /, "-", name)
            again = seen[FILENAME, name]++
            print "anchor", FILENAME "#" name (again ? "-" again : "")
        }
        {
            line = $0
            gsub(/`[^`]*`/, "", line)
            rest = line
            while (match(rest, /<a (id|name)="[^"]*"/)) {
                name = substr(rest, RSTART, RLENGTH - 1)
                sub(/^.*"/, "", name)
                print "anchor", FILENAME "#" name
                rest = substr(rest, RSTART + RLENGTH)
            }
            if (match(line, /^ *\[[^\]]+\]: +/)) link(substr(line, RLENGTH + 1))
            while (match(line, /\]\([^)]*\)/)) {
                link(substr(line, RSTART + 2, RLENGTH - 3))
                line = substr(line, RSTART + RLENGTH)
            }
        }' "$@"
}

mapfile -t pages < <(find README.md CHANGELOG.md docs examples -name '*.md' | sort)
found=$(links_and_anchors "${pages[@]}")
wrong=0 count=0
declare -A anchors
while read -r anchor; do anchors[$anchor]=1; done < <(sed -n 's/^anchor //p' <<<"$found")
while read -r page line target path; do
    count=$((count + 1)) file=${path%%#*}
    if [ ! -e "$file" ] || [ "${file#..}" != "$file" ]; then
        echo "$page:$line: ($target): there is no $file"
        wrong=1
    elif [ "$file" != "$path" ] && [ -z "${anchors[$path]:-}" ]; then
        echo "$page:$line: ($target): $file has no heading #${path#*#}"
        wrong=1
    fi
done < <(sed -n 's/^link //p' <<<"$found")
[ "$count" -ge 100 ] || { echo "$count links found: too few"; wrong=1; }
echo "$count links in ${#pages[@]} pages"
exit $wrong
