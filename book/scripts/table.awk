# table.awk -- the rows of a table in LaTeX, of a CSV
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#
# usage: awk -v most=COLUMNS -v machine=FILE.tex -f table.awk FILE.csv
#
# A line of comment names the date and the machine; it goes to FILE.tex.

BEGIN { FS = ","; OFS = " & " }
/^#/ { sub(/^# */, ""); print $0 "%" > machine; next }
!head++ { next }
{ if (most && NF > most) NF = most; $1 = $1; print $0 " \\\\" }
