# Copyright (C) 2026 litpt contributors
#
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any
# warranty.
# SPDX-License-Identifier: FSFAP
#
# usage: awk -v parts=FILE -f book/scripts/numbers.awk \
#   MASTER CHAPTER... MASTER CHAPTER... SOURCE...

FNR == 1 { finish_chunk(); start = 0 }
/^\\(part|include)[{]/ && FILENAME !~ /chapters/ {
    word = $0
    gsub(/^[^{]*[{]|[}].*/, "", word)
    tool = FILENAME ~ /^noweb/
    if (tool)
        part = "The tool's book"
    else if (/^\\part/)
        part = word
    if (!(part in chapters))
        order[++count] = part
    chapters[part] += /^\\include/
    of[(tool ? "noweb/" : "") "chapters/" word ".nw"] = part
}
FILENAME ~ /chapters\/.*\.nw$/ {
    part = of[FILENAME]
    if (/^<<.+>>=[ \t]*$/) {
        finish_chunk()
        inside = part
    } else if (/^@([ \t]|$)/) {
        finish_chunk()
    } else if (inside) {
        size += NF > 0
    } else if (!/^%/) {
        gsub(/\$[^$]*\$|\\[A-Za-z]+/, " ")
        words[part] += gsub(/[A-Za-z][A-Za-z0-9_'-]+/, "")
    }
}
FILENAME ~ /\.rs$/ {
    if (FILENAME ~ /(^|\/)tests\//) {
        tests += /#\[test\]/
        next
    }
    kind = FILENAME ~ /^noweb/ ? "tool" : "program"
    code[kind] += NF > 0
    if (!start && /^ *(pub(\([a-z]+\))? )?(const |unsafe )*fn /) {
        match($0, /^ */)
        indent = substr($0, 1, RLENGTH)
        start = 1
        size = 0
    }
    if (start) {
        size += NF > 0
        last = $0 == indent "}" || size == 1 && /}$/
        if (last)
            add(kind, size)
        if (last || /;$/ && index($0, indent "    ") != 1)
            start = size = 0
    }
}
END {
    for (i = 1; i <= count; i++) {
        row(order[i], order[i])
        words["book"] += words[order[i]]
        chapters["book"] += chapters[order[i]]
    }
    print "\\midrule" > parts
    row("book", "both books")
    define("bookwords", grouped(words["book"]))
    define("bookcode", grouped(sum["book"]))
    define("bookchunks", grouped(number["book"]))
    define("bookdensity", sprintf("%.1f", words["book"] / sum["book"]))
    define("booktests", grouped(tests))
    for (kind in code) {
        define(kind "code", grouped(code[kind]))
        define(kind "functions", grouped(number[kind]))
        define(kind "median", quantile(kind, 0.5))
        define(kind "ninety", quantile(kind, 0.9))
    }
}

function add(kind, size) {
    frequency[kind, size]++
    number[kind]++
    sum[kind] += size
    if (size > longest[kind])
        longest[kind] = size
}

function finish_chunk() {
    if (inside) {
        add(inside, size)
        add("book", size)
    }
    inside = size = 0
}

function quantile(kind, share,    size, seen) {
    for (size = 0; size <= longest[kind]; size++) {
        seen += frequency[kind, size]
        if (seen >= share * number[kind])
            return size
    }
}

function row(part, name,    code) {
    code = sum[part]
    print name, "&", chapters[part], "&", grouped(words[part]), "&", \
        grouped(code), "&", \
        code ? sprintf("%.1f", words[part] / code) : "--", "&", \
        grouped(number[part]), "&", \
        code ? quantile(part, 0.5) : "--", "\\\\" > parts
}

function grouped(n,    head) {
    head = length(n "") - 3
    return head < 2 ? n + 0 : substr(n, 1, head) "\\," substr(n, head + 1)
}

function define(name, text) {
    print "\\newcommand*{\\" name "}{" text "}"
}
