# counted.awk -- what the text says about the courtyard and its image
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#
# usage: awk -f counted.awk courtyard.obj report.json

BEGIN {
  split("cornice rail string coping gallery parapet step wall", course)
  for (i in course) kind[course[i]] = "course"
  kind["abacus"] = kind["plinth"] = "abacus and plinth"
  kind["basin"] = kind["fountain"] = "fountain and basin"
}
FILENAME ~ /json$/ {
  if (match($0, /^  "(rays|mean|mean_stderr|pixels)": /)) {
    split($0, word, /[ ":,]+/)
    say("picture", "report", word[2], word[3])
  }
  next
}
{ bytes += length($0) + 1; lines++ }
/^o / {
  solid = $2
  sub(/[.].*/, "", solid)
  if (solid in kind) solid = kind[solid]
  number[solid]++
  solids++
}
/^f / { triangles[solid]++; all++ }
END {
  say("file", "triangles", "lines", all)
  say("file", "solids", "lines", solids)
  say("file", "courtyard", "lines", lines)
  say("file", "courtyard", "megabytes", bytes / 1e6)
  for (solid in number) {
    say("solids", solid, "number", number[solid])
    say("solids", solid, "triangles", triangles[solid])
  }
}
function say(table, row, column, value) {
  printf "\\nwmeasured{%s}{%s}{%s}{%s}%%\n", table, row, column, value
}
