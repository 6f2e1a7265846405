# SPDX-License-Identifier: GPL-3.0-or-later
# Error of the load path of a stretched rubber plate against seconds, from bench/peers/rubber_paths.py.
load figures.'/style.gp'
eval page('rubber_paths', 1000, 600)
set datafile separator comma
eval panel(0.11, 0.7, 0.12, 0.93)
set logscale xy
set xrange [0.018:15]; set yrange [5e-5:1]
set xtics (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10)
set ytics ('1 %%' 1, '0.1 %%' 0.1, '0.01 %%' 0.01, '0.001 %%' 0.001, '0.0001 %%' 0.0001)
set title 'rubber plate with a hole, stretched to three times its length' offset 0,-0.4
set xlabel 'CPU seconds, mesh included' offset 0,0.3
set ylabel 'largest error of the force over the path'
set key at screen 0.99, screen 0.9 right top Left reverse samplen 1.8 spacing 1.3 font ',13'
file = data.'/rubber_paths.csv'
names = "'efree cloud' 'efree corrected' 'efree P1' 'efree P2' 'NGSolve P2' 'NGSolve order 4' 'FElupe Q1' 'FElupe Q2'"
titles = "'efree, cloud alone' 'efree, corrected' 'efree, P1' 'efree, P2, straight' 'NGSolve, P2, curved' 'NGSolve, order 4, curved' 'FElupe, Q1, mapped' 'FElupe, Q2, mapped'"
array colours[8] = [blue, sky, black, pink, orange, yellow, grey, green]
array points[8] = [7, 6, 1, 2, 9, 8, 4, 5]
of(i) = strcol(1) eq word(names, i)
plot for [i = 1:8] file using (of(i) ? $4 : NaN):(100 * $5) with linespoints pt points[i] lw (i == 1 ? 3 : 1.8) \
  lc rgb colours[i] title word(titles, i)
