# SPDX-License-Identifier: GPL-3.0-or-later
# Charts of docs/stability.md from the tables of bench_stability.
load figures.'/style.gp'
set datafile separator comma
set datafile missing NaN
file(name) = data.'/'.name.'.csv'

# Volumetric locking: error of the tip over H.
eval page('stability_locking', 1200, 460)
set multiplot
do for [k = 1:2] {
  eval panel(0.08 + 0.475 * (k - 1), 0.5 + 0.475 * (k - 1), 0.16, 0.9)
  strains = k == 1 ? 'small' : 'finite'
  set title strains.' strains, {/Symbol n} = 0.4999' offset 0,-0.4
  set logscale x; set xrange [11:1.4]; set yrange [-75:10]; set xtics (9.6, 6.4, 4.8, 3.2, 2.4, 1.6)
  set xlabel 'spacing H (elements of as many nodes)'
  if (k == 1) { set ylabel 'error of the tip, %' } else { unset ylabel }
  if (k == 2) { set key at graph 1, graph 0.36 right top Right samplen 1.5 } else { unset key }
  is(method) = strcol(1) eq strains && strcol(2) eq '0.4999' && strcol(3) eq method
  plot 2 lc rgb grey dt 2 notitle, -2 lc rgb grey dt 2 notitle, \
    file('locking') using (is('P1') ? $4 : NaN):8 with linespoints pt 1 lc rgb black title 'P1', \
    '' using (is('full integration') ? $4 : NaN):8 with linespoints pt 2 lc rgb orange title 'cloud, full integration', \
    '' using (is('P2') ? $4 : NaN):8 with linespoints pt 6 lc rgb pink title 'P2', \
    '' using (is('P2 with mean dilatation') ? $4 : NaN):8 with linespoints pt 8 lc rgb green title 'P2, mean dilatation', \
    '' using (is('efree') ? $4 : NaN):8 with points pt 7 lc rgb blue title 'efree, five clouds'
}
unset multiplot

# Few points: what the tangent sees over M/N.
eval page('stability_points', 1200, 480)
unset title; unset label
eval panel(0.08, 0.62, 0.15, 0.95)
set xrange [0.45:9]; set yrange [-0.5:1.05]; set xtics (0.5, 0.7, 1, 1.4, 2, 2.8, 4, 5.6, 8)
set xlabel 'quadrature points per node, M/N'; set ylabel 'share of the least stiffness that is seen'
set key at screen 0.99, screen 0.93 right top Right samplen 1.5
set arrow from 4, graph 0 to 4, graph 1 nohead dt 2 lc rgb grey
states = "'at rest' 'stretched to 2' 'squeezed to 0.7' 'nearly incompressible stretched to 2' 'nearly incompressible squeezed to 0.7' 'yielding'"
array colours[6] = [black, blue, orange, sky, yellow, green]
is(k) = strcol(1) eq word(states, k) && strcol(2) eq 'cells' && !(strcol(3) eq 'default') && strcol(4) eq '1'
plot 0 lc rgb grey notitle, for [k = 1:6] file('points') using (is(k) ? $5 : NaN):8 with linespoints pt 7 lw 1.8 lc rgb colours[k] title word(states, k)
unset arrow

# Surface of a compressed block.
eval page('stability_surface', 1000, 460)
eval panel(0.09, 0.68, 0.15, 0.95)
set xrange [0.3:0.055]; set yrange [0.38:0.72]; set xtics (0.25, 0.167, 0.125, 0.0833, 0.0625)
set xlabel 'spacing H (elements of as many nodes)'; set ylabel 'stretch of the first zero eigenvalue'
is(method) = strcol(1) eq method
plot 0.543689 lc rgb grey lw 1.5 title 'half-space', 0.56 lc rgb grey dt 2 title '3 %', 0.5274 lc rgb grey dt 2 notitle, \
  file('surface') using (is('efree') ? $2 : NaN):5 with points pt 7 lc rgb blue title 'efree, five clouds', \
  '' using (is('P2 with mean dilatation') ? $2 : NaN):5 with linespoints pt 8 lc rgb green title 'P2, mean dilatation', \
  '' using (is('P2') ? $2 : NaN):5 with linespoints pt 6 lc rgb pink title 'P2'

# Stress intensity of an edge crack.
eval page('stability_crack', 1000, 460)
eval panel(0.09, 0.68, 0.15, 0.95)
set xrange [2.7:13.5]; set yrange [-21:4]; set xtics (3, 5, 8, 12)
set xlabel 'nodes along the crack, a/H (a = 0.5 of the width)'; set ylabel 'error of K, %'
is(method) = strcol(1) eq '0.5' && strcol(2) eq method
plot 3 lc rgb grey dt 2 notitle, -3 lc rgb grey dt 2 title '3 %', \
  file('crack') using (is('P1') ? $3 : NaN):7 with linespoints pt 1 lc rgb black title 'P1, as many nodes', \
  '' using (is('P2') ? $3 : NaN):7 with linespoints pt 6 lc rgb pink title 'P2, as many nodes', \
  '' using (is('cloud alone') ? $3 : NaN):7 with points pt 4 lc rgb sky title 'cloud alone', \
  '' using (is('efree') ? $3 : NaN):7 with points pt 7 lc rgb blue title 'efree'

# Pressure of a thick tube, and inf-sup values.
eval page('stability_pressure', 1200, 460)
set multiplot
eval panel(0.08, 0.47, 0.16, 0.9)
set title 'mean stress of a thick tube, {/Symbol n} = 0.4999' offset 0,-0.4
set logscale xy; set xrange [0.3:0.05]; set yrange [0.01:1e9]; set xtics (0.24, 0.12, 0.06); set ytics format '10^{%T}'
set xlabel 'spacing H (elements of as many nodes)'; set ylabel 'root mean square off, %'; set key at graph 1, graph 1.02 right top Right samplen 1.5
is(method) = strcol(1) eq method
plot file('tube') using (is('full integration') ? $2 : NaN):5 with linespoints pt 2 lc rgb orange title 'cloud, full integration', \
  '' using (is('P1') ? $2 : NaN):5 with linespoints pt 1 lc rgb black title 'P1', \
  '' using (is('P2') ? $2 : NaN):5 with linespoints pt 6 lc rgb pink title 'P2', \
  '' using (is('P2 with mean dilatation') ? $2 : NaN):5 with linespoints pt 8 lc rgb green title 'P2, mean dilatation', \
  '' using (is('cloud alone') ? $2 : NaN):5 with points pt 4 lc rgb sky title 'cloud alone', \
  '' using (is('efree') ? $2 : NaN):5 with points pt 7 lc rgb blue title 'efree'
eval panel(0.57, 0.97, 0.16, 0.9)
set title 'inf-sup value of pressures' offset 0,-0.4
unset logscale y; set xrange [0.24:0.021]; set yrange [0:1.2]; set xtics (0.2, 0.1, 0.05, 0.025); set ytics format '%g'
set xlabel 'spacing H'; unset ylabel; set key at graph 1, graph 1.02 right top Right
plot file('inf_sup') using (strcol(1) eq 'cells' ? $2 : NaN):6 with points pt 7 lc rgb blue title 'indicators (default)', \
  '' using (strcol(1) eq 'linear' ? $2 : NaN):6 with points pt 5 lc rgb green title 'levelled clusters ("linear")'
unset multiplot
