# SPDX-License-Identifier: GPL-3.0-or-later
# Largest error of a distance against time per source, from bench_geodesics.
load figures.'/style.gp'
eval page('geodesics', 1200, 500)
file = data.'/geodesics.dat'
domains = 'square_with_slit annulus plate_with_holes'
titles = "'square with a slit' 'annulus' 'plate with 12 holes'"
engines = 'visibility fast_marching heat_geodesic heat_geodesic_shared euclidean cgal_heat_method'
names = "'visibility (default)' 'fast marching' 'heat method' 'heat method, shared' 'straight line' 'heat method of CGAL'"
array colours[6] = [blue, green, orange, yellow, grey, pink]
array points[6] = [7, 9, 5, 4, 1, 11]
lowest = 1e-6
set logscale xy
set xrange [0.004:40]; set yrange [4e-7:1.6]
set xtics ('10^{-2}' 0.01, '0.1' 0.1, '1' 1, '10' 10); set mxtics 10
set ytics ('1' 1, '10^{-1}' 1e-1, '10^{-2}' 1e-2, '10^{-3}' 1e-3, '10^{-4}' 1e-4, '10^{-5}' 1e-5, 'exact' lowest)
set xlabel 'ms per source'
set multiplot
do for [k = 1:3] {
  eval panel(0.075 + 0.235 * (k - 1), 0.275 + 0.235 * (k - 1), 0.155, 0.9)
  set title word(titles, k) offset 0,-0.3
  if (k == 1) { set ylabel 'largest error / radius' offset 0.5,0 } else { unset ylabel; set format y '' }
  if (k == 3) { set key at screen 0.76,0.89 left top Left reverse vertical spacing 1.4 samplen 2 } else { unset key }
  if (k == 3) { set label "radius 0.5; from left to right\nh = 0.1, 0.05, 0.025" at screen 0.765,0.22 left font ',13' tc rgb '#333333' }
  plot for [i = 1:6] file index word(domains, k).' '.word(engines, i) using 2:($5 > lowest ? $5 : lowest) \
    with linespoints pt points[i] lw (i == 1 ? 3.5 : 1.8) lc rgb colours[i] title word(names, i)
}
unset multiplot
