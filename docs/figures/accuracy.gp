# SPDX-License-Identifier: GPL-3.0-or-later
# Error in the energy norm against time, of elements, of corrected clouds and of what is asked for, from bench_accuracy.
load figures.'/style.gp'
eval page('accuracy', 1200, 520)
set logscale xy
set format x '10^{%T}'; set mxtics 10; set mytics 10
set ytics ('0.1 %%' 0.1, '0.2 %%' 0.2, '0.5 %%' 0.5, '1 %%' 1, '2 %%' 2, '5 %%' 5, '10 %%' 10, '20 %%' 20)
set autoscale xfix; set autoscale yfix
set offsets graph 0.05, graph 0.05, graph 0.05, graph 0.12
names = "'P1' 'P2' 'corrected, linear' 'corrected, quadratic' 'asked for'"
titles = "'P1 finite elements' 'P2 finite elements' 'efree corrected, linear cells' 'efree corrected, quadratic cells' 'efree, accuracy asked for'"
bodies = "'plate' 'cavity'"
heads = "'plate with a hole' 'spherical cavity, in space'"
array colours[5] = [black, pink, sky, blue, orange]
array points[5] = [1, 2, 6, 7, 5]
set multiplot
do for [k = 1:2] {
  eval panel(0.1 + 0.475 * (k - 1), 0.51 + 0.475 * (k - 1), 0.14, 0.92)
  set title word(heads, k) offset 0,-0.4
  set xlabel 'CPU seconds, mesh included' offset 0,0.3
  if (k == 1) { set ylabel 'error, energy norm' offset 0,0 } else { unset ylabel }
  if (k == 2) { set key bottom left Left reverse samplen 1.6 spacing 1.15 font ',12' } else { unset key }
  file = data.'/accuracy_'.word(bodies, k).'.dat'
  plot for [i = 1:5] file index word(names, i) using 3:2 with linespoints pt points[i] lw (i >= 4 ? 3 : 1.8) \
    lc rgb colours[i] title word(titles, i)
}
unset multiplot
