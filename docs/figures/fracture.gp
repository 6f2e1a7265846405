# SPDX-License-Identifier: GPL-3.0-or-later
# Onset of a crack in a strip by the spacing of nodes, and the crack in the plate of Kalthoff and Winkler, from
# bench_fracture.
load figures.'/style.gp'
eval page('fracture', 1200, 560)
onset = data.'/fracture_onset.csv'; path = data.'/fracture_path.csv'
set datafile separator ','
set multiplot
eval panel(0.07, 0.47, 0.13, 0.9)
set title 'a crack in a strip begins to grow' offset 0,-0.4
set xlabel 'longest edge over the height of the strip' offset 0,0.4
set ylabel 'G / G_c' offset 1.5,0
set xrange [0.038:0.014]; set yrange [0.6:2]
set xtics (0.0333, 0.025, 0.0167)
set key at graph 0.02,0.98 left Left reverse samplen 1.6 font ",12"
array balls[3] = [0, 2, 3]
array names[3] = ['a point alone', 'radius of 2 spacings', 'radius of 3 spacings']
array colours[3] = [orange, blue, green]
plot 1 with lines lw 1.5 lc rgb black title 'Griffith', \
  for [i = 1:3] onset skip 1 using ($1 == balls[i] ? $2 : 1/0):4 with linespoints pt 7 lw 2.5 lc rgb colours[i] title names[i]
eval panel(0.57, 0.97, 0.13, 0.9)
set title 'points that broke after 90 us, start of the motion; mm' offset 0,-0.4
unset xlabel; unset ylabel
set size ratio -1
set xrange [0:100]; set yrange [0:100]; set xtics 25; set ytics 25
set key at graph 0.02,0.98 left Left reverse samplen 1.6 font ",12"
plot path skip 1 using 1:($3 == 1 ? $2 : 1/0) with points pt 7 ps 0.35 lc rgb grey title 'notch', \
  path skip 1 using 1:($3 == 0 ? $2 : 1/0) with points pt 7 ps 0.4 lc rgb blue title 'broke', \
  (x > 50 ? 25 + tan(70 * pi / 180) * (x - 50) : 1/0) with lines dt 2 lw 1.5 lc rgb black title '70 degrees (experiment)'
unset multiplot
