# parts.awk -- the table of what each part of a gather is worth
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#
# usage: awk -v machine=FILE.tex -f parts.awk PARTS.csv
#
# The table has a row for each part and two columns for each scene.

BEGIN { FS = "," }
/^#/ { sub(/^# */, ""); print $0 "%" > machine; next }
!head++ { for (i = 1; i <= NF; i++) at[$i] = i; next }
{
  scene = $at["scene"]; part = $at["part"]; z = $at["z"]
  if (!(scene in known)) { known[scene]; scenes[++columns] = scene }
  if (!(part in seen)) { seen[part]; parts[++rows] = part }
  cost[part, scene] = $at["cost"]
  rays[part, scene] = $at["rays"]
  if ($at["bytes"] > bytes[part]) bytes[part] = $at["bytes"] + 0
  if (z < 0) z = -z
  if (z > largest[part]) largest[part] = z
}
END {
  printf "\\begin{tabular}{lr*{%d}{rr}r}\n\\toprule\n&", columns
  for (i = 1; i <= columns; i++)
    printf " & \\multicolumn{2}{c}{%s}", scenes[i]
  printf " \\\\\n"
  for (i = 1; i <= columns; i++)
    printf "\\cmidrule(lr){%d-%d}", 2 * i + 1, 2 * i + 2
  printf "\nwithout & [MB]"
  for (i = 1; i <= columns; i++) printf " & cost & rays"
  printf " & $|z|$ \\\\\n\\midrule\n"
  for (k = 1; k <= rows; k++) {
    part = parts[k]
    printf "%s & %s", part,
      bytes[part] ? sprintf("%.1f", bytes[part] / 1e6) : ""
    for (i = 1; i <= columns; i++)
      printf " & %s & %s", short(cost[part, scenes[i]]),
        short(rays[part, scenes[i]])
    printf " & %.1f \\\\\n", largest[part]
  }
  print "\\bottomrule\n\\end{tabular}"
}

# A number with about three digits.
function short(x) { return sprintf(x < 10 ? "%.2f" : x < 100 ? "%.1f" : "%.0f", x) }
