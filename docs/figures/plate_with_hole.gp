# SPDX-License-Identifier: GPL-3.0-or-later
# The README's picture: the field, and error against time, from scripts/demo.
load figures.'/style.gp'
width = 1400.0; height = 550.0
set terminal pngcairo size width,height font 'DejaVu Sans,14' fontscale 1.1 enhanced
set output figures.'/plate_with_hole.png'
set multiplot

# The field's picture has 1600 x 1200 pixels: columns 170 to 1200 and rows 100 to 1050 (from below) hold the body. Every
# second one is drawn, pixel by pixel. Its colour bar is drawn anew, sharper, with the range that the file of fields states.
range(which) = real(system(sprintf("grep -a von_mises %s/fields.vtu | sed -n 's/.*%s=\"\\([^\"]*\\)\".*/\\1/p' | head -n 1", data, which)))
unset border; unset tics; unset grid; unset key
set title 'von Mises stress' offset 0,-0.3
set palette defined (0 '#440154', 1 '#414487', 2 '#2A788E', 3 '#21A884', 4 '#7AD151', 5 '#FDE725')
set cbrange [range('RangeMin'):range('RangeMax')]
set cbtics 0.5 offset -0.8,0 scale 0.5
set colorbox user origin 530 / width, 12 / height size 18 / width, 470 / height noborder
eval panel(5 / width, 525 / width, 20 / height, 498 / height)
set xrange [112:1232]; set yrange [62:1092]
plot data.'/fields.png' binary filetype=png every 2:2 with rgbimage, NaN with points palette

reset
load figures.'/style.gp'
file = data.'/convergence.dat'
set logscale xy
set format x '10^{%T}'; set format y '10^{%T}'; set mxtics 10; set mytics 10
set xlabel 'CPU seconds'
set autoscale xfix; set autoscale yfix
methods = 'cells-4 full p1 p2'
names = "'efree, defaults' 'efree, full integration' 'P1 finite elements' 'P2 finite elements'"
titles = "'displacement, L_2 norm' 'energy norm'"
array colours[4] = [blue, green, black, pink]
array points[4] = [7, 9, 1, 2]
do for [k = 1:2] {
  eval panel(k == 1 ? 0.505 : 0.78, k == 1 ? 0.71 : 0.985, 0.15, 0.922)
  set title word(titles, k) offset 0,-0.3
  if (k == 1) { set ylabel 'relative error' offset 0.8,0 } else { unset ylabel }
  if (k == 1) { set key bottom left Left reverse samplen 1.6 spacing 1.15 } else { unset key }
  set offsets graph 0.05, graph 0.05, graph 0.05, graph (k == 1 ? 0.5 : 0.05)
  y = 2 + 3 * k
  plot for [i = 1:4] file index word(methods, i) using 2:y:y + 1:y + 2 with yerrorbars pt -1 lw 1.2 lc rgb colours[i] notitle, \
       for [i = 1:4] '' index word(methods, i) using 2:y with linespoints pt points[i] lw (i == 1 ? 3.5 : 1.8) lc rgb colours[i] title word(names, i)
}
unset multiplot
