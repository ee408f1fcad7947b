# Copyright (C) 2026 litpt contributors
#
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any
# warranty.
# SPDX-License-Identifier: FSFAP
#
# usage: awk -f book/scripts/layers.awk tests/layers.txt > layers.tex

function chapter(module) {
    return module == "main" || module == "cli" ? "program" : \
        module == "host" || module == "inputs" ? "plan" : \
        module == "key" ? "state" : module == "matrix" ? "tally" : \
        module == "error" ? "errors" : module
}

{
    text = ""
    for (i = 2; i <= NF; i++) {
        name = $i
        gsub(/_/, "\\_", name)
        number = "(\\ref{chap:" chapter($i) "})"
        text = text "\\mbox{\\texttt{" name "} " number "}\\quad "
    }
    place = NR == 1 ? "" : ", above=1mm of layer" NR - 1
    printf "\\node[layer%s] (layer%d) {\\modules{%s}{%s}};\n", \
        place, NR, substr($1, 1, length($1) - 1), text
}
