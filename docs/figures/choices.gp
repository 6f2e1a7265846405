# SPDX-License-Identifier: GPL-3.0-or-later
# Errors and time on the plate with a hole over one choice at a time, from bench_choices.
load figures.'/style.gp'
file = data.'/choices.dat'
titles = "'displacement, L_2 norm' 'energy norm, gradients of u' 'energy norm, recovered stress' 'CPU seconds, basis and solution'"
array colours[3] = [sky, blue, black]
array points[3] = [5, 7, 9]
spacings = '0.4 0.2 0.1'
place(k) = panel(0.095 + 0.485 * ((k - 1) % 2), 0.445 + 0.485 * ((k - 1) % 2), k < 3 ? 0.575 : 0.09, k < 3 ? 0.955 : 0.47)
unset key
# Tics at 1, 2 and 5 times powers of ten, and no more range than the data need.
set format y '%g'
set ytics () nomirror
do for [d = -5:1] { do for [m = 1:3] { set ytics add (word('1 2 5', m) * 10.0**d) } }
set autoscale yfix
set offsets 0, 0, graph 0.08, graph 0.08

# Support and H/h: a curve for each spacing; dashed: linear interpolation on the fine mesh.
choice_names = 'support mesh_ratio'
array xlabels[2] = ['support radius / H', 'H/h: cloud spacing / fine mesh size']
array defaults[2] = [2.5, 3]
array last[2] = [7, 5]
do for [c = 1:2] {
  choice = word(choice_names, c)
  eval page(choice, 1200, 900)
  set multiplot
  unset logscale; set logscale y
  if (c == 1) { set xrange [1.4:3.6]; set xtics 1.5, 0.5, 3.5 } else { set logscale x; set xrange [1.8:13]; set xtics (2, 3, 4, 6, 8, 12) }
  do for [k = 1:4] {
    eval place(k)
    set title word(titles, k) offset 0,-0.4
    if (k > 2) { set xlabel xlabels[c] } else { unset xlabel }
    if (k == 1 || k == 3) { set ylabel 'relative error' offset 0.5,0 } else { unset ylabel }
    unset arrow; unset label
    set arrow from defaults[c], graph 0 to defaults[c], graph 1 nohead lw 1.5 dt 2 lc rgb grey
    set label (c == 1 ? 'default' : 'examples') at defaults[c], graph 0.04 right offset -0.5,0 tc rgb grey
    y = 3 * k - 1
    plot for [i = 1:3] file index choice.' '.word(spacings, i) using 1:y:y + 1:y + 2 with yerrorbars pt -1 lw 1.2 lc rgb colours[i], \
         for [i = 1:3] '' index choice.' '.word(spacings, i) using 1:y with linespoints pt points[i] lw 2.2 lc rgb colours[i], \
         for [i = 1:3] '' index (c == 2 ? choice.'_linear ' : choice.' ').word(spacings, i) using 1:y with lines lw 1.6 dt 2 lc rgb colours[i], \
         for [i = 1:3] '' index choice.' '.word(spacings, i) every ::last[c]::last[c] using 1:y:('H = '.word(spacings, i)) \
           with labels left offset 0.9,0 tc rgb colours[i]
  }
  unset multiplot
}

# M/N: both secondary bases, and full integration as the limit.
eval page('ratio', 1200, 900)
set multiplot
unset logscale; set logscale xy; set xrange [0.9:9]; set xtics (1, 1.4, 2, 3, 4, 6, 8)
array bases[2] = ['ratio_cells', 'ratio_mls']
array base_names[2] = ['cells', 'MLS functions']
array base_colours[2] = [blue, orange]
array base_points[2] = [7, 5]
fine = '0.2 0.1'
do for [k = 1:4] {
  eval place(k)
  set title word(titles, k) offset 0,-0.4
  if (k > 2) { set xlabel 'quadrature points per node, M/N' } else { unset xlabel }
  if (k == 1 || k == 3) { set ylabel 'relative error' offset 0.5,0 } else { unset ylabel }
  unset arrow; unset label; unset key
  set arrow from 4, graph 0 to 4, graph 1 nohead lw 1.5 dt 2 lc rgb blue
  set arrow from 6, graph 0 to 6, graph 1 nohead lw 1.5 dt 2 lc rgb orange
  if (k == 2) { set key top right Left reverse samplen 2 spacing 1.2 opaque }
  set label 'default' at 4, graph 0.04 right offset -0.4,0 tc rgb blue; set label 'default' at 6, graph 0.04 right offset -0.4,0 tc rgb orange
  y = 3 * k - 1
  plot for [j = 1:2] for [i = 1:2] file index bases[i].' '.word(fine, j) using 1:y:y + 1:y + 2 with yerrorbars pt -1 lw 1.2 lc rgb base_colours[i] notitle, \
       for [j = 1:2] for [i = 1:2] '' index bases[i].' '.word(fine, j) using 1:y with linespoints pt base_points[i] lw 2.2 lc rgb base_colours[i] \
         title (j == 1 ? base_names[i] : ''), \
       for [j = 1:2] '' index 'ratio_full '.word(fine, j) using (0.9):y:(8.1):(0) with vectors nohead lw 1.8 dt 4 lc rgb green title (j == 1 ? 'full integration' : ''), \
       for [j = 1:2] '' index bases[1].' '.word(fine, j) every ::6::6 using 1:y:('H = '.word(fine, j)) with labels left offset 0.9,-0.2 tc rgb '#333333' notitle
}
unset multiplot

# Weight engines: error against time, a point for each spacing.
file = data.'/by_value.dat'
eval page('weights', 1200, 460)
set multiplot
unset logscale; set logscale xy; unset xtics; set xtics nomirror tc rgb '#333333'; set format x '%g'; set mxtics 10
set autoscale x; set autoscale xfix; set offsets graph 0.06, graph 0.06, graph 0.06, graph 0.06
engines = 'visibility fast_marching heat_geodesic heat_flow euclidean'
names = "'visibility (default)' 'fast marching' 'heat method' 'heat itself' 'straight line'"
titles = "'displacement, L_2 norm' 'energy, gradients of u' 'energy, recovered'"
array engine_colours[5] = [blue, green, orange, pink, grey]
array engine_points[5] = [7, 9, 5, 13, 1]
unset arrow; unset label
do for [k = 1:3] {
  eval panel(0.095 + 0.245 * (k - 1), 0.285 + 0.245 * (k - 1), 0.17, 0.9)
  set title word(titles, k) offset 0,-0.3
  set xlabel 'CPU seconds'
  if (k == 1) { set ylabel 'relative error' offset 0.5,0 } else { unset ylabel }
  if (k == 3) { set key at screen 0.795,0.89 left top Left reverse vertical spacing 1.4 samplen 2 } else { unset key }
  y = 3 * k - 1
  plot for [i = 1:5] file index 'weight '.word(engines, i) using 11:y with linespoints pt engine_points[i] lw (i == 1 ? 3.5 : 1.8) lc rgb engine_colours[i] title word(names, i)
}
unset multiplot
