# SPDX-License-Identifier: GPL-3.0-or-later
# Choices of smoothed particles, from `bench_sph chart`: what splitting changes for a neighbour, and the collapse of the
# rods over what can be chosen.
load figures.'/style.gp'
file = data.'/soil.csv'
rows(name) = sprintf("< grep '^%s,' %s", name, file)
set datafile separator ','
eval page('soil', 1500, 1500)
set multiplot
unset key
set palette defined (0 '#f7fbff', 1 '#6baed6', 2 '#08306b')
set cbrange [-4.5:-0.5]; set cbtics ('1e-4' -4, '1e-3' -3, '0.01' -2, '0.1' -1)
set xrange [0.1875:0.8125]; set yrange [0.3875:0.9125]
set xtics 0.2, 0.1, 0.8; set ytics 0.4, 0.1, 0.9
set samples 500
smallest(a, b) = a < b ? a : b
# Smoothing ratios up to which compression between daughters, and between them and a neighbour at a distance d, is stable.
stable(e, r, d) = smallest(1.5 * e / r, smallest(1.5 * (d - e) / r, 3.0 * (d - 0.5 * e) / r - 1.0))
array ratios[2] = [1.0, 1.2]
array kinds[2] = ['coarse', 'fine']
do for [i = 1:2] {
  do for [j = 1:2] {
    eval panel(0.06 + 0.46 * (j - 1), 0.46 + 0.46 * (j - 1), 0.70 - 0.315 * (i - 1), 0.965 - 0.315 * (i - 1))
    set title sprintf('h = %.1f d, %s neighbour: error of the gradient', ratios[i], kinds[j]) offset 0,-0.5
    set xlabel i == 2 ? 'separation over the spacing' : '' offset 0,0.4
    set ylabel j == 1 ? 'smoothing length over that of the parent' : '' offset 1.2,0
    if (j == 2) { set colorbox user origin 0.935,(i == 1 ? 0.70 : 0.385) size 0.015,0.265 } else { unset colorbox }
    if (i == 1 && j == 1) { set key at graph 0.98,0.98 right samplen 2 font ",12" opaque } else { unset key }
    plot rows(sprintf('map_%.1f_%s', ratios[i], kinds[j])) using 2:3:(log10($4)) with image notitle, \
      stable(x, ratios[i], 1.0) with lines lw 2.5 lc rgb orange title 'stable below: neighbour at d', \
      stable(x, ratios[i], 0.85) with lines lw 2.5 dt 2 lc rgb orange title 'at 0.85 d'
  }
}
unset colorbox
set autoscale; unset xtics; unset ytics; set xtics nomirror autofreq; set ytics nomirror autofreq
eval panel(0.06, 0.32, 0.05, 0.31)
set title 'splitting: surface off that of 2 mm (separation 0.7: 14)' offset 0,-0.5
set xlabel 'time over that of 2 mm' offset 0,0.4; set ylabel 'over that of 4 mm' offset 1.2,0
set yrange [0:2]; set xrange [0.35:0.7]
set key at graph 0.98,0.98 right samplen 1 font ",12" noopaque
array choices[3] = ['strain', 'separation', 'smoothing']
array colours[3] = [blue, green, pink]
plot for [k = 1:3] rows(choices[k]) using 4:3 with linespoints pt 7 lw 2 lc rgb colours[k] title choices[k], \
  for [k = 1:3] rows(choices[k]) using 4:3:(sprintf(' %g', $2)) with labels left font ",11" tc rgb colours[k] notitle, \
  0.33 with lines dt 3 lc rgb grey notitle
set offsets 0, 0, 0, 0
eval panel(0.39, 0.65, 0.05, 0.31)
set title 'toe of the rods [m]' offset 0,-0.5
set xlabel 'linear viscosity (0 at 0.01)'; unset ylabel
set logscale x; set xrange [0.008:1.2]; set yrange [0.3:0.45]; set xtics (0.01, 0.1, 1); set format y '%g'
set key at graph 0.98,0.98 right samplen 2
plot rows('viscosity_8') using ($2 > 0 ? $2 : 0.01):3 with linespoints pt 7 lw 2 lc rgb sky title '8 mm', \
  rows('viscosity_4') using ($2 > 0 ? $2 : 0.01):3 with linespoints pt 7 lw 2 lc rgb blue title '4 mm', \
  0.40 with lines dt 3 lc rgb grey title 'experiments, weak', 0.43 with lines dt 3 lc rgb grey notitle
unset logscale
eval panel(0.72, 0.98, 0.05, 0.31)
set title 'cohesive soil: distances over the spacing' offset 0,-0.5
set xlabel 'artificial stress'
set xrange [-0.05:1.05]; set yrange [0:3]; set xtics 0.25 autofreq
set key at graph 0.98,0.98 right samplen 2
plot rows('tension') using 2:3 with linespoints pt 7 lw 2 lc rgb blue title 'closest pair', \
  rows('tension') using 2:4 with linespoints pt 7 lw 2 lc rgb orange title 'farthest fourth neighbour', \
  0.5 with lines dt 3 lc rgb blue notitle, 2 with lines dt 3 lc rgb orange notitle
unset multiplot
