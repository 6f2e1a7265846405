# SPDX-License-Identifier: GPL-3.0-or-later
# Plastic, softening and strongly deformed bodies, from the CSV files of bench_stability_plastic.
load figures.'/style.gp'
set datafile separator ','
only(file, columns, keys) = sprintf("< awk -F, 'NR > 1 && %s { print %s }' OFS=, %s/%s.csv", keys, columns, data, file)
lines(k) = word("'#0072B2' '#56B4E9' '#D55E00' '#E69F00' '#777777' '#CC79A7'", k)

# Limit loads.
eval page('stability_limits', 1200, 900)
set multiplot
set yrange [0:1.35]
set key bottom right Left reverse samplen 1.6 spacing 1.1 font ',12'
bodies = "'footing' 'notched strip'"
first = "'1' '0.5'"
do for [k = 1:2] {
  b = word(bodies, k); f = real(word(first, k))
  eval panel(0.07 + 0.49 * (k - 1), 0.5 + 0.49 * (k - 1), 0.58, 0.95)
  set title b.' in plane strain' offset 0,-0.4
  set xlabel 'share of the displacement' offset 0,0.3
  if (k == 1) { set ylabel 'load over (2 + {/Symbol p}) k' offset 1,0 } else { unset ylabel }
  key(method, H) = sprintf("$1 == \"%s\" && $2 == \"%s %g\"", b, method, H)
  plot 1 lc rgb black dt 2 notitle, \
    only('limit', '$3, $4', key('full H=0.25', f / 16)) using 1:2 with lines lw 2 lc rgb grey title 'full integration', \
    only('limit', '$3, $4', key('pointwise H=0.25', f / 16)) using 1:2 with lines lw 2 lc rgb orange title 'pointwise dilatation', \
    only('limit', '$3, $4', key('cloud H=0.25', f / 8)) using 1:2 with lines lw 2 lc rgb sky title 'defaults, edge 1/8', \
    only('limit', '$3, $4', key('cloud H=0.25', f / 16)) using 1:2 with lines lw 2 lc rgb blue dt 4 title 'defaults, edge 1/16', \
    only('limit', '$3, $4', key('cloud H=0.25', f / 32)) using 1:2 with lines lw 3 lc rgb blue title 'defaults, edge 1/32'
}
walls = "'tube in plane strain' 'sphere of revolution'"
scale = "0.19209 0.33271"
do for [k = 1:2] {
  b = word(walls, k); limit = real(word(scale, k))
  eval panel(0.07 + 0.49 * (k - 1), 0.5 + 0.49 * (k - 1), 0.08, 0.45)
  set title b offset 0,-0.4
  set xlabel 'displacement of the bore' offset 0,0.3
  if (k == 1) { set ylabel 'pressure over its limit' offset 1,0 } else { unset ylabel }
  nu = k == 1 ? '0.4999' : '0.3'
  key(method) = sprintf("$1 == \"%s\" && $2 == \"%s nu=%s\"", b, method, nu)
  plot only('wall', '$3, $5', key('cloud H=0.1')) using 1:($2 / limit) with lines lw 1.5 lc rgb black dt 2 title 'exact', \
    only('wall', '$3, $4', key('cloud H=0.1')) using 1:($2 / limit) with points pt 7 lc rgb blue title 'defaults, H = 0.1', \
    only('wall', '$3, $4', key('pointwise H=0.1')) using 1:($2 / limit) with lines lw 2 lc rgb orange title 'pointwise dilatation, H = 0.1'
}
unset multiplot
set autoscale y

# To and fro.
eval page('stability_cycles', 1200, 460)
set multiplot
eval panel(0.08, 0.5, 0.15, 0.92)
set xtics 0.004
set title 'sphere that hardens kinematically' offset 0,-0.4
set xlabel 'displacement of the bore' offset 0,0.3; set ylabel 'pressure' offset 1,0
set key top left Left reverse samplen 1.6 font ',12'
m(name) = sprintf("$1 == \"%s\"", name)
plot only('cycle', '$3, $5', m('cloud H=0.05')) using 1:2 with lines lw 1.5 lc rgb black title 'exact', \
  only('cycle', '$3, $4', m('cloud H=0.1')) using 1:2 with points pt 7 ps 0.8 lc rgb blue title 'defaults, H = 0.1'
eval panel(0.58, 0.98, 0.15, 0.92)
set xtics autofreq
set title 'bent bar, let go' offset 0,-0.4
set xlabel 'height' offset 0,0.3; set ylabel 'residual stress' offset 1,0
set key top right
plot only('bend', '$2, $3', m('cloud H=0.05')) using 1:2 every 23 with points pt 7 ps 0.4 lc rgb blue title 'defaults, H = 0.05', \
  only('bend', '$2, $4', m('cloud H=0.05')) using 1:2 smooth unique with lines lw 1.5 lc rgb black title 'exact'
unset multiplot

# Large strains.
eval page('stability_large', 1200, 460)
set multiplot
do for [k = 1:2] {
  b = word("'pressed block' 'necking bar'", k)
  eval panel(0.08 + 0.5 * (k - 1), 0.48 + 0.5 * (k - 1), 0.15, 0.92)
  set title b offset 0,-0.4
  set xlabel 'share of the displacement' offset 0,0.3
  if (k == 1) { set ylabel 'force' offset 1,0; set key top left Left reverse } else { unset ylabel; set key bottom left Left reverse }
  key(method) = sprintf("$1 == \"%s\" && $2 == \"%s\"", b, method)
  H = real(word('0.2 1.6', k))
  plot only('large', '$3, $4', key(sprintf('cloud H=%g', H))) using 1:(abs($2)) with lines lw 2 lc rgb sky title sprintf('defaults, H = %g', H), \
    only('large', '$3, $4', key(sprintf('cloud H=%g', H / 2))) using 1:(abs($2)) with lines lw 3 lc rgb blue title sprintf('defaults, H = %g', H / 2), \
    only('large', '$3, $4', key(sprintf('P2 h=%g', H / 2))) using 1:(abs($2)) with lines lw 2 lc rgb pink title sprintf('P2, h = %g', H / 2), \
    only('large', '$3, $4', key(sprintf('P2 h=%g', H / 4))) using 1:(abs($2)) with lines lw 2 lc rgb orange title sprintf('P2, h = %g', H / 4)
}
unset multiplot

# Softening.
eval page('stability_softening', 800, 460)
eval panel(0.12, 0.96, 0.15, 0.92)
set title 'a strip that softens, torn' offset 0,-0.4
set xlabel 'displacement' offset 0,0.3; set ylabel 'force' offset 1,0
set key top right Left reverse samplen 1.6 font ',12'
set xrange [0:0.03]; set yrange [0:0.32]
$exact << EOD
0,0
0.0057,0.285
0.006,0
0.03,0
EOD
plot $exact using 1:2 with lines lw 1.5 lc rgb black dt 2 title 'a crack of G_c', \
  only('tear', '$2, $3', m('cloud H=0.2 1.25')) using 1:2 with lines lw 2 lc rgb sky title 'H = 0.2, length 0.25', \
  only('tear', '$2, $3', m('cloud H=0.1 2.5')) using 1:2 with lines lw 2 lc rgb blue title 'H = 0.1, length 0.25', \
  only('tear', '$2, $3', m('cloud H=0.05 2.5')) using 1:2 with lines lw 2 lc rgb green title 'H = 0.05, length 0.125', \
  only('tear', '$2, $3', m('cloud H=0.05 2.5 arc')) using 1:2 with points pt 6 lc rgb green title 'the same, arc length'
