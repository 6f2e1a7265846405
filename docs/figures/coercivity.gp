# SPDX-License-Identifier: GPL-3.0-or-later
# Smallest eigenvalue of the projected stiffness against the fully integrated one, from bench_coercivity.
load figures.'/style.gp'
set logscale xy
set yrange [1e-4:1.3]
set xtics (0.5, 1, 2, 4, 8, 16, '' 3 1, '' 5 1, '' 6 1, '' 7 1, '' 24 1)
set ytics ('1' 1, '0.1' 0.1, '0.01' 0.01, '10^{-3}' 1e-3, '10^{-4}' 1e-4)
set mytics 10
set xlabel 'quadrature points per node, M/N'
kinds = 'cells mls'; supports = '3 2.5 2 1.5'
titles = "'clusters of fine cells' 'MLS functions on a second cloud'"
array colours[4] = [pink, blue, green, orange]
array points[4] = [9, 7, 5, 13]
do for [study in 'coercivity coercivity_solid'] {
plane = study eq 'coercivity'
eval page(study, 1200, 500)
if (plane) { set xrange [0.46:8.5] } else { set xrange [0.46:28] }
file = data.'/'.study.'.dat'
set multiplot
do for [k = 1:2] {
  eval panel(k == 1 ? 0.085 : 0.57, k == 1 ? 0.49 : 0.975, 0.155, 0.9)
  set title word(titles, k) offset 0,-0.3
  if (k == 1) { set ylabel 'smallest eigenvalue {/:Italic λ}' offset 0.5,0 } else { unset ylabel }
  default = k == 1 ? 4 : plane ? 6 : 24
  unset arrow; unset label
  least = plane ? 2./3 : 0.5  # strains as many as unknowns
  set arrow from least, graph 0 to least, graph 1 nohead lw 1.5 dt 3 lc rgb grey
  set label (plane ? '3M = 2N' : '6M = 3N') at least, graph 0.97 offset 0.6,0 tc rgb grey
  set arrow from default, graph 0 to default, graph 1 nohead lw 1.5 dt 2 lc rgb grey
  set label sprintf('default M/N = %d', default) at default, graph 0.05 right offset -0.6,0 tc rgb '#333333'
  if (k == 1) { set key at graph 0.97, graph 0.55 right top Right samplen 2 title 'support / H' } else { unset key }
  plot for [i = 1:4] file index word(kinds, k).' '.word(supports, i) using 1:($2 > 0 ? $2 : NaN):3:4 \
         with yerrorbars pt -1 lw 1.2 lc rgb colours[i] notitle, \
       for [i = 1:4] '' index word(kinds, k).' '.word(supports, i) using 1:($2 > 0 ? $2 : NaN) \
         with linespoints pt points[i] lw (i == 2 ? 3.5 : 1.6) lc rgb colours[i] \
         title word(supports, i).(i == 2 ? ' (default)' : '')
}
unset multiplot
}
