# efficiency.awk -- table and curves of the errors that pt and a peer reach
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#
# usage: awk -v machine=FILE.tex -v curves=FILE.tex -f efficiency.awk FILE.csv
#
# The rows of the table go to the standard output, and a panel of error
# against seconds for each scene to the file of curves. A claimed error is
# missing where a run is too short for one.

BEGIN { FS = ","; printf "" > curves }
/^#/ { sub(/^# */, ""); print $0 "%" > machine; next }
!head++ { for (i = 1; i <= NF; i++) at[$i] = i; next }
{
  scene = $at["scene"] " & " $at["albedo"]
  if (scene != last) {
    if (last != "") { finish_panel(); print "\\addlinespace[2pt]" }
    title = $at["scene"]
    if ($at["albedo"] != 0.8) title = title ", $\\rho=" $at["albedo"] "$"
  }
  print (scene == last ? "& " : scene), "&", $at["peer_samples"], "&",
    seconds("peer"), "&", $at["peer_error"], "&", $at["equal_samples"], "&",
    seconds("equal"), "&", $at["equal_claimed"], "&", $at["equal_error"],
    "&", $at["equal_speedup"], "&", $at["tenth_speedup"], "\\\\"
  last = scene
  point("peer", "peer_seconds", "peer_error")
  point("true", "equal_seconds", "equal_error")
  point("true", "tenth_seconds", "tenth_error")
  point("claimed", "equal_seconds", "equal_claimed")
  point("claimed", "tenth_seconds", "tenth_claimed")
}
END { if (last != "") finish_panel() }

function seconds(run) { return sprintf("%.2f", $at[run "_seconds"]) }

# Adds a point to a curve, in the order of time.
function point(curve, time, error,    i) {
  if ($at[error] + 0 <= 0) return
  for (i = ++count[curve]; i > 1 && xs[curve, i - 1] > $at[time] + 0; i--) {
    xs[curve, i] = xs[curve, i - 1]
    ys[curve, i] = ys[curve, i - 1]
  }
  xs[curve, i] = $at[time] + 0
  ys[curve, i] = $at[error] + 0
}

function draw(curve, style,    i) {
  printf "\\addplot[%s] coordinates {", style > curves
  for (i = 1; i <= count[curve]; i++)
    printf "(%g,%g)", xs[curve, i], ys[curve, i] > curves
  print "};" > curves
  count[curve] = 0
}

function finish_panel() {
  print "\\begin{panel}{" title "}" > curves
  draw("peer", "black, dashed, mark=o, mark options=solid")
  draw("true", "black, mark=*")
  draw("claimed", "black, only marks, mark=x, mark size=2.5pt")
  print "\\end{panel}" > curves
}
