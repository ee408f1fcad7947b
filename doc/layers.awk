# Licensed under the GNU all-permissive notice
# Copyright (C) 2026 litpt contributors
#
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any
# warranty.
# SPDX-License-Identifier: FSFAP
#
# usage: awk -f doc/layers.awk tests/layers.txt > layers.tex

function chapter(module) {
    return module == "main" ? "program" : module
}

{
    layer = $1
    sub(/:$/, "", layer)
    text = ""
    for (i = 2; i <= NF; i++) {
        name = $i
        gsub(/_/, "\\_", name)
        text = text "\\quad\\texttt{" name "}~\\ref{chap:" chapter($i) "}"
    }
    printf "\\node[layer] at (0,%.1f) {\\makebox[5.2em][l]{\\textit{%s}}%s};\n",
        0.8 * NR, layer, text
}
