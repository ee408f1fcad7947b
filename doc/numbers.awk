# Licensed under the GNU all-permissive notice
# Copyright (C) 2026 litpt contributors
#
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any
# warranty.
# SPDX-License-Identifier: FSFAP
#
# usage: awk -v parts=FILE -f doc/numbers.awk \
#   litpt.nw CHAPTER... STREAM... SOURCE...

FNR == 1 { finish_chunk(); start = 0 }
FILENAME == "litpt.nw" {
    # Note which chapter is in which part
    if (match($0, /[{].*[}]/)) {
        word = substr($0, RSTART + 1, RLENGTH - 2)
        if (/^\\part[{]/)
            order[++count] = part = word
        if (/^\\include/)
            of["chapters/" word ".nw"] = part
    }
    next
}
FILENAME ~ /\.nw$/ {
    # Count a line of a chapter
    part = of[FILENAME]
    book += length($0) + 1
    booklines++
    chapters[part] += FNR == 1
    if (/^<<.+>>=[ \t]*$/) {
        finish_chunk()
        inside = part
    } else if (/^@([ \t]|$)/) {
        finish_chunk()
    } else if (inside) {
        size += NF > 0
    } else if (!/^%/) {
        # Count the words of a line of prose
        gsub(/\$[^$]*\$|\\[A-Za-z]+/, " ")
        words[part] += gsub(/[A-Za-z][A-Za-z0-9_'-]+/, "")
    }
    next
}
FILENAME ~ /\.stream$/ {
    # Count a line of a stream
    stream = FILENAME ~ /resolved/ ? "resolved" : "plain"
    lines[stream]++
    bytes[stream] += length($0) + 1
    if (stream == "plain") {
        if (/^@(begin|end) code/)
            coded = /^@begin/
        pieces += coded && /^@(text|nl|use)/
        if (/^@index defn/ && !declared[$0]++)
            identifiers++
    }
    next
}
# Count the programs and write the results
{
    # Count a line of a program
    kind = FILENAME ~ /^noweb\// ? "tool" : "program"
    if (FILENAME ~ /(^|\/)tests\//) {
        tests += /#\[test\]/
        next
    }
    code[kind] += NF > 0
    if (!start && /^ *(pub(\([a-z]+\))? )?(const |unsafe )*fn /) {
        match($0, /^ */)
        indent = substr($0, 1, RLENGTH)
        start = 1
        size = 0
    }
    # Follow the function to its end
    if (start) {
        size += NF > 0
        last = $0 == indent "}" || size == 1 && /}$/
        if (last)
            add(kind, size)
        if (last || /;$/ && index($0, indent "    ") != 1)
            start = size = 0
    }
}

# Summarise sizes by their frequencies
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

function grouped(n,    text, head) {
    text = sprintf("%d", n)
    head = length(text) - 3
    if (head < 2)
        return text
    return substr(text, 1, head) "\\," substr(text, head + 1)
}

function define(name, text) {
    print "\\newcommand*{\\" name "}{" text "}"
}

END {
    # Write what was counted
    for (i = 1; i <= count; i++) {
        row(order[i], order[i])
        all += words[order[i]]
        whole += chapters[order[i]]
    }
    words["book"] = all
    chapters["book"] = whole
    print "\\midrule" > parts
    row("book", "the book")
    # Write a macro for each number
    define("bookwords", grouped(all))
    define("bookcode", grouped(sum["book"]))
    define("bookchunks", grouped(number["book"]))
    define("bookdensity", sprintf("%.1f", all / sum["book"]))
    define("booklines", grouped(booklines))
    define("bookbytes", sprintf("%.1f", book / 1e6))
    define("bookidentifiers", grouped(identifiers))
    define("bookpieces", grouped(pieces))
    define("booktests", grouped(tests))
    # Write the numbers of streams and programs
    for (stream in lines) {
        define(stream "lines", grouped(lines[stream]))
        define(stream "bytes", sprintf("%.1f", bytes[stream] / 1e6))
    }
    for (kind in code) {
        define(kind "code", grouped(code[kind]))
        define(kind "functions", grouped(number[kind]))
        define(kind "median", quantile(kind, 0.5))
        define(kind "ninety", quantile(kind, 0.9))
    }
    define("toolshare", sprintf("%d", 100 * code["tool"] / code["program"]))
}
