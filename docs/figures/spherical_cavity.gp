# SPDX-License-Identifier: GPL-3.0-or-later
# Errors on the spherical cavity against nodes and against time, from bench_spherical_cavity.
load figures.'/style.gp'
eval page('spherical_cavity', 1200, 900)
file = data.'/spherical_cavity.dat'
set logscale xy
set format x '10^{%T}'; set format y '10^{%T}'; set mxtics 10; set mytics 10
set autoscale xfix; set autoscale yfix
set offsets graph 0.05, graph 0.05, graph 0.05, graph 0.05
methods = 'cells mls full p1 p2 coarse quadratic'
names = "'efree, H/h = 4' 'efree, MLS functions' 'efree, full integration' 'P1 tetrahedra' 'P2 tetrahedra' 'efree, H/h = 2.5' 'the same, quadratic'"
titles = "'displacement, L_2 norm' 'energy norm' 'energy norm, recovered'"
array colours[7] = [blue, orange, green, black, pink, sky, yellow]
array points[7] = [7, 5, 9, 1, 2, 6, 4]
set multiplot
do for [row = 1:2] {
  x = row == 1 ? 2 : 14
  do for [k = 1:3] {
    eval panel(0.075 + 0.315 * (k - 1), 0.325 + 0.315 * (k - 1), row == 1 ? 0.585 : 0.1, row == 1 ? 0.955 : 0.47)
    if (row == 1) { set title word(titles, k) offset 0,-0.4 } else { unset title }
    set xlabel row == 1 ? 'nodes' : 'CPU seconds, mesh included' offset 0,0.3
    if (k == 1) { set ylabel 'relative error' offset 0.8,0 } else { unset ylabel }
    if (row == 1 && k == 3) { set key bottom left Left reverse samplen 1.6 spacing 1.1 font ",12" } else { unset key }
    y = 2 + 3 * k
    plot for [i = 1:7] file index word(methods, i) using x:y with linespoints pt points[i] lw (i == 1 ? 3.5 : 1.8) \
      lc rgb colours[i] title word(names, i)
  }
}
unset multiplot
