# SPDX-License-Identifier: GPL-3.0-or-later
# What is left of a sphere's speed behind a plate, with Recht and Ipson's fit, and the plate behind it, from
# bench_ballistics.
load figures.'/style.gp'
eval page('ballistics', 1200, 560)
array files[2] = [data.'/ballistics_1.csv', data.'/ballistics_05.csv']
array names[2] = ['1 mm', '0.5 mm']
array colours[2] = [orange, blue]
array a[2]; array v[2]; array p[2]
points = data.'/ballistics_points.csv'
set datafile separator ','
# v_r = a (v^p - v_l^p)^(1/p) (Recht & Ipson 1963) through runs that went through and balance.
set fit quiet logfile '/dev/null'
do for [k = 1:2] {
  fa = 0.95; fv = k == 1 ? 290.0 : 310.0; fp = 2.0
  f(x) = x > fv ? fa * (x**fp - fv**fp)**(1.0 / fp) : 0.0
  fit f(x) files[k] skip 1 using ($6 == 1 && abs($8) < 0.02 ? $4 : 1/0):5 via fa, fv, fp
  a[k] = fa; v[k] = fv; p[k] = fp
  print sprintf('%s: a %.3f, limit %.0f m/s, p %.2f', names[k], fa, fv, fp)
}
recht(k, x) = x > v[k] ? a[k] * (x**p[k] - v[k]**p[k])**(1.0 / p[k]) : 0.0
set multiplot
eval panel(0.07, 0.47, 0.13, 0.9)
set title 'a steel sphere through an aluminium plate' offset 0,-0.4
set xlabel 'speed before [m/s]' offset 0,0.4
set ylabel 'behind [m/s]' offset 1.5,0
set xrange [180:820]; set yrange [-20:800]; set samples 600
set key at graph 0.02,0.98 left Left reverse samplen 1.6 font ",12"
plot for [k = 1:2] recht(k, x) with lines lw 1.5 lc rgb colours[k] \
    title sprintf('%s: %.2f (v^{%.2f} - %.0f^{%.2f})^{1/%.2f}', names[k], a[k], p[k], v[k], p[k], p[k]), \
  for [k = 1:2] files[k] skip 1 using (abs($8) < 0.02 ? $4 : 1/0):5 with points pt 7 ps 1.1 lc rgb colours[k] notitle
eval panel(0.55, 0.98, 0.13, 0.9)
set title 'after 400 m/s; mm' offset 0,-0.4
unset xlabel; unset ylabel
set size ratio -1
set xrange [-21:21]; set yrange [-22:8]; set xtics 10; set ytics 10
set key left bottom Left reverse samplen 1.6 font ",12"
plot for [s in '-1 1'] points skip 1 using ($3 == 1 && $4 == 0 ? s * $1 : 1/0):2 with points pt 7 ps 0.4 lc rgb blue \
    title s eq '1' ? 'plate' : '', \
  for [s in '-1 1'] points skip 1 using ($3 == 0 && $4 == 0 ? s * $1 : 1/0):2 with points pt 7 ps 0.4 lc rgb grey \
    title s eq '1' ? 'sphere' : '', \
  for [s in '-1 1'] points skip 1 using ($4 == 1 ? s * $1 : 1/0):2 with points pt 6 ps 0.4 lc rgb orange \
    title s eq '1' ? 'eroded' : ''
unset multiplot
