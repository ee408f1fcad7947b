# measured.awk -- all entries of tables by name, for the numbers in the text
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#
# usage: awk -f measured.awk FILE.csv...
#
# A row is named by its first field, or by the fields named here, with a slash
# between them; an empty first field repeats the one above.

BEGIN {
  FS = ","
  rows["ablation"] = "scene shortcut"
  rows["bench"] = "scene threads"
  rows["coverage"] = "scene method n"
  rows["efficiency"] = "scene albedo peer_samples"
  rows["gains"] = "scene albedo samples"
  rows["mixtures"] = "mixture number"
  rows["parts"] = "scene part"
  rows["shortcuts"] = "scene shortcut"
  rows["traversal"] = "scene contender threads"
}
FNR == 1 { table = FILENAME; gsub(/.*\/|[.]csv$/, "", table); head = 0 }
/^#/ { next }
!head++ {
  parts = 1
  column[part[1] = $1] = 1
  for (i = 1; i <= NF; i++) { name[i] = $i; column[$i] = i }
  if (table in rows) parts = split(rows[table], part, " ")
  next
}
{
  key = ""
  for (i = 1; i <= parts; i++) {
    c = column[part[i]]
    if ($c == "" && i == 1) $c = above
    if (i == 1) above = $c
    key = key (i > 1 ? "/" : "") $c
  }
  for (i = 1; i <= NF; i++)
    printf "\\nwmeasured{%s}{%s}{%s}{%s}%%\n", table, key, name[i], $i
}
