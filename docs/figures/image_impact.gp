# SPDX-License-Identifier: GPL-3.0-or-later
# A porous block thrown against a wall: force of clouds beside that of finite elements, from bench_image_impact 128 3.
load figures.'/style.gp'
eval page('image_impact', 1200, 420)
set datafile separator ','
set multiplot
array spacings[3] = ['10.0', '7.00', '5.00']
array names[3] = ['H = 10 voxels', 'H = 7 voxels', 'H = 5 voxels']
array colours[3] = [green, blue, orange]
set xrange [0:60]; set xtics 20; set xlabel 'time [{/Symbol m}s]' offset 0,0.4
set yrange [0:*]
do for [k = 1:3] {
  eval panel(0.06 + 0.32 * (k - 1), 0.34 + 0.32 * (k - 1), 0.17, 0.88)
  set title names[k].', mean over H / c' offset 0,-0.4
  if (k == 1) { set ylabel 'force [MN]' offset 1,0 } else { unset ylabel }
  set key at graph 0.98,0.97 right Left reverse samplen 1.6 font ",12"
  forces = data.'/force_128_3.00_'.spacings[k].'.csv'
  plot forces skip 1 using 1:($2 / 1000.0) with lines lw 1.8 lc rgb black title 'finite elements', \
    forces skip 1 using 1:($3 / 1000.0) with lines lw 1.8 lc rgb colours[k] title 'cloud'
}
unset multiplot
