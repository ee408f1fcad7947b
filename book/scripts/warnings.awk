# warnings.awk -- the warnings in the log of LaTeX, at the chapters
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#
# usage: awk -v web='MASTER CHAPTER...' -f warnings.awk FILE.log
#
# Each stands with the chapter that was open and the line that it names, or
# the first.

BEGIN {
  count = split(web, files, " ")
  for (i = 1; i <= count; i++) {
    name = files[i]; sub(/.*\//, "", name); sub(/[.]nw$/, "", name)
    source[name] = files[i]
  }
  count = 0
}
match($0, /\/tex(-noweb)?\/[^ ()\/]+\.tex/) {
  name = substr($0, RSTART, RLENGTH); sub(/.*\//, "", name)
  sub(/[.]tex$/, "", name)
  if (name in source) file = source[name]
}
/(LaTeX|Package|Class|pdfTeX)[^:]*[Ww]arning|^(Over|Under)full/ {
  line = match($0, /lines? [0-9]+/) ? substr($0, RSTART, RLENGTH) : 1
  sub(/[^0-9]*/, "", line)
  print file ":" line ": warning: " $0; count++
}
END { print count + 0 " warnings are left in the book" }
