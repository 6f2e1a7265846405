# SPDX-License-Identifier: GPL-3.0-or-later
# Error of the effective stiffness of plates full of holes against unknowns and time, from bench_feature_rich.
load figures.'/style.gp'
do for [plate in 'holes porous image'] {
  eval page('feature_rich_'.plate, 1200, 560)
  file = data.'/'.plate.'.dat'
  larger = plate eq 'image' ? 10 : 1
  set logscale xy
  set yrange [0.3:30]
  set ytics ('0.3' 0.3, '1' 1, '3' 3, '10' 10, '30' 30)
  set multiplot
  do for [k = 1:2] {
    eval panel(k == 1 ? 0.075 : 0.56, k == 1 ? 0.475 : 0.96, 0.31, 0.95)
    column = k == 1 ? 4 : 7
    set xrange [(k == 1 ? 1e3 : 0.03) * larger:(k == 1 ? 1e6 : 30) * larger]
    set xlabel k == 1 ? 'unknowns' : 'CPU seconds, mesh included' offset 0,0.3
    set format x k == 1 ? '10^{%T}' : '%g'
    if (k == 1) { set ylabel '|error of the stiffness|  [%]' offset 1,0 } else { unset ylabel }
    unset arrow
    set arrow from graph 0, first 3 to graph 1, first 3 nohead lw 1.5 dt 2 lc rgb grey
    if (k == 1) { unset key } else { set key at screen 0.5, screen 0.19 center top maxrows 3 Left reverse samplen 2 width -5 font ',13' }
    e(x) = 100*abs(x)
    plot file index 'P1' using column:(e($10)) with linespoints pt 4 lw 1.6 lc rgb grey title 'P1', \
      '' index 'P2' using column:(e($10)) with linespoints pt 5 lw 2.5 lc rgb black title 'P2', \
      '' index 'P2 without small pores' using column:(e($10)) with linespoints pt 6 lw 1.6 dt 2 lc rgb black title 'P2 without the small pores', \
      '' index 'P2 without more of them' using column:(e($10)) with linespoints pt 12 lw 1.6 dt 3 lc rgb black title 'P2 without more of them', \
      '' index 'uniform on fine P1' using column:(e($10)) with linespoints pt 8 lw 1.6 dt 2 lc rgb sky title 'uniform cloud, fine mesh, P1', \
      '' index 'graded on fine P1' using column:(e($10)) with linespoints pt 9 lw 2 lc rgb blue title 'graded cloud, fine mesh, P1', \
      '' index 'graded on fine P2' using column:(e($10)) with linespoints pt 7 lw 2 lc rgb green title 'graded cloud, fine mesh, P2', \
      '' index 'uniform on coarsest P2' using column:(e($10)) with linespoints pt 10 lw 1.6 dt 2 lc rgb yellow title 'uniform cloud, coarse mesh, P2', \
      '' index 'graded on coarsest P2' using column:(e($10)) with linespoints pt 11 lw 2.5 lc rgb orange title 'graded cloud, coarse mesh, P2'
  }
  unset multiplot
}
