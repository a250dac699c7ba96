# A header for Doxygen: its plain comments become documentation. A comment above a declaration, or behind one on its line, is
# its text; the comment at the top that of the file; "---- title ----" begins a group of members, with a number for scripts/docs.
# Paragraphs and lists of "- " flow, indented lines stay as they are. Names of the interface (ENVIRON["names"]) become links.
function marked(text,    out, name, page) {
    gsub(/[\\@#%$~|]/, "\\\\&", text)
    gsub(/&/, "\\&amp;", text); gsub(/</, "\\&lt;", text); gsub(/>/, "\\&gt;", text)
    gsub(/\*/, "\\&lowast;", text); gsub(/"/, "\\&quot;", text); gsub(/--/, "\\&minus;\\&minus;", text)
    while (match(text, /docs\/[a-z-]+\.md|[A-Za-z_][A-Za-z0-9_]*/)) {
        name = page = substr(text, RSTART, RLENGTH)
        if (sub(/^docs\//, "docs-", page) && sub(/\.md$/, "", page)) name = "@ref " page " \"" name "\""
        else if (index(ENVIRON["names"], " " name " "))
            name = (substr(text, RSTART + RLENGTH, 1) == "(" ? "@ref " name " \"" name "\"" : "#" name)
        out = out substr(text, 1, RSTART - 1) name
        text = substr(text, RSTART + RLENGTH)
    }
    return out text
}
function flow(text,    n, i, parts) { # `code` among words
    n = split(text, parts, "`")
    for (i = 1; i <= n; i++) parts[i] = i % 2 ? marked(parts[i]) : "<code>" marked(parts[i]) "</code>"
    for (i = 2; i <= n; i++) parts[1] = parts[1] parts[i]
    return parts[1]
}
function deepen(to) { # begins or ends indented lines in a list
    if (to != deep) { text = text flow(words) (to ? "<pre>" : "</pre>"); words = "" }
    deep = to
}
function leave(to) { # ends what `mode` began, begins `to`
    deepen(0)
    if (words) text = text flow(words)
    text = text (mode == "ul" ? "</li></ul>" : mode == "pre" ? "</pre>" : "") "\n"
    text = text (to == "ul" ? "<ul>" : to == "pre" ? "<pre>" : "")
    words = ""; mode = to
}
function documentation(from, to,    i, line, gap) { # the comment in these lines
    text = words = mode = gap = ""
    for (i = from; i <= to; i++) {
        line = L[i]
        sub(/ *\*\/.*$/, "", line)
        if (i == from) sub(/^.*\/\* ?/, "", line); else sub(/^ *\*? ?/, "", line)
        if (line ~ /^---- .* ----$/) continue
        if (line == "") { if (mode == "pre") gap = gap "\n"; else if (mode) leave(""); continue }
        if (mode != "pre" && line ~ /^ *- /) {
            if (mode != "ul") leave("ul"); else { deepen(0); text = text flow(words) "</li>" }
            item = index(line, "-") + 1; sub(/^ *- /, "", line); text = text "<li>"; words = line
        } else if (mode == "ul" && match(line, /^ */) && RLENGTH > item + 1) {
            deepen(1); text = text marked(substr(line, item + 1)) "\n"
        } else if (mode == "ul" && line ~ /^  /) { deepen(0); sub(/^ */, " ", line); words = words line }
        else if (line ~ /^  /) {
            if (mode != "pre") leave("pre")
            line = marked(line)
            if (match(line, /^ *- /)) line = substr(line, 1, RLENGTH - 2) "&minus;" substr(line, RLENGTH)
            text = text gap line "\n"
        }
        else { if (mode != "p") leave("p"); else line = " " line; words = words line }
        gap = ""
    }
    leave("")
    return text
}
function borrowed(declaration,    name) { # what a function without a comment of its own gets
    match(declaration, /lg_[a-z0-9_]+\(/)
    name = substr(declaration, RSTART, RLENGTH - 1)
    if (name ~ /_destroy$/) return "Destroys the object. NULL is allowed.\n"
    if (above != "" && (index(above, name) || last ~ /^typedef|^#define|_size$|_outputs$/ ||
            above ~ /^[ \n]*([A-Z][a-z]*[^ .s]|out) |other (two|three)/)) return above
    if (name ~ /_init$/) return "Sets the initial values of the structure.\n"
    return above == "" ? section : ""
}
function has_members(i) { # of the section from here on; Doxygen does not count structures
    for (; L[i] !~ /^(\/\* ----|LG_END_DECLS)/; i++)
        if (L[i] ~ /^(LG_API|#define|enum|typedef enum|typedef .*\(\*|static inline)/) return 1
    return 0
}
{ L[FNR] = $0 }
/^ *X\([A-Z_]+, [0-9]+, ".*"\)/ { # a status, which the enumeration has by LG_STATUS_LIST
    split($0, status, "\""); gsub(/^ *X\(|, $/, "", status[1]); sub(/,/, " =", status[1])
    codes = codes "LG_" status[1] ", /**< " status[2] " */\n"
}
END {
    for (i = 1; i <= FNR; i++) {
        if (L[i] ~ /^ *\/\*/) {
            for (end = i; L[end] !~ /\*\//; ) end++
            if (i == 1) print "/** @file\n" documentation(i, end) "*/"
            else if (L[i] ~ /\/\* ---- /) {
                title = L[i]; sub(/^\/\* ---- /, "", title); sub(/ ----.*$/, "", title)
                title = toupper(substr(title, 1, 1)) substr(title, 2)
                if (open) print "/** @} */"
                section = documentation(i, end); above = ""
                open = has_members(end + 1)
                if (open) printf "/** @name %03d %s\n%s*/\n/** @{ */\n", ++groups, title, section
                else if (section ~ /[a-z]/) print "/** @file\n<b>" title ".</b> " section "*/"
            } else { t = documentation(i, end); if (L[i] ~ /^\//) above = t; print "/** " t "*/"; own = 1 }
            i = end
            continue
        }
        if (L[i] ~ /^#include </) continue # the graphs show liegrad's own
        if (L[i] ~ /^ *LG_STATUS_LIST\(LG_STATUS_ENUM\)/) {
            printf "%s", codes
            continue
        }
        if (L[i] == "LG_END_DECLS" && open) print "/** @} */"
        if (L[i] == "") above = ""
        if (L[i] ~ /^LG_API/) {
            for (end = i; L[end] !~ /;/; ) end++
            if (!own && L[end] !~ /\/\*/ && (t = borrowed(L[i])) != "") print "/** " t "*/"
            if (L[end] ~ /\/\*/) above = ""
            last = L[i]; sub(/\(.*/, "", last)
        }
        if (own && L[i] ~ /^(typedef|#define)/) last = L[i]
        own = 0
        for (rest = L[i]; (at = index(rest, "/*")) && (end = index(rest, "*/")); rest = substr(rest, end + 2)) {
            L[0] = substr(rest, at, end + 2 - at)
            printf "%s/**< %s*/", substr(rest, 1, at - 1), documentation(0, 0)
        }
        if (at) {
            for (end = i; L[end] !~ /\*\//; ) end++
            rest = substr(rest, 1, at - 1) "/**< " documentation(i, end) "*/"
            i = end
        }
        print rest
    }
}
