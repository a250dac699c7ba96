# A page for Doxygen. Headings get names as GitHub makes them, behind that of the page: docs/start.md#install is
# docs-start.html#docs-start-install. Links are from the root of the tree (ENVIRON["root"]) and lead to pages of the site.
# With -v terms=1 it prints lines "word, kind, target, section" for the search: kind 1 stands for headings, code and bold words.
function name_of(path) { # docs/start.md, examples/mpc/README.md
    if (path == "README.md") return "index"
    sub(/(\/README)?\.md$/, "", path); gsub(/[\/.]/, "-", path)
    return path
}
function slug(text) { # as in tests/core/test_links.sh
    text = tolower(text)
    gsub(/\]\([^)]*\)/, "", text); gsub(/[^a-z0-9 _\200-\377-]/, "", text); gsub(/ /, "-", text)
    return text
}
function is_file(path,    line) { return (getline line < (ENVIRON["root"] "/" path)) > 0 }
function target(link,    at, anchor, parts, n, i, k, path, kept) {
    if (link ~ /^[a-z]+:/) return link
    at = index(link, "#"); anchor = at ? substr(link, at + 1) : ""
    if (at) link = substr(link, 1, at - 1)
    path = page; if (link != "") sub(/[^\/]*$/, "", path)
    n = split(path link, parts, "/"); k = 0
    for (i = 1; i <= n; i++) if (parts[i] == "..") k--; else if (parts[i] != "." && parts[i] != "") kept[++k] = parts[i]
    path = k > 1 ? kept[1] : "./" kept[1]; for (i = 2; i <= k; i++) path = path "/" kept[i]
    sub(/^\.\//, path ~ /\.md$/ ? "" : "./", path)
    if (path ~ /\.md$/) return name_of(path) ".html" (anchor == "" ? "" : "#" name_of(path) "-" anchor)
    i = path; sub(/^.*\//, "", i)
    if (path ~ /^include\/.*\.h$/) { sub(/\.h$/, "_8h.html", i); return i }
    if (is_file(path "/" i ".c")) return path "/" i ".c" # a folder
    if (is_file(path "/main.c")) return path "/main.c"
    return path
}
function words(text,    out, at) { # without code
    while (match(text, /\]\([^)]*\)/)) {
        out = out substr(text, 1, RSTART + 1) target(substr(text, RSTART + 2, RLENGTH - 3)) ")"
        text = substr(text, RSTART + RLENGTH)
    }
    return out text
}
function line_of(text,    n, parts, i, out) { # a quote ends Doxygen's code of one backtick
    n = split(text, parts, "`")
    if (n % 2 == 0) return words(text) # code goes on in the next line
    for (i = 1; i <= n; i++) out = out (i % 2 ? parts[i] : "\001" i "\002")
    out = words(out)
    while (match(out, /\*\*[^*]+\*\*/))
        out = substr(out, 1, RSTART - 1) "<b>" substr(out, RSTART + 2, RLENGTH - 4) "</b>" substr(out, RSTART + RLENGTH)
    for (i = 2; i <= n; i += 2) {
        at = index(out, "\001" i "\002")
        quote = parts[i] ~ /'/ ? "``" : "`"
        out = substr(out, 1, at - 1) quote parts[i] quote substr(out, at + length(i) + 2)
    }
    return out
}
function terms_of(text, kind,    n, i, parts) {
    gsub(/\]\([^)]*\)/, " ", text)
    n = split(text, parts, /[^A-Za-z0-9_.-]+/)
    for (i = 1; i <= n; i++) {
        gsub(/^[^A-Za-z]+|[^A-Za-z0-9]+$/, "", parts[i])
        if (length(parts[i]) > 2 - kind && !index(" the and for from with that this are is of in on to or by as at an it its " \
                                                  "not what which how ", " " tolower(parts[i]) " "))
            print tolower(parts[i]) "\t" kind "\t" url "\t" section
    }
}
function search(text,    parts, n, i) {
    gsub(/\*\*/, "`", text)
    n = split(text, parts, "`")
    for (i = 1; i <= n; i++) terms_of(parts[i], i % 2 == 0)
}
function heading(text) { # its code would be seen as HTML
    gsub(/`/, "", text); gsub(/--/, "\\--", text); gsub(/[<>]/, "\\\\&", text)
    return substr("######", 1, level) " " text
}
FNR == 1 { page = FILENAME; if (index(page, ENVIRON["root"] "/") == 1) page = substr(page, length(ENVIRON["root"]) + 2) }
/^ *(```|~~~)/ { fence = !fence; if (!terms) print; next }
fence { if (!terms) print; next }
/^<!-- site: .* -->$/ { # a plot that the site alone has
    file = $3; sub(/^<!-- site: [^ ]+ /, ""); sub(/ -->$/, ""); if (!terms) print "<a href=\"" file "\"><img src=\"" file "\" alt=\"" $0 "\"/></a>\n\n" $0
    next
}
/^#+ / {
    level = index($0, " ") - 1
    text = $0; sub(/^#+ +/, "", text)
    id = slug(text); id = id (seen[page, id]++ ? "-" seen[page, id] - 1 : "")
    anchor = level > 1 ? name_of(page) "-" id : page == "README.md" ? "mainpage" : name_of(page)
    if (terms) {
        url = name_of(page) ".html" (level > 1 ? "#" anchor : "")
        if (level == 1) title = text
        section = level > 1 ? title ": " text : text
        terms_of(text, 1)
        print tolower(text) "\t1\t" url "\t" section
    } else print heading(text) " {#" anchor "}" (level == 1 && page != "README.md" ? "\n\n[TOC]" : "")
    next
}
terms { search($0); next }
{ print line_of($0) }
