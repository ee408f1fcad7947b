# Licensed under the GNU all-permissive notice
# Copyright (C) 2026 litpt contributors
#
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any
# warranty.
# SPDX-License-Identifier: FSFAP
#
# usage: awk -f book/scripts/said.awk ANSWER.txt...
#
# The numbers of what programs have said while the book was made, for
# \measured in its text. A line "mean difference: 0.3632 ± 0.0003" of same.txt
# is the row "mean difference" of the table same, with the columns value and
# error.

BEGIN { NUMBER = "-?[0-9]+([.][0-9]+)?(e[-+]?[0-9]+)?" }

FNR == 1 { table = FILENAME; gsub(/.*\/|[.][a-z]*$/, "", table) }

/^white is / {
    row = "white"
    put("value", first($0))
}
/^ *[A-Za-z0-9. _]+: / {
    row = text = $0
    sub(/:.*/, "", row)
    gsub(/^ +/, "", row)
    sub(/^[^:]*: /, "", text)
    put("value", first(text))
    put("error", first(after("± ")))
    put("z", first(after("z = ") after("[|]z[|] ")))
    put("expected", first(after("expected ")))
    if (match(text, NUMBER " beyond chance"))
        put("failed", first(substr(text, RSTART)))
}

function put(column, number) {
    if (number != "")
        printf "\\nwmeasured{%s}{%s}{%s}{%s}%%\n", table, row, column, number
}
# What follows in the text.
function after(words) {
    return match(text, words) ? substr(text, RSTART + RLENGTH) : ""
}
function first(words) {
    return match(words, NUMBER) ? substr(words, RSTART, RLENGTH) : ""
}
