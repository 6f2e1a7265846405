# SPDX-License-Identifier: GPL-3.0-or-later
# Sod's tube beside its exact solution, and errors of three Riemann problems against points, from bench_shock_tube.
load figures.'/style.gp'
eval page('shock_tube', 1200, 820)
found = data.'/shock_tube_sod.csv'; exact = data.'/shock_tube_exact.csv'; errors = data.'/shock_tube.csv'
set datafile separator ','
set multiplot
array titles[3] = ['density', 'velocity', 'internal energy']
array columns[3] = [2, 3, 5]
array least[3] = [0.0, -0.05, 1.7]
array most[3] = [1.08, 1.05, 3.1]
set xrange [-0.5:0.5]; set xtics 0.25
do for [k = 1:3] {
  eval panel(0.05 + 0.325 * (k - 1), 0.33 + 0.325 * (k - 1), 0.58, 0.94)
  set title titles[k].', Sod, t = 0.2' offset 0,-0.4
  set yrange [least[k]:most[k]]
  if (k == 1) { set key at graph 0.98,0.97 right Left reverse samplen 1.6 font ",12" } else { unset key }
  plot exact skip 1 using 1:(column(columns[k] == 5 ? 9 : columns[k] + 4)) with lines lw 1.8 lc rgb black title 'exact', \
    found skip 1 using 1:(column(columns[k])) with points pt 6 ps 0.7 lw 1.4 lc rgb blue title '100 points'
}
set logscale xy
set xrange [80:1000]; set xtics (100, 200, 400, 800); set format y '%g'; set mytics 10
set xlabel 'points' offset 0,0.4
array problems[3] = ['sod', 'lax', 'collision']
array names[3] = ['Sod', 'Lax', 'streams that meet']
array colours[3] = [blue, orange, green]
array norms[2] = ['density, L_1 norm of the error', 'velocity, L_2 norm of the error']
array low[2] = [6e-4, 0.0045]
array high[2] = [4e-2, 0.13]
do for [k = 1:2] {
  eval panel(0.08 + 0.49 * (k - 1), 0.48 + 0.49 * (k - 1), 0.09, 0.45)
  set title norms[k] offset 0,-0.4
  set yrange [low[k]:high[k]]
  if (k == 2) { set key at graph 0.02,0.02 bottom left Left reverse samplen 1.6 font ",12" } else { unset key }
  guide(x) = k == 1 ? 3.2e-2 * (100.0 / x) : 0.105 * sqrt(100.0 / x)
  plot for [i = 1:3] errors skip 1 using (strcol(1) eq problems[i] && strcol(2) eq 'lme' ? $3 : 1/0):(column(k + 3)) \
      with linespoints pt 7 lw 2.5 lc rgb colours[i] title names[i], \
    for [i = 1:3] errors skip 1 using (strcol(1) eq problems[i] && strcol(2) eq 'elements' ? $3 : 1/0):(column(k + 3)) \
      with linespoints pt 6 lw 1.2 dt 2 lc rgb colours[i] title names[i].', elements', \
    guide(x) with lines dt 3 lw 1.5 lc rgb grey title k == 1 ? 'order 1' : 'order 1/2'
}
unset multiplot
